"""Samples that no estimate should lean on."""

import numpy as np

from stages.unfit import unfit

RATE = 50.0
T = np.arange(3000) / RATE


def unit(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A ship's rates and specific force, with noise."""
    rng = np.random.default_rng(seed)
    wave = np.stack([0.03 * np.sin(0.8 * T), 0.05 * np.sin(0.6 * T + 1.0), 0.02 * np.sin(0.5 * T + 2.0)], axis=1)
    return wave + 1e-4 * rng.standard_normal((len(T), 3)), 10.0 * wave + 1e-2 * rng.standard_normal((len(T), 3))


def test_a_sound_unit_has_none() -> None:
    assert not unfit(T, *unit()).any()


def test_clipped_samples_are_found_and_no_others() -> None:
    gyro, accel = unit()
    limit = 0.9 * np.abs(gyro[:, 1]).max()
    clipped = np.abs(gyro[:, 1]) > limit
    gyro[:, 1] = np.clip(gyro[:, 1], -limit, limit)
    assert np.array_equal(unfit(T, gyro, accel), clipped)


def test_a_coarse_gyro_at_rest_is_not_clipped() -> None:
    _, accel = unit()
    coarse = np.round(0.6 * np.random.default_rng(1).standard_normal((len(T), 3))) * 1e-3
    assert np.count_nonzero(unfit(T, np.clip(coarse, -1e-3, 1e-3), accel)) < 0.01 * len(T)


def test_dense_spikes_are_found_beside_each_other() -> None:
    gyro, accel = unit()
    rng = np.random.default_rng(2)
    rows = rng.choice(len(T) - 10, 200, replace=False) + 5
    gyro[rows, rng.integers(0, 3, 200)] += 0.2
    found = unfit(T, gyro, accel)
    assert found[rows].mean() > 0.94
    assert np.count_nonzero(found) < 1.2 * len(rows)


def test_lost_samples_are_not_taken_for_spikes_over_and_over() -> None:
    gyro, accel = unit()
    keep = np.arange(len(T)) % 25 != 7
    assert np.count_nonzero(unfit(T[keep], gyro[keep], accel[keep])) < 0.05 * len(T)


def test_the_callers_arrays_are_left_alone() -> None:
    gyro, accel = unit()
    gyro[::20] += 0.5
    before = gyro.copy(), accel.copy()
    unfit(T, gyro, accel)
    assert np.array_equal(gyro, before[0])
    assert np.array_equal(accel, before[1])
