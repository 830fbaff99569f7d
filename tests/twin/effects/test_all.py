"""What holds for every effect: names, declarations, no effect at zero, noise and truth left as they were."""

from pathlib import Path

import numpy as np
import pytest

from schemas.errors import DataError
from tests.twin.effects.worlds import BENDING, STRONG, alone, table
from tests.twin.worlds import PERFECT
from twin import dump_twin, effects, make_twin, parse_twin, simulate
from twin.effects import _table

every = pytest.mark.parametrize("name", STRONG)
RUN = {"duration": 20.0}
ZERO = {
    "gyro_random_walk": {"arw": 0.001},
    "gyro_saturation": {"limit": float("inf")},
    "gyro_bandwidth": {"cutoff": float("inf")},
    "flexure_parameters": {"damping": [0.2146, 0.2146, 0.0715]},
    "nonstationary_sea": {"growth": 1.0},
    "misalignment_step": {"x": 0.0, "time": 10.0},
    "second_mode": {"std_arcmin": 0.0},
    "sample_dropout": {"rate": 0.0},
}
NOISY = {"imu": {unit: {**PERFECT, "gyro_arw": 0.001, "accel_vrw_ug": 10.0} for unit in ("main", "sub")}}
BEFORE_NOISE = sorted(set(STRONG) - {
    "gyro_random_walk", "gyro_quantization", "gyro_saturation", "sample_dropout",
})  # fmt: skip


@pytest.fixture(scope="module")
def plain():
    return simulate(make_twin({"run": RUN}))


def channels(simulation):
    trial, truth = simulation.trial, simulation.truth
    for unit in ("main", "sub", "phins_main", "phins_sub"):
        series = getattr(trial, unit)
        yield from ((f"{unit}.{key}", getattr(series, key)) for key in ("stamp", "gyro", "accel"))
        yield f"{unit}.attitude", series.attitude if series.attitude is not None else np.zeros(0)
    yield "gnss", trial.gnss.latitude
    yield "temperature", np.stack([trial.temperature_main.value, trial.temperature_sub.value])
    yield from (("truth", truth.total), ("truth.attitude", truth.attitude))


def changed(a, b, limit=1e-12):
    right = dict(channels(b))
    return {k for k, v in channels(a) if v.shape != right[k].shape or np.abs(v - right[k]).max(initial=0.0) > limit}


def zero_of(name):
    cls = effects.get(name)
    return ZERO.get(name) or {p.name: 0.0 for p in cls.parameters() if p.is_severity}


def test_all_effects_of_the_log_contract_are_there() -> None:
    assert effects.names() == tuple(STRONG)
    assert len(STRONG) == 32


@every
def test_declarations_are_complete(name: str) -> None:
    cls = effects.get(name)
    assert cls.name == name
    assert cls.about().endswith(".")
    assert cls.advice.endswith(".")
    assert cls.needs
    assert cls.bends == (name in BENDING)
    assert any(p.is_severity for p in cls.parameters())
    for p in cls.parameters():
        low, high = p.prior
        assert p.least <= low < high <= p.most
    for alike in cls.look_alikes:
        assert alike.name in STRONG
        assert alike.name != name
        assert alike.separated_by


@every
def test_a_severity_of_zero_changes_nothing(name: str, plain) -> None:
    twin = make_twin({"run": RUN, "effect": [{"name": name, **zero_of(name)}]})
    assert not changed(plain, simulate(twin), limit=0.0)


@every
def test_an_effect_changes_its_channels_and_no_other(name: str, plain) -> None:
    found = changed(plain, simulate(make_twin({"run": RUN, "effect": [table(name)]})))
    assert found
    assert not {key for key in found if key.startswith("main.") or key in ("gnss", "temperature")}
    if name.startswith("phins"):
        assert found <= {"phins_main.attitude", "phins_sub.attitude"}
    elif name in BENDING:
        assert {"truth", "truth.attitude", "sub.gyro", "phins_sub.attitude"} <= found
        assert "phins_main.attitude" not in found
    elif name == "lever_arm":
        assert found == {"sub.accel", "phins_sub.accel"}
    else:
        assert found <= {"sub.stamp", "sub.gyro", "sub.accel"}


@pytest.fixture(scope="module")
def still():
    """Sub-IMU's gyros and force of a noisy and of a perfect ship without effects."""
    return alone(**NOISY, run=RUN).trial.sub, alone(run=RUN).trial.sub


