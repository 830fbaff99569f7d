"""Replay: the twin on a log's motion, against the simulation the log came from."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics.units import DEG
from schemas.errors import DataError
from tests.twin.effects.worlds import STRONG, table
from tests.twin.worlds import PERFECT, perfect
from twin import make_twin, simulate
from twin.motion import ShipMotion
from twin.recorded import RecordedMotion
from twin.replay import Timeline, remembered, replay
from twin.sea import realise
from twin.world import STREAMS

MICRO_G = 9.80665e-6
ARCMIN = np.pi / 180 / 60
ROUGH = {
    "model": "spectrum", "roll_significant": 8.0, "pitch_significant": 3.0, "heave_significant": 2.0,
    "sway_significant": 1.0,
}  # fmt: skip
STIFF = {"std_arcmin": [0.0] * 3}
FAR = {"lever_arm": [-6.0, 40.0, 4.0]}
INNER = slice(500, -500)


def rms(values):
    return np.sqrt((values**2).mean(axis=0)).max()


def drop(series, *gaps):
    """The series without samples first..last-1."""
    kept = np.ones(len(series), bool)
    for first, last in gaps:
        kept[first:last] = False
    attitude = None if series.attitude is None else series.attitude[kept]
    return replace(
        series, stamp=series.stamp[kept], gyro=series.gyro[kept], accel=series.accel[kept], attitude=attitude
    )


def turned(a, b):
    return (Rotation.from_quat(a) * Rotation.from_quat(b).inv()).as_rotvec()


@pytest.fixture(scope="module", params=[{}, ROUGH], ids=["sines", "rough"])
def stiff(request):
    """A simulation without noise and flexure, its sensors' constant errors known to the twin, and its twin."""
    known = {
        "gyro_bias_dph": [3.0, -2.0, 1.0],
        "gyro_scale_ppm": [300.0, 0.0, -200.0],
        "gyro_nonorthogonality_arcsec": [60.0] * 6,
        "accel_bias_ug": [500.0] * 3,
    }
    imu = {"main": {**PERFECT, **known}, "sub": PERFECT}
    twin = perfect(run={"duration": 60.0}, sea=request.param, flexure=STIFF, mount=FAR, imu=imu)
    return simulate(twin), twin


def test_a_perfect_log_comes_back_as_it_was(stiff) -> None:
    simulation, twin = stiff
    trial = simulation.trial
    again = replay(twin, trial, np.random.default_rng(7))
    assert again.trial.main is trial.main
    assert rms((again.trial.sub.gyro - trial.sub.gyro)[INNER]) < 1e-8
    assert rms((again.trial.sub.accel - trial.sub.accel)[INNER]) < 1.0 * MICRO_G  # at a lever arm of 40 m
    for unit in ("phins_main", "phins_sub"):
        ours, theirs = getattr(again.trial, unit), getattr(trial, unit)
        assert rms(turned(ours.attitude, theirs.attitude)[INNER]) < 0.001 * ARCMIN
        assert rms((ours.gyro - theirs.gyro)[INNER]) < 1e-8
        assert rms((ours.accel - theirs.accel)[INNER]) < 1.0 * MICRO_G
    np.testing.assert_allclose(again.truth.total, simulation.truth.total, atol=1e-12)


def test_angular_acceleration_is_good_to_a_hundred_thousandth(stiff) -> None:
    simulation, twin = stiff
    streams = dict(zip(STREAMS, np.random.default_rng(twin.run.seed).spawn(len(STREAMS))))
    ship = ShipMotion(twin.ship, realise(twin.sea, streams["sea"]), (-10.0, 70.0))
    t = np.arange(6.0, 54.0, 0.0037)
    found, true = RecordedMotion(simulation.trial, twin, (0.0, 60.0)).at(t), ship.at(t)
    size = np.sqrt((true.omega_dot**2).mean())
    assert rms(found.omega_dot - true.omega_dot) < 2e-6 * size
    assert rms(found.omega - true.omega) < 1e-8
    assert rms(found.angles - true.angles) < 1e-6


