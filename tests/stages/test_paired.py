"""What the two units observed together, against worlds known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.errors import DataError
from schemas.trial import ImuSeries, Trial
from stages.paired import clean_unit, observe
from tests.stages.estimate.observed import expected_u, expected_z, observed, paired_of, step_mean, true_linearisation
from tests.stages.estimate.synthetic import EPOCH, World
from tests.twin.worlds import perfect
from twin import simulate

WORLDS = {
    "plain": World(),
    "late sub": World(delay=0.0731),
    "early sub": World(delay=-0.4),
    "large misalignment": World(static=np.array([2.0, -2.0, 0.8])),
    "sub slower, delay": World(rate=100.0, sub_rate=50.0, delay=0.0333),
    "clocks apart": World(drift=3e-5),
}
worlds = pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS.keys())


@worlds
def test_attitudes_show_the_flexure_and_nothing_else(world: World) -> None:
    obs, _ = observed(world)
    np.testing.assert_allclose(obs.z, expected_z(world, obs), atol=2e-9)
    assert obs.good.all()


@worlds
def test_relative_velocity_is_that_of_the_moving_lever_arm(world: World) -> None:
    obs, _ = observed(world)
    # u is about 1 m/s here; the tolerance is what means of 50 Hz samples leave.
    np.testing.assert_allclose(obs.u[1:], expected_u(world, obs), atol=5e-5)


def test_relative_velocity_converges_with_the_rate() -> None:
    errors = []
    for rate in (25.0, 50.0, 100.0):
        world = World(rate=rate)
        obs, _ = observed(world)
        errors.append(np.abs(obs.u[1:] - expected_u(world, obs)).max())
    assert errors[2] < 3e-7
    assert errors[0] > 4.0 * errors[1] > 16.0 * errors[2]


def test_geometry_of_the_steps() -> None:
    world = World(rate=100.0)
    obs, _ = observed(world)
    t = obs.t[obs.index]
    np.testing.assert_allclose(np.diff(t), 0.2, atol=1e-9)
    start = world.main(obs.t[:1])[0].inv()
    A = lambda x: (start * world.main(x)).as_matrix()  # noqa: E731
    np.testing.assert_allclose(obs.A_end, A(t), atol=1e-12)
    np.testing.assert_allclose(obs.A_start[1:], A(t)[:-1], atol=1e-12)
    np.testing.assert_allclose(obs.A_mid[1:], step_mean(A, obs), atol=1e-8)
    np.testing.assert_allclose(obs.omega[1:], step_mean(world.rate_m, obs), atol=1e-8)
    np.testing.assert_allclose(obs.centred, t - 0.5 * (obs.t[0] + obs.t[-1]), atol=1e-12)
    force = step_mean(lambda x: (start * world.main(x) * world.total(x)).apply(world.force("sub", x)), obs)
    # The likely force, not the measured one: what is as fast as noise counts as noise.
    np.testing.assert_allclose(obs.force_i[1:], force, atol=1e-3 * 9.81)
    np.testing.assert_allclose(obs.rate_m[1:-1], world.rate_m(t[1:-1]), atol=1e-4)


def test_a_perfect_twin_shows_its_truth() -> None:
    tables = {"run": {"duration": 40.0, "rate": 100.0}, "channels": {"phins": False}}
    mount = {"static_arcmin": [360.0, -180.0, 120.0], "lever_arm": [3.0, 12.0, 1.0], "time_delay": 0.08}
    simulation = simulate(perfect(**tables, mount=mount), np.random.default_rng(3))
    trial, truth = simulation.trial, simulation.truth
    total = Rotation.from_rotvec(truth.total)
    world = World(delay=0.08, static=truth.static_part[0], lever=np.array(mount["lever_arm"]))
    paired, at = paired_of(world, trial), true_linearisation(world, 0.0)
    obs = observe(paired, at)
    first = np.searchsorted(trial.seconds(trial.main.stamp), obs.t[0] - 1e-6)
    obs = observe(paired, replace(at, R_0=total[first].as_matrix()))
    expected = truth.dynamic_part[first : first + len(obs.t)]
    # A delay of whole samples needs no interpolation: what is left is rounding.
    np.testing.assert_allclose(obs.z, expected[obs.index], atol=1e-8)
    found = Rotation.from_quat(obs.total(np.zeros((len(obs.dt), 3)), np.zeros(len(obs.dt))))
    assert np.abs((found * total[first : first + len(obs.t)].inv()).as_rotvec()).max() < 1e-8


def test_total_takes_drift_and_delay_out_again() -> None:
    world = World(rate=100.0, delay=0.013)
    obs, at = observed(world, delay=0.011)
    wrong = Rotation.from_rotvec([2e-4, -1e-4, 3e-4])
    start, late = obs.t[:1], obs.t[:1] - 0.002
    obs = observe(paired_of(world), replace(at, R_0=(wrong * world.total(start)[0]).as_matrix()))
    # The path of the sub starts late by the delay that is not known: that is a drift too.
    missed = world.main(start) * world.total(start) * (world.main(late) * world.total(late)).inv()
    d = (wrong * (world.main(start).inv() * missed * world.main(start))).as_rotvec()
    steps = len(obs.dt)
    found = Rotation.from_quat(obs.total(np.tile(d, (steps, 1)), np.full(steps, 0.002)))
    error = (found * world.total(obs.t).inv()).as_rotvec()
    error = error[: obs.index[-1] + 1]  # rates are held beyond the last step
    assert np.abs(error).max() < 8e-6  # 2 ms of the flexure's own rate, and second order
    raw = Rotation.from_quat(obs.total(np.zeros((steps, 3)), np.zeros(steps)))
    assert np.abs((raw * world.total(obs.t).inv()).as_rotvec()).max() > 1e-4


def test_known_gyro_errors_are_taken_out() -> None:
    scale = 1e-4 * np.random.default_rng(1).standard_normal((3, 3))
    bias = np.array([1e-5, -3e-5, 2e-5])
    clean, _ = observed(World())
    spoilt, at = observed(World(gyro_bias=bias, scale=scale))
    corrected, _ = observed(World(gyro_bias=bias, scale=scale), gyro_bias=bias, scale=scale)
    assert np.abs(spoilt.z - clean.z).max() > 1e-4
    np.testing.assert_allclose(corrected.z, clean.z, atol=3e-7)  # (I + S)^-1 to first order
    assert at.gyro_bias.any() is np.False_


def without(series: ImuSeries, lost: np.ndarray) -> ImuSeries:
    return ImuSeries(series.stamp[~lost], series.gyro[~lost], series.accel[~lost])


def test_single_lost_samples_are_bridged_and_marked() -> None:
    world = World(rate=100.0)
    trial = world.trial()
    noise = 1e-4 * np.random.default_rng(6).standard_normal((len(trial.sub), 3))
    trial = replace(trial, sub=replace(trial.sub, gyro=trial.sub.gyro + noise, accel=trial.sub.accel + 100 * noise))
    lost = np.zeros(len(trial.sub), bool)
    lost[[333, 777, 1500]] = True
    obs = observe(paired_of(world, replace(trial, sub=without(trial.sub, lost))), true_linearisation(world, 0.01))
    clean = observe(paired_of(world, trial), true_linearisation(world, 0.01))
    assert clean.good.all()
    assert not obs.good[[333, 334, 777, 778, 1500, 1501]].any()
    assert np.count_nonzero(~obs.good) <= 9
    assert np.count_nonzero(obs.jump_s) == 3
    np.testing.assert_allclose(obs.jump_s[obs.jump_s > 0], 0.03, atol=0.011)
    seen = np.isfinite(obs.z[:, 0])
    np.testing.assert_allclose(obs.z[seen], clean.z[seen], atol=1e-5)
    assert 3 <= np.isnan(obs.u[1:]).all(axis=1).sum() <= 6


@pytest.mark.parametrize("which", ["sub", "main", "both"])
def test_a_gap_of_thirty_seconds_leaves_the_relative_attitude_near(which: str) -> None:
    """What happened in the gap is not known, but the deck did not bend by degrees."""
    world = World(rate=50.0, duration=90.0)
    trial = world.trial()
    lost = (trial.seconds(trial.sub.stamp) > 30.0) & (trial.seconds(trial.sub.stamp) < 60.0)
    if which != "main":
        trial = replace(trial, sub=without(trial.sub, lost))
    if which != "sub":
        trial = replace(trial, main=without(trial.main, lost))
    obs = observe(paired_of(world, trial), true_linearisation(world, 0.02))
    inside = (obs.t > 30.0) & (obs.t < 60.0)
    assert not obs.good[inside].any()
    assert obs.good[~inside].sum() >= (~inside).sum() - 4
    assert obs.jump_s.sum() == pytest.approx(30.0, abs=0.1)
    assert np.count_nonzero(obs.jump_s) == 1
    assert np.isnan(obs.z[(obs.t[obs.index] > 30.02) & (obs.t[obs.index] < 59.98)]).all()
    late = obs.t[obs.index] > 60.3
    assert np.abs(obs.z[late]).max() < 5.0 * np.abs(world.bend).max()
    assert np.isfinite(obs.u[late]).all()


def test_spikes_are_found_counted_and_bridged() -> None:
    rng = np.random.default_rng(4)
    world = World(rate=100.0, duration=60.0)
    trial = world.trial()
    gyro = trial.sub.gyro + 3e-5 * rng.standard_normal(trial.sub.gyro.shape)
    accel = trial.sub.accel + 1e-3 * rng.standard_normal(gyro.shape)
    where = np.array([200, 1000, 1003, 3000, 5500])
    spoilt_gyro, spoilt_accel = gyro.copy(), accel.copy()
    spoilt_gyro[where[:3], [0, 1, 2]] += [0.02, -0.1, 0.05]
    spoilt_accel[where[3:], [2, 0]] += [5.0, -1.0]
    clean, none = clean_unit(ImuSeries(trial.sub.stamp, gyro, accel), EPOCH)
    unit, found = clean_unit(ImuSeries(trial.sub.stamp, spoilt_gyro, spoilt_accel), EPOCH)
    assert (none, found) == (0, 5)
    np.testing.assert_array_equal(np.flatnonzero(unit.filled), where)
    np.testing.assert_allclose(unit.t, clean.t, atol=1e-12)
    np.testing.assert_allclose(unit.gyro, clean.gyro, atol=3e-4)


def test_waves_and_slamming_of_a_lively_ship_are_no_spikes() -> None:
    world = World(rate=100.0, duration=60.0, motion=np.radians([15.0, 20.0, 10.0]))
    t = np.arange(6000) / 100.0
    since = t % 7.0
    slam = 2.0 * (1.0 - np.exp(-since / 0.1)) ** 2 * np.exp(-since / 0.5) * np.sin(2 * np.pi * 3.0 * since)
    main = world.unit("main")
    accel = main.accel + 1e-3 * np.random.default_rng(1).standard_normal((6000, 3))
    accel[:, 2] += slam
    gyro = main.gyro + 1e-5 * np.random.default_rng(2).standard_normal((6000, 3))
    assert clean_unit(ImuSeries(main.stamp, gyro, accel), EPOCH)[1] == 0


def instantaneous(series: ImuSeries, world: World, name: str) -> ImuSeries:
    t = (series.stamp - EPOCH) * 1e-9
    e = 1e-3
    attitude = (lambda x: world.main(x) * world.total(x)) if name == "sub" else world.main
    gyro = (attitude(t - e).inv() * attitude(t + e)).as_rotvec() / (2 * e)
    return ImuSeries(series.stamp, gyro, world.force(name, t), instantaneous=True)


def test_instantaneous_samples_are_turned_into_means() -> None:
    world = World(rate=100.0)
    trial = Trial(
        instantaneous(world.unit("main"), world, "main"), instantaneous(world.unit("sub"), world, "sub"), EPOCH
    )
    obs = observe(paired_of(world, trial), true_linearisation(world, 0.01))
    np.testing.assert_allclose(obs.z, expected_z(world, obs), atol=2e-5)
    raw = replace(trial, main=replace(trial.main, instantaneous=False), sub=replace(trial.sub, instantaneous=False))
    taken = observe(paired_of(world, raw), true_linearisation(world, 0.01))
    np.testing.assert_allclose(obs.u[2:], expected_u(world, obs)[1:], atol=1e-5)
    assert np.abs(taken.u[2:] - expected_u(world, taken)[1:]).max() > 1e-3


def test_a_lost_instantaneous_sample_does_not_spoil_the_mean_after_it() -> None:
    world = World(rate=100.0)
    series = instantaneous(world.unit("sub"), world, "sub")
    lost = np.zeros(len(series), bool)
    lost[1000] = True
    whole, _ = clean_unit(series, EPOCH)
    gappy, _ = clean_unit(replace(without(series, lost), instantaneous=True), EPOCH)
    np.testing.assert_allclose(gappy.gyro, whole.gyro, atol=2e-5)


def test_units_that_hardly_overlap_are_refused() -> None:
    trial = World().trial()
    early = trial.seconds(trial.sub.stamp) < 16.0
    with pytest.raises(DataError, match="overlap"):
        observe(paired_of(World(), replace(trial, sub=without(trial.sub, early))), true_linearisation(World(), 0.0))


def test_a_piece_is_the_same_as_the_whole_there() -> None:
    world = World(duration=60.0, delay=0.02)
    paired = paired_of(world)
    part = paired.between(20.0, 45.0)
    assert part.main.t[0] == pytest.approx(20.0, abs=1e-6)
    assert part.main.t[-1] < 45.0
    obs = observe(part, true_linearisation(world, part.main.t[0]))
    np.testing.assert_allclose(obs.z, expected_z(world, obs), atol=2e-9)
