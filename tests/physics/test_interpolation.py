"""Attitude between samples: exact on them, on the shortest arc between them, nowhere in a gap."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from physics.interpolation import bracket, slerp, slerp_quaternions, usual_interval


def test_agrees_with_scipy_between_samples():
    rng = np.random.default_rng(1)
    stamp = (np.arange(50) * 10**7 + rng.integers(0, 10**6, 50)).astype(np.int64)
    rotation = Rotation.from_rotvec(rng.standard_normal((50, 3)))
    at = np.sort(rng.integers(stamp[0], stamp[-1], 200)).astype(np.int64)
    found, valid = slerp(stamp, rotation, at)
    assert valid.all()
    expected = Slerp(stamp.astype(float), rotation)(at.astype(float))
    assert (found * expected.inv()).magnitude().max() < 1e-9


def test_equal_stamps_give_the_samples_untouched():
    rotation = Rotation.from_rotvec(np.random.default_rng(2).standard_normal((10, 3)))
    stamp = np.arange(10, dtype=np.int64) * 10
    found, valid = slerp_quaternions(stamp, rotation.as_quat(), stamp[2:7])
    assert valid.all()
    np.testing.assert_array_equal(found, rotation.as_quat()[2:7])


@pytest.mark.parametrize(
    ("at", "ok"), [(-1, False), (0, True), (15, True), (30, True), (31, False), (60, False), (70, True)]
)
def test_before_after_and_in_a_gap_there_is_nothing(at, ok):
    stamp = np.array([0, 10, 20, 30, 70, 80], dtype=np.int64)
    assert bracket(stamp, np.array([at]))[2][0] == ok
    assert not bracket(stamp, np.array([81]))[2][0]


def test_a_single_sample_is_valid_at_itself_alone():
    valid = bracket(np.array([5], dtype=np.int64), np.array([4, 5, 6]))[2]
    np.testing.assert_array_equal(valid, [False, True, False])


@pytest.mark.parametrize("jitter", [0, 1, 400])
@pytest.mark.parametrize("n", [2, 3, 10, 11, 1000])
def test_usual_interval_is_the_median_however_it_is_found(n, jitter):
    rng = np.random.default_rng(n + jitter)
    stamp = np.cumsum(1000 + rng.integers(-jitter, jitter + 1, n)).astype(np.int64)
    stamp[n // 2 :] += 70_000
    assert usual_interval(stamp) == np.median(np.diff(stamp))
