"""Align against trials whose misalignment and delay are exact by construction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.errors import DataError
from schemas.products import Alignment, Status
from schemas.trial import ImuSeries, Trial
from stages.align import align
from tests.stages.align import synthetic
from tests.stages.align.synthetic import ARCMIN, DEG, World, error, lines, noisy, sea, trial, unit

MOUNT = Rotation.from_rotvec(np.array([0.3, -0.2, 0.5]) * DEG)
LEVER = np.array([3.0, 20.0, 1.0])


@cache
def world(seed: int = 1, delay: float = 0.075, mount_deg: tuple[float, float, float] = (6.0, 3.0, 2.0)) -> World:
    rng = np.random.default_rng(seed)
    mount = Rotation.from_rotvec(np.array(mount_deg) * DEG)
    return World(sea(rng), synthetic.flexure(rng, count=300), mount, delay, LEVER)


@cache
def usual() -> Trial:
    return trial(world())


def assert_within(found: Alignment, truth: World, sigmas: float = 4.0) -> None:
    assert found.static.status is Status.ESTIMATED, found.static.reason
    assert np.all(np.abs(error(found.rotation, truth.mount)) < sigmas * found.static.std)
    assert abs(found.time_delay.value - truth.delay) < sigmas * found.time_delay.std


def kept(series: ImuSeries, mask: np.ndarray) -> ImuSeries:
    return replace(series, stamp=series.stamp[mask], gyro=series.gyro[mask], accel=series.accel[mask])


def test_without_flexure_rotation_and_delay_are_exact_to_the_interpolation() -> None:
    rigid = World(sea(np.random.default_rng(3)), None, MOUNT, 0.0374, None)
    found = align(trial(rigid, 120.0, 50.0))
    assert np.abs(error(found.rotation, rigid.mount)).max() < 0.01 * ARCMIN
    assert abs(found.time_delay.value - 0.0374) < 1e-5


@pytest.mark.parametrize("delay", [-0.8, -0.0123, 0.0, 0.075, 0.98])
def test_delay_of_either_sign_is_found_within_its_std(delay: float) -> None:
    truth = world(delay=delay)
    found = align(trial(truth))
    assert_within(found, truth)
    assert found.time_delay.std < 2e-3


@pytest.mark.parametrize("mount", [(98.0, -98.0, 98.0), (0.0, 0.0, 180.0), (90.0, 0.0, 0.0)])
def test_misalignment_of_any_size(mount: tuple[float, float, float]) -> None:
    truth = world(mount_deg=mount)
    assert_within(align(trial(truth)), truth)


def test_static_value_is_the_rotation_vector_and_std_the_covariance_diagonal() -> None:
    found = align(usual())
    assert np.allclose(Rotation.from_rotvec(found.static.value).as_matrix(), found.rotation)
    assert np.allclose(np.diag(found.covariance), found.static.std**2)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_units_of_different_rates_and_biases_of_mems_grade() -> None:
    truth, rng = world(), np.random.default_rng(5)
    mixed = trial(truth, rate=10.0, sub_rate=50.0)
    mixed = replace(
        mixed,
        main=noisy(mixed.main, rng, 0.3, (200.0, -150.0, 90.0)),
        sub=noisy(mixed.sub, rng, 0.3, (-80.0, 200.0, -200.0)),
    )
    assert_within(align(mixed), truth)


def test_gaps_jitter_and_missing_samples_do_not_disturb() -> None:
    rng, clean = np.random.default_rng(6), usual()
    n = len(clean.main)
    seconds = np.arange(n) / 20.0
    main = kept(clean.main, (rng.random(n) > 0.02) & ~((seconds > 90.0) & (seconds < 101.0)))
    sub = kept(clean.sub, (rng.random(n) > 0.02) & (seconds > 12.0) & (seconds < 280.0))
    jitter = (rng.uniform(-1e-3, 1e-3, len(sub)) * 1e9).astype(np.int64)
    found = align(replace(clean, main=main, sub=replace(sub, stamp=sub.stamp + jitter)))
    assert_within(found, world())


def test_spikes_and_non_finite_samples_are_shrugged_off() -> None:
    rng, clean = np.random.default_rng(7), usual()
    gyro = clean.sub.gyro.copy()
    hit = rng.random(len(gyro)) < 0.005
    gyro[hit] += rng.choice([-1.0, 1.0], (hit.sum(), 3)) * 20.0 * DEG
    gyro[rng.random(len(gyro)) < 0.002] = np.nan
    before = gyro.copy()
    found = align(replace(clean, sub=replace(clean.sub, gyro=gyro)))
    assert_within(found, world())
    reference = align(clean)
    assert np.abs(error(found.rotation, Rotation.from_matrix(reference.rotation))).max() < 0.5 * ARCMIN
    assert np.array_equal(gyro, before, equal_nan=True)


def test_turning_about_the_vertical_alone_leaves_heading_not_observable() -> None:
    yaw = World(lines([(2, 5.0, 9.0, 0.0), (2, 2.0, 6.0, 50.0)]), None, MOUNT, 0.05)
    found = align(_with_noise(trial(yaw, 200.0), 0.1))  # the earth rate, turned by the yaw, drowns in this noise
    assert found.static.status is Status.NOT_OBSERVABLE
    assert "one axis" in found.static.reason
    assert found.static.std[2] > 30 * DEG > 30.0 * found.static.std[:2].max()
    assert abs(found.time_delay.value - 0.05) < 5 * found.time_delay.std < 5e-3


def test_rolling_alone_rests_on_gravity_and_is_weak() -> None:
    roll = World(lines([(1, 5.0, 9.0, 0.0), (1, 2.0, 6.0, 50.0)]), None, MOUNT, 0.05)
    rolling = _with_noise(trial(roll, 200.0))
    found = align(rolling)
    assert found.static.status is Status.WEAK
    assert "gravity" in found.static.reason
    assert np.all(np.abs(error(found.rotation, roll.mount)) < 4.0 * found.static.std)
    rolling = _with_noise(rolling, 0.1)  # else the earth rate, turned by the roll, would show the angle
    blind = [replace(series, accel=np.zeros_like(series.accel)) for series in (rolling.main, rolling.sub)]
    without = align(replace(rolling, main=blind[0], sub=blind[1]))
    assert without.static.status is Status.NOT_OBSERVABLE
    assert without.static.std[1] > 30.0 * DEG


def test_calm_sea_is_refused_with_tilt_from_gravity() -> None:
    still = World(lines([(1, 1e-4, 9.0, 0.0)]), None, MOUNT, 0.05)
    found = align(_with_noise(trial(still, 200.0), 0.05))
    assert found.static.status is Status.NOT_OBSERVABLE
    assert found.time_delay.status is Status.NOT_OBSERVABLE
    assert found.time_delay.value == 0.0
    assert np.all(np.abs(error(found.rotation, MOUNT)[:2]) < 4.0 * found.static.std[:2])
    assert np.array_equal(found.static_phases.shape, (1, 2))


def test_tilt_from_gravity_is_no_better_than_the_accelerometers_of_coarse_gyros() -> None:
    still = trial(World(lines([(1, 1e-4, 9.0, 0.0)]), None, MOUNT, 0.0), 100.0)
    gyro, accel = np.array([200.0, -150.0, 180.0]) * DEG / 3600.0, np.array([0.1, -0.1, 0.05])  # 10 mg with 200 deg/h
    sub = replace(still.sub, gyro=still.sub.gyro + gyro, accel=still.sub.accel + accel)
    found = align(_with_noise(replace(still, sub=sub), 0.3))
    assert np.all(np.abs(error(found.rotation, MOUNT)[:2]) < 3.0 * found.static.std[:2])


def test_circular_motion_does_not_promise_delay_apart_from_heading() -> None:
    conical = World(lines([(0, 1.0, 8.0, 0.0), (1, 1.0, 8.0, 90.0)]), None, MOUNT, 0.3)
    found = align(_with_noise(trial(conical, 200.0)))
    off = abs(error(found.rotation, MOUNT)[2]), abs(found.time_delay.value - 0.3)
    assert off[0] < 4.0 * found.static.std[2]
    assert off[1] < 4.0 * found.time_delay.std


def _with_noise(clean: Trial, arw: float = 0.003) -> Trial:
    rng = np.random.default_rng(8)
    return replace(clean, main=noisy(clean.main, rng, arw), sub=noisy(clean.sub, rng, arw))


def test_a_dead_frozen_or_foreign_sub_unit_is_bad_data() -> None:
    clean = usual()
    frozen = replace(clean.sub, gyro=np.full_like(clean.sub.gyro, 0.01))
    with pytest.raises(DataError, match="frozen"):
        align(replace(clean, sub=frozen))
    dead = replace(clean.sub, gyro=1e-5 * np.random.default_rng(9).standard_normal(clean.sub.gyro.shape))
    with pytest.raises(DataError, match="do not move together"):
        align(replace(clean, sub=dead))
    foreign = unit(World(sea(np.random.default_rng(99), period=6.0)), "main", 0.0, 300.0, 20.0)
    with pytest.raises(DataError, match="do not move together"):
        align(replace(clean, sub=foreign))


def test_records_without_a_common_stretch_are_bad_data() -> None:
    clean = usual()
    late = replace(clean.sub, stamp=clean.sub.stamp + 1000 * 10**9)
    with pytest.raises(DataError, match="share no"):
        align(replace(clean, sub=late))
    with pytest.raises(DataError):
        align(replace(clean, sub=kept(clean.sub, np.arange(len(clean.sub)) < 3)))


def test_delay_beyond_the_search_is_said_to_lie_at_its_edge() -> None:
    found = align(trial(world(delay=1.6)))
    assert found.time_delay.status is not Status.ESTIMATED
    assert any("edge of the search" in note for note in found.notes)


def test_static_phase_is_found_between_two_under_way() -> None:
    clean = usual()
    seconds = clean.seconds(clean.main.stamp)
    still = (seconds > 100.0) & (seconds < 180.0)
    main, sub = (replace(u, gyro=np.where(still[:, None], 1e-2 * u.gyro, u.gyro)) for u in (clean.main, clean.sub))
    phases = align(replace(clean, main=main, sub=sub)).static_phases
    assert phases.shape == (1, 2)
    assert np.abs(phases[0] - [100.0, 180.0]).max() < 5.0


@pytest.mark.parametrize("turn_deg", [(-0.041, 0.43, -0.25), (4.0, -5.0, 3.0), (0.0, 0.0, 170.0)])
def test_phins_installation_from_attitude_increments(turn_deg: tuple[float, float, float]) -> None:
    rng, clean = np.random.default_rng(10), usual()
    turn = Rotation.from_rotvec(np.array(turn_deg) * DEG)
    truth = unit(world(), "main", 0.0, 300.0, 20.0)
    white = Rotation.from_rotvec(0.06 * ARCMIN * rng.standard_normal((len(truth), 3)))
    attitude = (Rotation.from_quat(truth.attitude) * turn * white).as_quat()
    phins = replace(truth, attitude=attitude)
    found = align(replace(clean, phins_main=phins))
    assert found.installation_sub is None
    estimate = found.installation_main
    assert estimate.status is Status.ESTIMATED
    assert estimate.std.max() < 0.6 * ARCMIN
    off = (Rotation.from_rotvec(estimate.value) * turn.inv()).as_rotvec()
    assert np.all(np.abs(off) < 4.0 * estimate.std)


def test_phins_without_attitude_is_not_observable_and_no_error() -> None:
    clean = usual()
    found = align(replace(clean, phins_sub=clean.sub))
    assert found.installation_sub.status is Status.NOT_OBSERVABLE


@pytest.mark.slow
def test_standard_deviations_are_honest_over_seeds() -> None:
    ratios = []
    for seed in range(24):
        truth = world(seed=100 + seed, delay=0.01 * (seed - 12))
        found = align(trial(truth, 240.0, 10.0))
        errors = np.append(error(found.rotation, truth.mount), found.time_delay.value - truth.delay)
        ratios.append(errors / np.append(found.static.std, found.time_delay.std))
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert np.all((rms > 0.6) & (rms < 1.5)), rms
