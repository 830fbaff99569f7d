"""Several axes at once, and instants put between others."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from physics import flexure, flexure_path
from physics.flexure_path import Axes

CORRELATION = np.array([[1.0, 0.7, 0.0], [0.7, 1.0, -0.4], [0.0, -0.4, 1.0]])
AXES = Axes(np.array([0.3, 0.1, 0.5]), np.array([1.0, 0.5, 0.25]), np.ones(3), CORRELATION)
FREE = Axes(AXES.damping, AXES.stiffness, AXES.std, np.eye(3))


def system():
    drift, noise = np.zeros((6, 6)), np.zeros((6, 6))
    for i in range(3):
        drift[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0, 1], [-AXES.stiffness[i], -2 * AXES.damping[i]]]
        for j in range(3):
            q = [flexure.forcing(AXES.damping[k], AXES.stiffness[k], 1.0) for k in (i, j)]
            noise[2 * i + 1, 2 * j + 1] = CORRELATION[i, j] * np.sqrt(q[0] * q[1])
    return drift, noise


def test_stationary_covariance_solves_lyapunov() -> None:
    drift, noise = system()
    expected = solve_continuous_lyapunov(drift, -noise)
    np.testing.assert_allclose(flexure_path.stationary_covariance(AXES), expected, atol=1e-12)


def test_start_and_path_have_that_covariance() -> None:
    paths = [flexure_path.draw(AXES, np.full(100, 0.04), np.random.default_rng(k)) for k in range(500)]
    states = np.stack(paths)  # (draws, axis, instant, 2)
    expected = flexure_path.stationary_covariance(AXES)
    for instant in (0, 100):
        found = np.cov(states[:, :, instant].reshape(500, 6).T)
        np.testing.assert_allclose(found, expected, atol=0.22)


def test_a_longer_path_begins_with_the_shorter() -> None:
    short, long = (flexure_path.draw(AXES, np.full(n, 0.01), np.random.default_rng(1)) for n in (50, 500))
    np.testing.assert_array_equal(long[:, :51], short)


@pytest.mark.parametrize("share", [0.001, 0.3, 0.5, 0.999])
def test_between_is_the_conditional_law(share: float) -> None:
    h, n = 0.4, 20_000
    t = np.arange(2 * n) * h
    path = np.zeros((3, 2 * n, 2))
    path[:, 1::2] = [0.7, -0.2]  # the same ends around every other instant put in between
    at = t[:-1:2] + share * h
    found = flexure_path.between(FREE, t, path, at, np.random.default_rng(2))
    for axis in range(3):
        drift = system()[0][2 * axis : 2 * axis + 2, 2 * axis : 2 * axis + 2]
        p = np.diag([1.0, AXES.stiffness[axis]])
        left, mid, right = expm(drift * 0.0) @ p, expm(drift * share * h), expm(drift * h)
        later = expm(drift * (1 - share) * h)
        joint = np.block(
            [[left, p @ mid.T, p @ right.T], [mid @ p, p, p @ later.T], [right @ p, later @ p, p]]
        )  # states at the left end, between, at the right end
        known, wanted = [0, 1, 4, 5], [2]
        gain = joint[np.ix_(wanted, known)] @ np.linalg.inv(joint[np.ix_(known, known)])
        mean = (gain @ [0.0, 0.0, 0.7, -0.2])[0]
        variance = (joint[np.ix_(wanted, wanted)] - gain @ joint[np.ix_(known, wanted)])[0, 0]
        std = np.sqrt(max(variance, 0.0))
        assert found[axis].mean() == pytest.approx(mean, abs=4 * std / np.sqrt(n) + 1e-9)
        assert found[axis].std() == pytest.approx(std, rel=0.03, abs=1e-7)


def test_two_between_the_same_ends_belong_together() -> None:
    t, n = np.arange(40_000) * 0.4, 19_999
    path = flexure_path.draw(FREE, np.diff(t), np.random.default_rng(3))
    at = np.sort(np.concatenate([t[:-1:2][:n] + 0.1, t[:-1:2][:n] + 0.12]))
    found = flexure_path.between(FREE, t, path, at, np.random.default_rng(4))
    step = found[:, 1::2] - found[:, ::2]
    variance = 2.0 * (1.0 - flexure.autocorrelation(AXES.damping[1], AXES.stiffness[1], 1.0, np.array([0.02]))[0])
    assert (step[1] ** 2).mean() == pytest.approx(variance, rel=0.06)
    assert found.std(axis=1) == pytest.approx(1.0, rel=0.05)
