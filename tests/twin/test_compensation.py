"""Compensation: a simulation with an effect that is taken out again is the one of the same seed without it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

from schemas.products import Alignment, Deformation, Estimate, FlexureModel
from tests.twin.effects.worlds import STRONG, table
from twin import bent, effects, make_twin, simulate
from twin.compensation import compensate

MICRO_G = 9.80665e-6
ARCMIN = np.pi / 180 / 60
WORLD = {"run": {"duration": 60.0}, "mount": {"lever_arm": [-4.0, 40.0, 3.0]}}
TWIN = make_twin(WORLD)

# most that is left, rms on the worst axis: rad/s, ug, rad; the noise of a sample is 3e-6 rad/s, 100 ug, 2e-5 rad
LEFT = {
    "time_delay": {"sub.gyro": 7e-6, "sub.accel": 200.0},  # interpolated for the comparison, noise and all
    "clock_drift": {"sub.gyro": 7e-6, "sub.accel": 200.0},
    "timestamp_jitter": {"sub.gyro": 5e-7, "sub.accel": 2.0},
    "gyro_scale_factor": {"sub.gyro": 1e-8},
    "gyro_nonorthogonality": {"sub.gyro": 1e-8},
    "gyro_g_sensitivity": {"sub.gyro": 3e-8},
    "gyro_bias": {"sub.gyro": 1e-12},
    "gyro_temperature": {"sub.gyro": 1e-7},
    "gyro_bandwidth": {"sub.gyro": 1e-5},  # the noise is made louder
    "accel_bias": {"sub.accel": 1e-6},
    "accel_scale_factor": {"sub.accel": 0.2},
    "static_misalignment": {"sub.gyro": 1e-7, "sub.accel": 2.0, "phins_sub.attitude": 1e-6},
    "misalignment_step": {"sub.gyro": 1e-7, "sub.accel": 2.0, "phins_sub.attitude": 1e-6},
    "thermal_bending": {"sub.gyro": 1e-6, "sub.accel": 5.0, "phins_sub.attitude": 2e-6},
    "wave_forced_bending": {"sub.gyro": 3e-6, "sub.accel": 20.0, "phins_sub.attitude": 3e-6},
    "narrowband_vibration": {"sub.gyro": 1e-6},
    "phins_latency": {"phins_main.attitude": 2e-5, "phins_sub.attitude": 2e-5},
    "phins_attitude_error": {"phins_sub.attitude": 1e-6},
    "outliers": {"sub.gyro": 4e-6},
}
NOTHING_LEFT_OUT = {
    "sample_dropout", "gyro_bias_instability", "gyro_random_walk", "gyro_quantization", "flexure_parameters",
    "second_mode", "axis_coupling", "amplitude_stiffening", "slamming", "nonstationary_sea",
}  # fmt: skip


@pytest.fixture(scope="module")
def clean():
    return simulate(TWIN).trial


def effect(name, **changed):
    return effects.build(name, {**STRONG[name], **changed})


def with_effect(name, **changed):
    return simulate(make_twin({**WORLD, "effect": [table(name, **changed)]}))


def off(trial, clean, channel):
    """Root mean square on the worst axis of what tells a trial's channel from the clean one's, ends left out."""
    unit, quantity = channel.split(".")
    ours, theirs = getattr(trial, unit), getattr(clean, unit)
    if quantity == "attitude" and np.array_equal(ours.stamp, theirs.stamp):
        error = (Rotation.from_quat(ours.attitude) * Rotation.from_quat(theirs.attitude).inv()).as_rotvec()
    else:
        ours_at, theirs_at = ((s.stamp - clean.epoch) * 1e-9 for s in (ours, theirs))
        values = getattr(ours, quantity)
        error = np.stack([np.interp(theirs_at, ours_at, column) for column in values.T], -1) - getattr(theirs, quantity)
    rms = np.sqrt((error[300:-300] ** 2).mean(axis=0)).max()
    return rms / MICRO_G if quantity == "accel" else rms


@pytest.mark.parametrize("name", LEFT)
def test_the_effect_is_gone(name: str, clean) -> None:
    given = with_effect(name).trial
    freed = compensate(given, [effect(name)], TWIN)
    for channel, limit in LEFT[name].items():
        assert off(freed.trial, clean, channel) < limit
        assert off(given, clean, channel) > 4.0 * off(freed.trial, clean, channel)
    assert [note.split(":")[0] for note in freed.notes] == [name]
    assert "left in" not in freed.notes[0]


@pytest.mark.parametrize("name", sorted(NOTHING_LEFT_OUT))
def test_what_cannot_be_undone_is_left_as_it_was_and_said_so(name: str) -> None:
    given = with_effect(name).trial
    freed = compensate(given, [effect(name)], TWIN)
    assert freed.trial is given or all(
        getattr(freed.trial, unit) is getattr(given, unit) for unit in ("main", "sub", "phins_main", "phins_sub")
    )
    assert freed.notes[0].startswith(f"{name}: left in; ")


def test_every_effect_is_undone_or_said_to_be_left_in() -> None:
    elsewhere = {"gyro_saturation", "lever_arm", "heel_bending"}
    assert set(LEFT) | NOTHING_LEFT_OUT | elsewhere == set(effects.names())
    assert {name for name in effects.names() if effects.get(name).stays} == NOTHING_LEFT_OUT


def test_clipped_samples_become_gaps_and_the_others_stay(clean) -> None:
    given = with_effect("gyro_saturation").trial
    freed = compensate(given, [effect("gyro_saturation")], TWIN)
    same = np.isin(clean.sub.stamp, freed.trial.sub.stamp)
    assert 0.05 < same.mean() < 0.95
    np.testing.assert_array_equal(freed.trial.sub.gyro, clean.sub.gyro[same])
    assert f"{(~same).sum()} clipped samples" in freed.notes[0]


def test_outliers_are_found_and_nothing_else_is_touched(clean) -> None:
    given = with_effect("outliers").trial
    freed = compensate(given, [effect("outliers")], TWIN).trial
    wild = (given.sub.gyro != clean.sub.gyro).any(axis=1)
    touched = (freed.sub.gyro != given.sub.gyro).any(axis=1)
    assert wild.sum() > 20
    assert touched[wild].all()
    assert not touched[~wild].any()
    assert np.abs(freed.sub.gyro - clean.sub.gyro).max() < 2e-4


def test_a_slow_cutoff_is_left_alone() -> None:
    given = with_effect("gyro_bandwidth", cutoff=0.1).trial
    freed = compensate(given, [effect("gyro_bandwidth", cutoff=0.1)], TWIN)
    assert freed.trial.sub is given.sub
    assert "left in" in freed.notes[0]


def test_the_inverse_filter_stops_at_gaps(clean) -> None:
    given = with_effect("gyro_bandwidth").trial
    kept = np.ones(len(given.sub), bool)
    kept[3000:3100] = False
    sub = replace(given.sub, stamp=given.sub.stamp[kept], gyro=given.sub.gyro[kept], accel=given.sub.accel[kept])
    freed = compensate(replace(given, sub=sub), [effect("gyro_bandwidth")], TWIN).trial.sub
    error = freed.gyro - clean.sub.gyro[kept]
    assert np.sqrt((error[2900:3100] ** 2).mean(axis=0)).max() < 2e-5


def test_the_rigs_lever_arm_is_put_right() -> None:
    given = with_effect("lever_arm").trial
    freed = compensate(given, [effect("lever_arm")], TWIN)
    assert "the rig states no lever arm" in freed.notes[0]
    stated = replace(given, rig=replace(given.rig, lever_arm=np.array([-4.0, 40.0, 3.0])))
    freed = compensate(stated, [effect("lever_arm")], TWIN)
    np.testing.assert_allclose(freed.trial.rig.lever_arm, [-4.0, 40.5, 3.0])
    assert "left in" not in freed.notes[0]


def test_bending_by_heel_is_gone_once_its_lag_has_settled() -> None:
    world = {**WORLD, "run": {"duration": 240.0}, "ship": {"phase": [{"start": 120.0, "ramp": 30.0, "heading": 200.0}]}}
    twin = make_twin(world)
    a, b = (simulate(make_twin({**world, "effect": e})).trial for e in ([], [table("heel_bending")]))
    freed = compensate(b, [effect("heel_bending")], twin).trial
    late = slice(10000, 23500)
    error, was = (
        (Rotation.from_quat(x[late]) * Rotation.from_quat(a.phins_sub.attitude[late]).inv()).as_rotvec()
        for x in (freed.phins_sub.attitude, b.phins_sub.attitude)
    )
    assert np.abs(was).max() > 5 * ARCMIN
    assert np.abs(error).max() < 0.05 * ARCMIN


def test_bending_is_held_where_the_record_does_not_reach() -> None:
    t = np.linspace(0.0, 10.0, 201)
    spline = make_interp_spline(t, np.stack([np.sin(t), t, 1.0 - t], axis=1), k=5)
    held = bent.Bending(0, None, (), np.zeros(3), np.zeros(3), spline, (0.0, 10.0))  # type: ignore[arg-type]
    at = np.array([-5.0, 0.0, 4.0, 10.0, 15.0])
    np.testing.assert_allclose(held.bending(at)[:, 0], np.sin([0.0, 0.0, 4.0, 10.0, 10.0]), atol=1e-6)
    np.testing.assert_allclose(held.bending(at, 1)[:, 1], [0.0, 1.0, 1.0, 1.0, 0.0], atol=1e-6)


def test_several_effects_come_out_together(clean) -> None:
    names = ("outliers", "gyro_scale_factor", "time_delay", "wave_forced_bending", "accel_scale_factor")
    given = simulate(make_twin({**WORLD, "effect": [table(name) for name in names]})).trial
    freed = compensate(given, [effect(name) for name in names], TWIN)
    assert off(freed.trial, clean, "sub.gyro") < 1e-5
    assert off(freed.trial, clean, "sub.accel") < 250.0
    assert {note.split(":")[0] for note in freed.notes} == set(names)


def test_no_effects_leave_the_log_as_it_is(clean) -> None:
    freed = compensate(clean, [], TWIN)
    assert freed.trial == clean
    assert freed.notes == ()
    assert freed.bending is None


def answer(truth, total, static) -> Deformation:
    n = len(truth.stamp)
    unknown = Estimate(np.zeros(3), np.zeros(3))
    alignment = Alignment(np.eye(3), unknown, np.eye(3), Estimate(np.zeros(()), np.zeros(())))
    model = FlexureModel("none", np.ones(3), np.ones(3), np.ones(3), np.zeros((3, 3, 3)), np.zeros(3))
    return Deformation(
        "none", truth.stamp, total, static, total - static, np.tile(np.eye(3), (n, 1, 1)), alignment, model
    )


@pytest.mark.parametrize("name", ["static_misalignment", "misalignment_step", "thermal_bending", "wave_forced_bending"])
def test_bending_comes_back_into_the_answer(name: str) -> None:
    plain, bent = simulate(TWIN).truth, with_effect(name)
    freed = compensate(bent.trial, [effect(name)], TWIN)
    back = freed.restore(answer(plain, plain.total, plain.static_part))
    inner = slice(300, -300)
    assert np.abs(bent.truth.total - plain.total)[inner].max() > 1.0 * ARCMIN
    np.testing.assert_allclose(back.total[inner], bent.truth.total[inner], atol=0.03 * ARCMIN)
    np.testing.assert_allclose(back.static_part[inner], bent.truth.static_part[inner], atol=1e-9)


def test_the_log_to_score_against_keeps_the_bending(clean) -> None:
    given = with_effect("wave_forced_bending").trial
    freed = compensate(given, [effect("wave_forced_bending")], TWIN)
    assert freed.reference.phins_sub is given.phins_sub
    assert off(freed.trial, given, "phins_sub.attitude") > 1.0 * ARCMIN
