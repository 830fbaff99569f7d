from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.trial import ImuSeries
from stages.align.tracks import tracks
from stages.align.wahba import rotation_between, search


@pytest.mark.parametrize("angle", [0.0, 0.1, 1.5, 3.1, np.pi])
def test_rotation_is_scipys_least_squares_rotation(angle: float) -> None:
    rng = np.random.default_rng(1)
    truth = Rotation.from_rotvec(angle * np.array([0.6, 0.0, 0.8]))
    second = rng.standard_normal((50, 3))
    first = truth.apply(second) + 0.1 * rng.standard_normal((50, 3))
    expected, _ = Rotation.align_vectors(first, second)
    rotation, gain = rotation_between(first.T @ second)
    assert np.allclose(rotation, expected.as_matrix(), atol=1e-12)
    assert np.isclose(gain, np.sum(first * expected.apply(second)))


def test_mirrored_vectors_still_give_a_proper_rotation() -> None:
    second = np.random.default_rng(2).standard_normal((50, 3))
    rotation, _ = rotation_between((-second).T @ second)
    assert np.isclose(np.linalg.det(rotation), 1.0)


@pytest.mark.parametrize("step", [0.1, 0.2])
@pytest.mark.parametrize("delay", [-1.02, 0.0, 0.37])
def test_search_finds_a_large_rotation_and_a_delay_together(step: float, delay: float) -> None:
    truth = Rotation.from_rotvec([1.5, -1.0, 2.0])
    t = 0.02 * np.arange(1, 3000)

    def rate(at: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(0.9 * at), np.cos(1.3 * at), 0.3 * np.sin(0.7 * at + 1.0)], axis=1)

    stamp = np.round(t * 1e9).astype(np.int64)
    rates = rate(t), truth.inv().apply(rate(t - delay))
    first, second = (tracks(ImuSeries(stamp, one, np.zeros_like(one)), 0, "x") for one in rates)
    found = search(first, second, 5.0, step)
    assert found is not None
    assert abs(found.delay - delay) < 0.01
    assert np.linalg.norm((Rotation.from_matrix(found.rotation) * truth.inv()).as_rotvec()) < 0.1
    assert found.correlation > 0.99
    assert not found.at_edge
