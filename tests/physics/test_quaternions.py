import importlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import quaternions, rotations

RNG = np.random.default_rng(5)
VECTORS = RNG.normal(size=(200, 3)) * RNG.choice([1e-12, 1e-6, 1e-2, 1.0], (200, 1))


def test_exponential_product_and_logarithm_agree_with_scipy() -> None:
    other = VECTORS[::-1]
    product = quaternions.multiply(quaternions.exp(VECTORS), quaternions.exp(other))
    expected = Rotation.from_rotvec(VECTORS) * Rotation.from_rotvec(other)
    np.testing.assert_allclose(quaternions.log(product), expected.as_rotvec(), atol=2e-15, rtol=1e-12)


def test_small_logarithms_keep_their_relative_accuracy() -> None:
    small = np.array([[1e-9, -3e-12, 2e-16], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(quaternions.log(quaternions.exp(small)), small, rtol=1e-14)


def test_logarithm_is_the_short_way_round() -> None:
    q = quaternions.exp(np.array([[0.0, 0.0, 3.5]]))
    np.testing.assert_allclose(quaternions.log(q), [[0.0, 0.0, 3.5 - 2 * np.pi]], atol=1e-14)


def test_rotation_of_vectors_agrees_with_scipy() -> None:
    q, v = quaternions.exp(VECTORS), RNG.normal(size=(200, 3))
    np.testing.assert_allclose(quaternions.rotate(q, v), Rotation.from_quat(q).apply(v), atol=1e-14)
    np.testing.assert_allclose(quaternions.rotate(quaternions.conjugate(q), quaternions.rotate(q, v)), v, atol=1e-14)


def test_euler_angles_follow_the_convention_of_the_project() -> None:
    heading, pitch, roll = RNG.uniform(-1.2, 1.2, (3, 50))
    expected = rotations.from_euler(heading, pitch, roll)
    q = quaternions.from_euler(heading, pitch, roll)
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), expected, atol=1e-14)


def test_cross_product() -> None:
    a, b = RNG.normal(size=(2, 20, 3))
    np.testing.assert_allclose(quaternions.cross(a, b), np.cross(a, b), atol=1e-15)


def test_many_are_carried_as_few_are_whatever_their_shapes() -> None:
    importlib.import_module("numba")  # without it, few as these are carried by numpy
    n = quaternions.MANY
    q = quaternions.exp(RNG.normal(size=(n, 3)))
    v, one = RNG.normal(size=(n, 3)), quaternions.exp(np.array([0.3, -0.2, 0.9]))
    R = Rotation.from_quat(q)
    np.testing.assert_allclose(quaternions.rotate(q, v), R.apply(v), atol=1e-13)
    np.testing.assert_allclose(quaternions.rotate(q[::-1], v[0]), R[::-1].apply(v[0]), atol=1e-13)
    product = (R * Rotation.from_quat(one)).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(quaternions.multiply(q, one[None])).as_matrix(), product, atol=1e-13)
    np.testing.assert_allclose(quaternions.cross(v[::2], v[1::2]), np.cross(v[::2], v[1::2]), atol=1e-13)


def test_compiled_or_not_the_same_bits_come_out(monkeypatch: pytest.MonkeyPatch) -> None:
    importlib.import_module("numba")
    q, other = (quaternions.exp(RNG.normal(size=(quaternions.MANY, 3))) for _ in range(2))
    v = RNG.normal(size=(quaternions.MANY, 3))
    given = ((quaternions.multiply, q, other), (quaternions.rotate, q, v), (quaternions.cross, v, v[::-1]))
    compiled = [function(a, b) for function, a, b in given]
    monkeypatch.setattr(quaternions, "MANY", 1 << 60)
    for (function, a, b), expected in zip(given, compiled):
        np.testing.assert_array_equal(function(a, b), expected)
