"""Direct checks: stamps and values say exactly what was done to them, and nothing on an ordinary log."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from physics.units import ARCSEC, DEG
from schemas.trial import ImuSeries, Trial
from stages.decode import decode
from stages.diagnose import direct
from stages.diagnose.direct_stamps import even, index_of
from stages.diagnose.direct_values import lattice
from twin.config import EffectSpec, Twin

LOGS = Path(__file__).parents[4] / "shared" / "logs"
RATE, N = 100.0, 30_000


def series(seed, noise=1e-5):
    rng = np.random.default_rng(seed)
    t = np.arange(N) / RATE
    waves = np.stack([0.05 * np.sin(2 * np.pi * t / p + p) for p in (7.1, 9.3, 11.7)], axis=1)
    stamp = 1_700_000_000_000_000_000 + np.arange(N) * 10_000_000
    return ImuSeries(stamp, waves + noise * rng.standard_normal((N, 3)), np.tile([0.0, 0.0, 9.8], (N, 1)))


def trial(sub=None, main=None):
    main = main or series(1)
    return Trial(main=main, sub=sub or series(2), epoch=int(main.stamp[0]))


def without(one, lost):
    keep = np.setdiff1d(np.arange(N), lost)
    return replace(one, stamp=one.stamp[keep], gyro=one.gyro[keep], accel=one.accel[keep])


def findings(sub=None, main=None, twin=None):
    return {finding.name: finding for finding in direct.check(trial(sub, main), twin or Twin()).findings}


def test_an_ordinary_log_has_no_findings():
    checks = direct.check(trial(), Twin())
    assert checks.findings == ()
    assert "gyro_saturation" in checks.untestable
    assert np.array_equal(checks.masked.sub.stamp, trial().sub.stamp)


@pytest.mark.parametrize("std", [2e-5, 5e-4, 0.004, 0.01])
def test_jitter_of_any_size_is_measured_and_repaired(std):
    one = series(2)
    rng = np.random.default_rng(3)
    jittered = replace(one, stamp=np.sort(one.stamp + np.rint(std * 1e9 * rng.standard_normal(N)).astype(np.int64)))
    checks = direct.check(trial(jittered), Twin())
    found = {finding.name: finding for finding in checks.findings}
    assert set(found) == {"timestamp_jitter"}
    estimate = found["timestamp_jitter"].parameters["std"]
    assert abs(estimate.value - std) < max(3.0 * estimate.std, 0.02 * std)
    assert np.std(checks.masked.sub.stamp - one.stamp) < 0.1 * std * 1e9


def test_jitter_of_both_units_is_the_recorders():
    rng = np.random.default_rng(3)
    both = [replace(one, stamp=one.stamp + rng.integers(-300_000, 300_000, N)) for one in (series(1), series(2))]
    assert not findings(both[1], both[0])


def test_stamps_on_a_clock_that_drifts_are_no_jitter():
    one = series(2)
    drifting = replace(one, stamp=one.stamp[0] + np.rint((one.stamp - one.stamp[0]) * (1 + 2e-5)).astype(np.int64))
    assert not findings(drifting)


def test_even_stamps_keep_gaps_and_rate():
    one = without(series(2), np.arange(5000, 5100))
    jittered = one.stamp + np.random.default_rng(4).integers(-100_000, 100_000, len(one.stamp))
    assert np.abs(even(jittered) - one.stamp).max() < 30_000
    assert index_of(one.stamp)[-1] == N - 1


@pytest.mark.parametrize(("rate", "length"), [(0.1, 1), (0.1, 7), (0.03, 40)])
def test_dropout_is_counted(rate, length):
    rng = np.random.default_rng(5)
    count = round(rate * N / RATE)
    starts = rng.choice(np.arange(200, N - 200, 60), count, replace=False)
    found = findings(without(series(2), np.unique(starts[:, None] + np.arange(length))))
    assert set(found) == {"sample_dropout"}
    assert found["sample_dropout"].parameters["length"].value == length
    assert found["sample_dropout"].parameters["rate"].value == pytest.approx(count / 300.0, rel=0.02)
    assert found["sample_dropout"].evidence_nats > 14.0


def test_a_few_gaps_are_no_dropout():
    lost = np.concatenate([np.arange(4000, 4013), np.arange(12000, 12001), np.arange(20000, 20170)])
    found = findings(without(series(2), lost))
    assert "sample_dropout" not in found or found["sample_dropout"].evidence_nats < 14.0


def test_gaps_of_both_units_are_the_recorders():
    lost = np.concatenate([np.arange(k, k + 5) for k in range(1000, 29000, 700)])
    assert not findings(without(series(2), lost), without(series(1), lost))


@pytest.mark.parametrize("step", [1e-4, 0.01, 1.0, 30.0])
def test_the_step_of_quantised_increments_is_found(step):
    one = series(2)
    count = step * ARCSEC * RATE
    total = np.floor(np.cumsum(one.gyro, axis=0) / count)
    found = findings(replace(one, gyro=np.diff(total, axis=0, prepend=0.0) * count))
    assert set(found) == {"gyro_quantization"}
    assert found["gyro_quantization"].parameters["step"].value == pytest.approx(step, rel=1e-5)


def test_wild_samples_do_not_hide_a_lattice():
    one, rng = series(2), np.random.default_rng(12)
    count = 0.1 * ARCSEC * RATE
    gyro = np.diff(np.floor(np.cumsum(one.gyro, axis=0) / count), axis=0, prepend=0.0) * count
    wild = rng.choice(len(gyro), 20, replace=False)
    gyro[wild] += 1e-3 * rng.standard_normal((20, 3))
    found = findings(replace(one, gyro=gyro))
    assert found["gyro_quantization"].parameters["step"].value == pytest.approx(0.1, rel=1e-5)


def test_a_lattice_of_both_units_is_the_recorders():
    rounded = [replace(one, gyro=np.round(one.gyro, 7)) for one in (series(1), series(2))]
    assert not findings(rounded[1], rounded[0])


def test_numbers_without_a_lattice_have_none():
    assert lattice(np.random.default_rng(6).standard_normal(20_000)) == 0.0
    assert lattice(np.zeros(100)) == 0.0


def test_saturation_is_found_and_left_out():
    one = series(2)
    limit = 2.5 * DEG
    clipped = replace(one, gyro=np.clip(one.gyro, -limit, limit))
    checks = direct.check(trial(clipped), Twin())
    found = {finding.name: finding for finding in checks.findings}
    assert set(found) == {"gyro_saturation"}
    assert found["gyro_saturation"].parameters["limit"].value == pytest.approx(2.5)
    assert np.abs(checks.masked.sub.gyro).max() < limit
    assert "gyro_saturation" not in checks.untestable


def test_hidden_jitter_shows_as_noise_that_follows_the_ships_acceleration():
    one, rng = series(2, noise=2e-6), np.random.default_rng(7)
    slope = np.gradient(one.gyro, axis=0) * RATE
    slope = np.stack([np.convolve(column, np.ones(21) / 21.0, "same") for column in slope.T], axis=1)
    shaken = replace(one, gyro=one.gyro + slope * 3e-4 * rng.standard_normal((N, 1)))
    found = findings(shaken)
    assert set(found) == {"timestamp_jitter"}
    assert found["timestamp_jitter"].parameters["std"].value == pytest.approx(3e-4, rel=0.3)


def test_what_the_twin_says_itself_is_not_found_again():
    one = series(2)
    limit = 2.5 * DEG
    twin = Twin(effect=(EffectSpec(name="gyro_saturation", limit=2.5),))
    assert not findings(replace(one, gyro=np.clip(one.gyro, -limit, limit)), twin=twin)


def test_too_few_samples_are_told():
    short = replace(series(2), stamp=series(2).stamp[:100], gyro=series(2).gyro[:100], accel=series(2).accel[:100])
    assert set(direct.check(trial(short), Twin()).untestable) == set(direct.EFFECTS)


@pytest.mark.skipif(not LOGS.exists(), reason="logs of the independent generator are not here")
@pytest.mark.parametrize("name", ["random-sea-a", "random-sea-b", "idam-ship", "sliding-sim", "stalign-sim"])
def test_logs_of_an_independent_generator_have_no_findings(name):
    assert direct.check(decode(LOGS / f"{name}.mcap").trial, Twin()).findings == ()
