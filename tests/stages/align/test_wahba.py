from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.align.wahba import rotation_between


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