def test_the_motion_without_phins_is_levelled_by_gravity() -> None:
    twin = perfect(run={"duration": 300.0}, sea=ROUGH, channels={"phins": False})
    trial = simulate(twin).trial
    streams = dict(zip(STREAMS, np.random.default_rng(twin.run.seed).spawn(len(STREAMS))))
    ship = ShipMotion(twin.ship, realise(twin.sea, streams["sea"]), (-10.0, 310.0))
    t = np.arange(5.0, 295.0, 0.1)
    error = RecordedMotion(trial, twin, (0.0, 300.0)).angles(t) - ship.angles(t)
    assert np.abs(error[:, :2]).max() < 0.5 * DEG


@pytest.mark.parametrize("offset", [0, 3_700_000], ids=["same stamps", "other stamps"])
def test_gaps_and_stamps_survive(stiff, offset: int) -> None:
    simulation, twin = stiff
    trial = simulation.trial
    sub = replace(trial.sub, stamp=trial.sub.stamp + offset)
    log = replace(trial, sub=drop(sub, (1000, 1001), (2000, 2150)), main=drop(trial.main, (3000, 3002)))
    again = replay(twin, log, np.random.default_rng(7)).trial
    np.testing.assert_array_equal(again.sub.stamp, log.sub.stamp)
    np.testing.assert_array_equal(again.main.stamp, log.main.stamp)
    if offset == 0:
        away = np.abs(again.seconds(again.sub.stamp) - 30.0) > 4.0  # where the main IMU's gap was bridged by a line
        error = again.sub.gyro - log.sub.gyro
        assert rms(error[away][INNER]) < 1e-8
        assert np.abs(error[INNER]).max() < 1e-4
        assert rms((again.sub.accel - log.sub.accel)[away][INNER]) < 1.0 * MICRO_G


def test_other_stamps_see_the_same_ship(stiff) -> None:
    """A sub-IMU that samples 3.7 ms later: its rates are those of the same motion, at other times."""
    simulation, twin = stiff
    trial = simulation.trial
    log = replace(trial, sub=replace(trial.sub, stamp=trial.sub.stamp + 3_700_000))
    again = replay(twin, log, np.random.default_rng(7)).trial
    t = trial.seconds(trial.sub.stamp)
    back = np.stack([np.interp(t, t + 3.7e-3, column) for column in again.sub.gyro.T], axis=-1)
    assert rms((back - trial.sub.gyro)[INNER]) < 1e-5


def test_the_twins_delay_and_clock_act_on_the_replay(stiff) -> None:
    twin = stiff[1]
    late = make_twin({**twin.model_dump(), "effect": [{"name": "time_delay", "delay": 0.02}]})
    trial = simulate(late).trial
    again = replay(late, trial, np.random.default_rng(7)).trial
    assert rms((again.sub.gyro - trial.sub.gyro)[INNER]) < 1e-8
    assert rms((replay(twin, trial, np.random.default_rng(7)).trial.sub.gyro - trial.sub.gyro)[INNER]) > 1e-4


def test_noise_is_drawn_anew_and_the_main_imus_is_no_motion() -> None:
    twin = make_twin({"run": {"duration": 60.0}, "flexure": STIFF, "mount": FAR})
    trial = simulate(twin).trial
    one, other = (replay(twin, trial, np.random.default_rng(seed)).trial.sub for seed in (11, 12))
    white = 0.001 * DEG / 60.0 * np.sqrt(100.0)
    assert (one.gyro - other.gyro).std() == pytest.approx(np.sqrt(2.0) * white, rel=0.03)
    # against the log: both sub-IMUs' noise, and the little of the main IMU's that lies within the ship's band
    assert (one.gyro - trial.sub.gyro)[INNER].std() == pytest.approx(np.sqrt(2.0) * white, rel=0.06)
    assert (one.accel - trial.sub.accel)[INNER].std() == pytest.approx(np.sqrt(2.0) * 100.0 * MICRO_G, rel=0.25)


