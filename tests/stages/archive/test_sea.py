"""The sea by the ship's motion."""

from dataclasses import replace

import numpy as np
import pytest

from schemas.trial import ImuSeries, Trial
from stages.archive.sea import motion_of

T = np.arange(0, 600, 0.1)


def trial(gyro, accel):
    stamp = (T * 1e9).astype(np.int64)
    unit = ImuSeries(stamp, gyro, accel)
    return Trial(main=unit, sub=unit, epoch=0)


def moving():
    gyro = np.stack([0.02 * np.sin(T), 0.05 * np.sin(0.7 * T), 0.004 + 0 * T], axis=1)
    accel = np.stack([0 * T, 0 * T, 9.81 + 0.3 * np.sin(0.9 * T)], axis=1)
    return trial(gyro, accel)


def test_sines_have_their_amplitude_over_root_two():
    motion = motion_of(moving())
    np.testing.assert_allclose(motion.rate_std, np.array([0.02, 0.05, 0.0]) / np.sqrt(2), rtol=2e-3, atol=1e-12)
    assert motion.vertical_std == pytest.approx(0.3 / np.sqrt(2), rel=2e-3)
    assert motion.roughness == pytest.approx(np.hypot(0.02, 0.05) / np.sqrt(2), rel=2e-3)


def test_wild_samples_and_holes_change_little():
    still = moving()
    gyro = still.main.gyro.copy()
    gyro[100] = 50.0
    gyro[200] = np.nan
    motion = motion_of(replace(still, main=replace(still.main, gyro=gyro)))
    assert motion.rate_std[1] == pytest.approx(0.05 / np.sqrt(2), rel=0.02)
