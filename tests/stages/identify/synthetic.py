"""Autocorrelations of flexure whose truth is known, by routes that share nothing with the code under test."""

from collections.abc import Callable

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from physics import flexure
from stages.identify.autocorrelation import AxisCorrelation, sample_autocorrelation

T = 0.2
UNDERDAMPED = (0.1, 0.1**2 + 0.3**2, 1e-3)
CRITICAL = (0.2146, 0.2146**2, 1.745e-3)
OVERDAMPED = (0.4, 0.1, 6e-4)
AXES = (UNDERDAMPED, CRITICAL, OVERDAMPED)


def state_space_covariance(damping: float, stiffness: float, std: float, lags: int) -> np.ndarray:
    """E[dtheta_k dtheta_(k+n)], n = 0..lags, from the stationary covariance of (theta, theta') and its transition."""
    M = np.array([[0.0, 1.0], [-stiffness, -2.0 * damping]])
    forcing = np.diag([0.0, 4.0 * damping * stiffness * std**2])
    P = solve_continuous_lyapunov(M, -forcing)
    R = [(expm(M * T * n) @ P)[0, 0] for n in range(lags + 2)]
    return np.array([2.0 * R[n] - R[abs(n - 1)] - R[n + 1] for n in range(lags + 1)])


def exact(axis: tuple[float, float, float], lags: int = 125) -> AxisCorrelation:
    """The autocorrelation that an endless record would show."""
    R = state_space_covariance(*axis, lags)
    return AxisCorrelation(R[1:], np.full(lags, 18000.0), float(R[0]), T, 3600.0)


def sampled(axis: tuple[float, float, float], length: float, rng: np.random.Generator, lags: int) -> AxisCorrelation:
    """That of a simulated record."""
    theta, _ = flexure.sample(*axis, np.full(int(length / T), T), rng)
    R, pairs = sample_autocorrelation(np.diff(theta), lags)
    return AxisCorrelation(R[1:], pairs[1:], float(R[0]), T, length)


def misfit(found: np.ndarray, axis: tuple[float, float, float]) -> float:
    """Largest relative error of (mu, b^2, sigma)."""
    return float(np.max(np.abs(np.exp(found) / np.array(axis) - 1.0)))


def rms_from_truth(
    curve: Callable[[AxisCorrelation], np.ndarray], correlation: AxisCorrelation, truth: np.ndarray
) -> float:
    """RMS difference of a curve from the true autocorrelation, of its largest value."""
    return float(np.sqrt(np.mean((curve(correlation) - truth) ** 2)) / np.max(np.abs(truth)))
