import numpy as np
import pytest

from physics.recursion import harmonic_sum, linear_recursion

A, W, P = np.array([0.2, 0.01]), np.array([0.8, 3.0]), np.array([0.3, -1.0])


def direct(t: np.ndarray) -> np.ndarray:
    x = np.outer(t, W) + P
    return np.stack([np.sin(x) @ A, np.cos(x) @ (A * W), -np.sin(x) @ (A * W * W)], axis=-1)


@pytest.mark.parametrize("start", [0.0, 7200.0])
def test_even_times_lose_nothing_to_the_turning_phasor(start: float) -> None:
    t = start + np.arange(100_003) * 0.005
    np.testing.assert_allclose(harmonic_sum(A, W, P, t), direct(t), atol=5e-12)


def test_uneven_times() -> None:
    t = np.sort(np.random.default_rng(1).uniform(-5, 50, 1000))
    np.testing.assert_allclose(harmonic_sum(A, W, P, t), direct(t), atol=1e-13)


def test_one_time_and_none() -> None:
    np.testing.assert_allclose(harmonic_sum(A, W, P, np.array([3.0])), direct(np.array([3.0])), atol=1e-14)
    assert harmonic_sum(A, W, P, np.zeros(0)).shape == (0, 3)


def test_linear_recursion_is_the_obvious_loop() -> None:
    rng = np.random.default_rng(2)
    f, root, which = rng.normal(size=(3, 2, 2)) * 0.5, rng.normal(size=(3, 2, 2)), rng.integers(0, 3, 50)
    start, noise = rng.normal(size=2), rng.normal(size=(50, 2))
    x, expected = start, [start]
    for k in range(50):
        x = f[which[k]] @ x + root[which[k]] @ noise[k]
        expected.append(x)
    np.testing.assert_allclose(linear_recursion(f, root, which, start, noise), expected, rtol=1e-12)
