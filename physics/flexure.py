"""Second-order Gauss-Markov flexure of one axis: theta'' + 2 mu theta' + b^2 theta = w, b^2 = mu^2 + lambda^2.

The white angular acceleration w has the two-sided spectral density q = 4 mu b^2 sigma^2, which makes sigma the
stationary standard deviation of theta (IDAM eq. 3, corrected). lambda^2 < 0 (overdamped) is allowed while b^2 > 0.
Units: mu 1/s, b^2 1/s^2, sigma rad, times s. The state is (theta, theta').
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_RULE, _SHORT_RULE = np.polynomial.legendre.leggauss(12), np.polynomial.legendre.leggauss(4)
_SHORT_STEP = 0.1  # b h up to which the short rule is exact to rounding: its error is of the order (b h)^8 / 8!
_LONG_STEP = 1.5  # b h beyond which the covariance comes from the stationary one, short of cancellation


def forcing(damping: float, stiffness: float, std: float) -> float:
    """q = 4 mu b^2 sigma^2, rad^2/s^3."""
    return 4.0 * damping * stiffness * std**2


def impulse_response(damping: float, stiffness: float, lag: FloatArray) -> tuple[FloatArray, FloatArray]:
    """g(t) = exp(-mu t) sin(lambda t)/lambda and its derivative, shapes of lag; lambda = 0 as the limit."""
    t = np.asarray(lag, dtype=float)
    rate = np.sqrt(complex(stiffness - damping**2))
    x = rate * t
    # exp(-mu t) is folded into both exponentials, so that overdamped axes cannot overflow
    plus, minus = np.exp((1j * rate - damping) * t), np.exp((-1j * rate - damping) * t)
    cosine = (0.5 * (plus + minus)).real
    ordinary = np.abs(x) > 1e-3
    ratio = ((plus - minus) / np.where(ordinary, 2j * rate if rate else 1.0, 1.0)).real
    series = np.exp(-damping * t) * t * (1.0 - (x * x).real / 6.0 + (x**4).real / 120.0)
    g = np.where(ordinary, ratio, series)
    return g, cosine - damping * g


def transition(damping: float, stiffness: float, step: FloatArray) -> FloatArray:
    """Exact transition F(h) (..., 2, 2) of the state (theta, theta') over steps h (...)."""
    g, g_dot = impulse_response(damping, stiffness, step)
    return np.stack(
        [np.stack([g_dot + 2.0 * damping * g, g], axis=-1), np.stack([-stiffness * g, g_dot], axis=-1)], axis=-2
    )


def stationary_covariance(stiffness: float, std: float) -> FloatArray:
    """diag(sigma^2, b^2 sigma^2), (2, 2)."""
    return np.diag([std**2, stiffness * std**2])


def noise_covariance(damping: float, stiffness: float, std: float, step: FloatArray) -> FloatArray:
    """Exact Q(h) = int_0^h F(s) diag(0, q) F(s)^T ds, (..., 2, 2), to rounding for steps short and long.

    Short steps by Gauss-Legendre quadrature (sums of positive terms: no cancellation in the h^3 term), long ones from
    the stationary covariance, P - F P F^T.
    """
    h = np.asarray(step, dtype=float)
    fast = max(np.sqrt(stiffness), 2.0 * damping)
    node, share = _SHORT_RULE if fast * np.max(h, initial=0.0) < _SHORT_STEP else _RULE
    response = np.stack(impulse_response(damping, stiffness, 0.5 * h[..., None] * (1.0 + node)), axis=-1)
    weight = 0.5 * h[..., None] * share * forcing(damping, stiffness, std)
    short = np.einsum("...k,...ki,...kj->...ij", weight, response, response)
    f, p = transition(damping, stiffness, h), stationary_covariance(stiffness, std)
    long = p - f @ p @ np.swapaxes(f, -1, -2)
    return np.where((fast * h > _LONG_STEP)[..., None, None], long, short)


def autocorrelation(damping: float, stiffness: float, std: float, lag: FloatArray) -> FloatArray:
    """R(tau) = sigma^2 (g' + 2 mu g)(|tau|), g the impulse response.

    The same as sigma^2 b/lambda exp(-mu tau) sin(lambda tau + atan(lambda/mu)): IDAM eq. 17, its factor put right.
    """
    g, g_dot = impulse_response(damping, stiffness, np.abs(lag))
    return std**2 * (g_dot + 2.0 * damping * g)


def spectrum(damping: float, stiffness: float, std: float, frequency: FloatArray) -> FloatArray:
    """Two-sided density of theta, rad^2/Hz, at frequencies in Hz: q / ((b^2 - w^2)^2 + 4 mu^2 w^2)."""
    w2 = (2.0 * np.pi * np.asarray(frequency, dtype=float)) ** 2
    return forcing(damping, stiffness, std) / ((stiffness - w2) ** 2 + 4.0 * damping**2 * w2)


def sample(
    damping: float, stiffness: float, std: float, step: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """A stationary path (theta, theta'), each (n + 1,), at instants apart by steps (n,) s, exact in distribution.

    theta being exact at every instant, so are its increments over the steps and the interval means of theta'.
    """
    from physics.recursion import linear_recursion

    size, which = np.unique(np.asarray(step, dtype=float), return_inverse=True)
    f = transition(damping, stiffness, size)
    root = cholesky(noise_covariance(damping, stiffness, std, size))
    start = np.sqrt(np.diag(stationary_covariance(stiffness, std))) * rng.standard_normal(2)
    path = linear_recursion(f, root, which, start, rng.standard_normal((len(which), 2)))
    return path[:, 0], path[:, 1]


def cholesky(covariance: FloatArray) -> FloatArray:
    """Lower factor of symmetric (..., 2, 2) matrices that may be zero."""
    a = np.sqrt(np.maximum(covariance[..., 0, 0], 0.0))
    b = np.divide(covariance[..., 1, 0], a, out=np.zeros_like(a), where=a > 0.0)
    c = np.sqrt(np.maximum(covariance[..., 1, 1] - b * b, 0.0))
    return np.stack([np.stack([a, np.zeros_like(a)], axis=-1), np.stack([b, c], axis=-1)], axis=-2)


def driven(damping: float, stiffness: float, step: float, moment: FloatArray) -> FloatArray:
    """theta (n,) of an axis at rest at first, under an angular acceleration (n,) held over each even step (s)."""
    from scipy.signal import lfilter

    f = transition(damping, stiffness, np.array(step))
    rest = np.linalg.solve(np.array([[0.0, 1.0], [-stiffness, -2.0 * damping]]), (f - np.eye(2)) @ np.array([0.0, 1.0]))
    # (I - f B) x = rest B w, B the step back: theta's share as a rational filter.
    numerator = [0.0, rest[0], f[0, 1] * rest[1] - f[1, 1] * rest[0]]
    denominator = [1.0, -np.trace(f), np.linalg.det(f)]
    return np.asarray(lfilter(numerator, denominator, moment))