@pytest.mark.parametrize("name", STRONG)
def test_every_effect_works_on_a_replay(name: str) -> None:
    plain, bad = (make_twin({"run": {"duration": 30.0}, "effect": e}) for e in ([], [table(name)]))
    trial = simulate(plain).trial
    without, with_effect = (replay(twin, trial, np.random.default_rng(3)) for twin in (plain, bad))
    series = {unit: (getattr(without.trial, unit), getattr(with_effect.trial, unit)) for unit in ("sub", "phins_sub")}
    differs = {
        (unit, key)
        for unit, (a, b) in series.items()
        for key in ("stamp", "gyro", "accel", "attitude")
        if not np.array_equal(getattr(a, key), getattr(b, key))
    }
    assert differs
    assert np.isfinite(with_effect.trial.sub.gyro).all()
    assert with_effect.twin is bad


def test_temperature_effects_follow_the_logs_thermometer() -> None:
    twin = make_twin({"run": {"duration": 30.0}, "effect": [{"name": "gyro_temperature", "slope": [10.0, 0.0, 0.0]}]})
    trial = simulate(twin).trial
    warm = replace(trial, temperature_sub=replace(trial.temperature_sub, value=trial.temperature_sub.value + 30.0))
    cold_x, warm_x = (replay(twin, log, np.random.default_rng(3)).trial.sub.gyro[:, 0] for log in (trial, warm))
    np.testing.assert_allclose(warm_x - cold_x, 300.0 * DEG / 3600.0, rtol=1e-5)


def test_channels_that_the_log_lacks_are_not_invented() -> None:
    twin = make_twin({"run": {"duration": 10.0}, "channels": {"phins": False, "gnss": False, "temperature": False}})
    trial = simulate(twin).trial
    again = replay(make_twin({"run": {"duration": 10.0}}), trial, np.random.default_rng(1)).trial
    assert again.phins_main is again.phins_sub is again.gnss is again.temperature_sub is None


def test_the_same_generator_draws_the_same() -> None:
    twin = make_twin({"run": {"duration": 10.0}})
    trial = simulate(twin).trial
    a, b = (replay(twin, trial, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(a.trial.sub.gyro, b.trial.sub.gyro)
    np.testing.assert_array_equal(a.truth.total, b.truth.total)


@pytest.mark.parametrize("effect", ["time_delay", "wave_forced_bending", "phins_latency", "heel_bending"])
def test_a_remembered_motion_changes_nothing(effect: str) -> None:
    twin = make_twin({"run": {"duration": 20.0}, "effect": [table(effect)]})
    trial = simulate(twin).trial
    ship = remembered(twin, trial)
    for seed in (1, 2):
        a, b = (replay(twin, trial, np.random.default_rng(seed), ship=given).trial for given in (None, ship))
        assert np.abs(a.sub.gyro - b.sub.gyro).max() < 1e-10
        assert np.abs(a.sub.accel - b.sub.accel).max() < 1e-7
        assert np.abs(turned(a.phins_sub.attitude, b.phins_sub.attitude)).max() < 1e-9


def test_what_is_too_long_to_remember_is_worked_out_anew(monkeypatch) -> None:
    twin = make_twin({"run": {"duration": 20.0}})
    trial = simulate(twin).trial
    short, whole = remembered(twin, trial), remembered(twin, trial)
    monkeypatch.setattr("twin.recorded.REMEMBERED", 10)
    a = replay(twin, trial, np.random.default_rng(1), ship=short).trial
    monkeypatch.undo()
    b = replay(twin, trial, np.random.default_rng(1), ship=whole).trial
    np.testing.assert_array_equal(a.sub.gyro, b.sub.gyro)


def test_a_log_that_hardly_measured_is_refused() -> None:
    trial = simulate(make_twin({"run": {"duration": 1.0}})).trial
    with pytest.raises(DataError, match="nothing to replay"):
        replay(make_twin({}), replace(trial, sub=drop(trial.sub, (5, 100))), np.random.default_rng(1))


def test_a_timeline_breaks_at_gaps() -> None:
    stamp = np.array([10, 20, 30, 60, 70]) * 1_000_000
    line = Timeline.of(stamp, 0)
    np.testing.assert_allclose(line.edge, [0.0, 0.01, 0.02, 0.03, 0.05, 0.06, 0.07], atol=1e-12)
    np.testing.assert_array_equal(line.kept, [1, 2, 3, 5, 6])
    np.testing.assert_allclose(line.nodes(3, 5, 2), [0.03, 0.04, 0.05, 0.055, 0.06], atol=1e-12)