@pytest.mark.parametrize("name", BEFORE_NOISE)
def test_the_noise_is_the_same_with_and_without(name: str, still) -> None:
    noisy, clean = (alone(table(name), run=RUN, **tables).trial.sub for tables in (NOISY, {}))
    for key in ("gyro", "accel"):
        noise, again = (getattr(a, key) - getattr(b, key) for a, b in (still, (noisy, clean)))
        np.testing.assert_allclose(again, noise, atol=1e-14)
        assert noise.std() > 1e-6


def test_an_effect_draws_the_same_whatever_stands_beside_it() -> None:
    wild = table("outliers")
    one, other = ([wild, table("slamming")], [table("gyro_bias_instability"), wild])
    a, b = (simulate(make_twin({"run": RUN, "effect": e})).trial.sub for e in (one, other))
    c, d = (
        simulate(make_twin({"run": RUN, "effect": [x for x in e if x is not wild]})).trial.sub for e in (one, other)
    )
    np.testing.assert_allclose(a.gyro - c.gyro, b.gyro - d.gyro, atol=1e-15)
    assert np.abs(a.gyro - c.gyro).max() > 1e-3


def test_two_of_a_name_draw_apart() -> None:
    one, two = ([table("outliers")] * k for k in (1, 2))
    a, b = (simulate(make_twin({"run": RUN, "effect": e})).trial.sub.gyro for e in (one, two))
    assert np.count_nonzero((b - a).any(axis=1)) > 10


@every
def test_effects_survive_the_way_through_toml(name: str) -> None:
    twin = make_twin({"effect": [table(name)]})
    assert parse_twin(dump_twin(twin)) == twin


@every
def test_unknown_parameters_and_absurd_values_are_told(name: str) -> None:
    with pytest.raises(DataError, match=rf"effect '{name}': unknown parameter 'arms' \(there are "):
        make_twin({"effect": [table(name, arms=8)]})
    with pytest.raises(DataError, match=rf"effect '{name}': "):
        make_twin({"effect": [{"name": name}]})
    for p in effects.get(name).parameters():
        absurd = -1.0 if p.most == float("inf") else p.most * 2 + 1
        with pytest.raises(DataError, match=rf"effect '{name}': '{p.name}' must be .* not "):
            make_twin({"effect": [table(name, **{p.name: absurd})]})
        with pytest.raises(DataError, match=rf"effect '{name}': '{p.name}'"):
            make_twin({"effect": [table(name, **{p.name: "much"})]})


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ({"name": "misalignment_step", "x": 1.0}, "effect 'misalignment_step': lacks its parameter 'time'"),
        ({"name": "gyro_bias", "x": float("nan")}, r"'x' must be between -36000 and 36000 deg/h, not nan"),
        ({"name": "slamming", "rate": 1.0, "amplitude": 1.0, "axis": "w"}, r"'axis' input should be 'x', 'y' or 'z'"),
        ({"name": "axis_coupling", "xy": 0.9, "xz": 0.9, "yz": -0.9}, "no three axes have such correlations"),
        ({"name": "thermal_bending", "amplitude": {"w": 1.0}}, "'amplitude' there is no axis w"),
        ({"name": "time_delay", "dely": 1.0}, r"unknown parameter 'dely' \(there are 'delay'\)"),
        ({"name": "gyro_bias"}, "states none of its parameters x, y, z"),
        ({"name": "gyro_saturation", "limit": 0.0}, "'limit' must be at least 1e-06 deg/s, not 0"),
    ],
)
def test_messages(entry, line: str) -> None:
    with pytest.raises(DataError, match=line):
        make_twin({"effect": [entry]})


def test_look_alikes_hold_both_ways_and_end_with_the_channel_that_separates() -> None:
    gyros, inertial = ("main.gyro", "sub.gyro"), ("main.gyro", "sub.gyro", "main.accel", "sub.accel")

    def alike(name, channels):
        return {item.name for item in effects.look_alikes(name, channels)}

    assert "gyro_bandwidth" in alike("time_delay", gyros)
    assert "time_delay" in alike("gyro_bandwidth", gyros)
    assert "time_delay" not in alike("gyro_bandwidth", inertial)
    assert "gyro_g_sensitivity" in alike("gyro_bias", inertial)
    assert effects.look_alikes("gyro_bias", inertial)[0].name == "gyro_g_sensitivity"
    assert "static_misalignment" in alike("gyro_nonorthogonality", gyros)


def test_the_documented_table_is_that_of_the_declarations() -> None:
    page = (Path(__file__).parents[3] / "docs" / "effects.md").read_text("utf-8")
    assert _table.document() == page, "docs/effects.md is stale: run python -m twin.effects._table > docs/effects.md"
