"""The PHINS beside an IMU: thinned attitudes, the stretch used, and what the rig profile states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.products import Status
from schemas.rig import Rig
from schemas.trial import ImuSeries
from stages.align import align
from stages.align.installation import LONGEST, best_excited, installation, thinned
from stages.align.tracks import GRID, tracks
from tests.stages.align.synthetic import ARCMIN, DEG, EPOCH, World, nanoseconds, sea, trial, unit

TURN = Rotation.from_rotvec(np.array([0.3, -0.5, 0.4]) * DEG)


def _turning(world: World, rate: float, duration: float = 120.0) -> tuple[ImuSeries, ImuSeries]:
    """IMU, and the PHINS turned against it by TURN, without noise."""
    imu = unit(world, "main", 0.0, duration, rate)
    return imu, replace(imu, attitude=(Rotation.from_quat(imu.attitude) * TURN).as_quat())


def test_thinned_rates_are_those_of_the_body_free_of_coning() -> None:
    t = GRID / 5.0 * np.arange(4000)
    cone, w = 3.0 * DEG, 2.0
    attitude = Rotation.from_rotvec(cone * np.stack((np.cos(w * t), np.sin(w * t), 0.0 * t), axis=1))
    found = thinned(nanoseconds(t), attitude.as_quat())
    assert np.allclose(np.diff(found.stamp), GRID * 1e9)
    # A cone's rate about its axis is constant: w (cos(cone) - 1), whatever the interval; increments alone miss part.
    expected = w * (np.cos(cone) - 1.0)
    plain = (Rotation.from_quat(attitude.as_quat()[:-5:5]).inv() * attitude[5::5]).as_rotvec()[:, 2] / GRID
    error = np.abs(found.gyro[5:-5, 2] - expected).max()
    assert error < 0.02 * np.abs(plain - expected).max()


@pytest.mark.parametrize("rate", [5.0, 20.0, 100.0])
def test_installation_is_exact_without_noise_at_any_rate(rate: float) -> None:
    imu, phins = _turning(World(sea(np.random.default_rng(1))), 100.0)
    every = round(100.0 / rate)
    slower = replace(
        phins,
        stamp=phins.stamp[::every],
        gyro=phins.gyro[::every],
        accel=phins.accel[::every],
        attitude=phins.attitude[::every],
    )
    found = installation(tracks(imu, EPOCH, "x"), slower, EPOCH, 0.1, "x")
    off = (Rotation.from_rotvec(found.value) * TURN.inv()).as_rotvec()
    assert found.status is Status.ESTIMATED
    assert np.abs(off).max() < 0.1 * ARCMIN


def test_attitudes_that_are_not_finite_are_left_out() -> None:
    imu, phins = _turning(World(sea(np.random.default_rng(1))), 20.0)
    attitude = phins.attitude.copy()
    attitude[::37] = np.nan
    found = installation(tracks(imu, EPOCH, "x"), replace(phins, attitude=attitude), EPOCH, 0.1, "x")
    assert np.abs(found.value - TURN.as_rotvec()).max() < 0.2 * ARCMIN
    attitude[2:] = np.nan
    none = installation(tracks(imu, EPOCH, "x"), replace(phins, attitude=attitude), EPOCH, 0.1, "x")
    assert none.status is Status.NOT_OBSERVABLE


def test_of_a_long_record_the_stretch_that_shows_all_angles_is_used() -> None:
    t = 0.1 * np.arange(1, 50_000)
    rolling = np.stack([0.0 * t, 8.0 * np.sin(0.7 * t), 0.0 * t], axis=1)
    pitching = np.stack([2.0 * np.sin(0.8 * t), 2.0 * np.sin(0.7 * t), 0.0 * t], axis=1)
    gyro = DEG * np.where((t > 2500.0)[:, None], pitching, rolling)
    found = tracks(ImuSeries(nanoseconds(t), gyro, np.zeros_like(gyro)), EPOCH, "x")
    (kept,) = best_excited(found, found)
    assert kept.start > 2480.0  # the first half has more motion, but about one axis
    assert LONGEST <= kept.end - kept.start < LONGEST + 5.0
    short = tracks(ImuSeries(nanoseconds(t[:9000]), gyro[:9000], np.zeros((9000, 3))), EPOCH, "x")
    assert best_excited(short, short) == short


def test_what_the_rig_profile_states_is_used_instead_of_an_estimate() -> None:
    world = World(sea(np.random.default_rng(2)))
    clean = trial(world, 60.0)
    _, phins = _turning(world, 20.0, 60.0)
    stated = Rotation.from_rotvec(np.array([1.0, -2.0, 3.0]) * DEG)
    rigged = replace(clean, phins_main=phins, phins_sub=phins, rig=Rig(installation_main=stated.as_matrix()))
    found = align(rigged)
    assert found.installation_main.status is Status.ESTIMATED
    assert "from the rig profile" in found.installation_main.reason
    assert np.allclose(found.installation_main.value, stated.as_rotvec())
    assert np.abs(found.installation_sub.value - TURN.as_rotvec()).max() < 0.2 * ARCMIN
    assert align(replace(rigged, phins_main=None, phins_sub=None)).installation_main is None
