"""Compiled recursions: what cannot be written as one array operation."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_BLOCK = 128  # samples a phasor is turned before it is computed afresh, so that rounding cannot grow


@njit(cache=True)
def linear_recursion(
    f: FloatArray, root: FloatArray, which: IntArray, start: FloatArray, noise: FloatArray
) -> FloatArray:
    """x[k+1] = f[which[k]] x[k] + root[which[k]] noise[k] for a state of two; path (n + 1, 2) from start (2,)."""
    path = np.empty((len(which) + 1, 2))
    path[0, 0], path[0, 1] = start[0], start[1]  # assigned whole it takes seconds to compile, for an error message
    for k in range(len(which)):
        a, b, x = f[which[k]], root[which[k]], path[k]
        u, v = noise[k, 0], noise[k, 1]
        path[k + 1, 0] = a[0, 0] * x[0] + a[0, 1] * x[1] + b[0, 0] * u + b[0, 1] * v
        path[k + 1, 1] = a[1, 0] * x[0] + a[1, 1] * x[1] + b[1, 0] * u + b[1, 1] * v
    return path


@njit(cache=True)
def harmonic_sum(amplitude: FloatArray, omega: FloatArray, phase: FloatArray, t: FloatArray) -> FloatArray:
    """sum_i a_i sin(w_i t + p_i) and its first two derivatives, (n, 3), at times t (n,) s.

    Blocks of evenly spaced times are served by turning a phasor, the others by sines and cosines one at a time.
    """
    out = np.zeros((len(t), 3))
    for first in range(0, len(t), _BLOCK):
        last = min(first + _BLOCK, len(t))
        step = _even_step(t[first:last])
        for i in range(len(amplitude)):
            a, w, p = amplitude[i], omega[i], phase[i]
            s, c = np.sin(w * t[first] + p), np.cos(w * t[first] + p)
            turn_s, turn_c = np.sin(w * step), np.cos(w * step)
            for k in range(first, last):
                if step == 0.0:
                    s, c = np.sin(w * t[k] + p), np.cos(w * t[k] + p)
                out[k, 0] += a * s
                out[k, 1] += a * w * c
                out[k, 2] -= a * w * w * s
                s, c = s * turn_c + c * turn_s, c * turn_c - s * turn_s
    return out


@njit(cache=True)
def _even_step(t: FloatArray) -> float:
    """The step of evenly spaced times, 0 where they are uneven (by more than 1e-11 s) or too few."""
    if len(t) < 2:
        return 0.0
    step = (t[-1] - t[0]) / (len(t) - 1)
    for k in range(len(t)):
        if abs(t[k] - t[0] - k * step) > 1e-11:
            return 0.0
    return step


@njit(cache=True)
def bridge_recursion(
    path: FloatArray, index: IntArray, chained: BoolArray, left: FloatArray, right: FloatArray, mu: float, b2: float,
    rule: FloatArray, noise: FloatArray,
) -> FloatArray:  # fmt: skip
    """States (n, 2) drawn between those of a unit Gauss-Markov path (m, 2), conditional on their neighbours.

    State k lies in the interval from path[index[k]] to path[index[k] + 1], left[k] after what comes before it (the
    state k - 1 where chained[k]) and right[k] before the end. With x = F1 before + n1 and after = F2 x + n2 it is drawn
    from K = Q1 F2^T (F2 Q1 F2^T + Q2)^-1 and the covariance in Joseph's form. rule: (2, j) Gauss-Legendre.
    """
    out = np.empty((len(index), 2))
    for k in range(len(index)):
        before, after = out[k - 1] if chained[k] else path[index[k]], path[index[k] + 1]
        a, b, c, d, p, q, r = _markov_step(left[k], mu, b2, rule)
        e, f, g, h, u, v, w = _markov_step(right[k], mu, b2, rule)
        x, y = a * before[0] + b * before[1], c * before[0] + d * before[1]
        c00, c01, c10, c11 = p * e + q * f, p * g + q * h, q * e + r * f, q * g + r * h  # Q1 F2^T
        s00, s01, s11 = e * c00 + f * c10 + u, e * c01 + f * c11 + v, g * c01 + h * c11 + w
        scale = 1.0 / (s00 * s11 - s01 * s01)
        k00, k01 = scale * (c00 * s11 - c01 * s01), scale * (c01 * s00 - c00 * s01)
        k10, k11 = scale * (c10 * s11 - c11 * s01), scale * (c11 * s00 - c10 * s01)
        kept = _sandwich(
            1.0 - k00 * e - k01 * g, -k00 * f - k01 * h, -k10 * e - k11 * g, 1.0 - k10 * f - k11 * h, p, q, r
        )
        more = _sandwich(k00, k01, k10, k11, u, v, w)
        top = np.sqrt(max(kept[0] + more[0], 0.0))
        low = (kept[1] + more[1]) / top if top > 0.0 else 0.0
        rest = np.sqrt(max(kept[2] + more[2] - low * low, 0.0))
        gap0, gap1 = after[0] - e * x - f * y, after[1] - g * x - h * y
        out[k, 0] = x + k00 * gap0 + k01 * gap1 + top * noise[k, 0]
        out[k, 1] = y + k10 * gap0 + k11 * gap1 + low * noise[k, 0] + rest * noise[k, 1]
    return out


@njit(cache=True)
def _sandwich(
    a: float, b: float, c: float, d: float, p: float, q: float, r: float
) -> tuple[float, float, float]:  # fmt: skip
    """The elements 00, 01, 11 of A Q A^T, A = (a b; c d), Q = (p q; q r)."""
    return (
        a * a * p + 2.0 * a * b * q + b * b * r,
        a * c * p + (a * d + b * c) * q + b * d * r,
        c * c * p + 2.0 * c * d * q + d * d * r,
    )


@njit(cache=True)
def _markov_step(
    h: float, mu: float, b2: float, rule: FloatArray
) -> tuple[float, float, float, float, float, float, float]:
    """F(h) row by row and Q(h) as 00, 01, 11, of a second-order Gauss-Markov process of unit variance."""
    g, g_dot = _impulse(h, mu, b2)
    a, b, c, d = g_dot + 2.0 * mu * g, g, -b2 * g, g_dot
    if max(np.sqrt(b2), 2.0 * mu) * h > 1.5:  # no cancellation any more
        lost = _sandwich(a, b, c, d, 1.0, 0.0, b2)
        return a, b, c, d, 1.0 - lost[0], -lost[1], b2 - lost[2]
    p, q, r = 0.0, 0.0, 0.0
    for j in range(rule.shape[1]):
        g, g_dot = _impulse(0.5 * h * (1.0 + rule[0, j]), mu, b2)
        weight = 0.5 * h * rule[1, j] * 4.0 * mu * b2
        p += weight * g * g
        q += weight * g * g_dot
        r += weight * g_dot * g_dot
    return a, b, c, d, p, q, r


@njit(cache=True)
def _impulse(t: float, mu: float, b2: float) -> tuple[float, float]:
    """g(t) = exp(-mu t) sin(lambda t)/lambda and its derivative, lambda^2 = b2 - mu^2 of either sign."""
    square = b2 - mu * mu
    rate, fall = np.sqrt(abs(square)), np.exp(-mu * t)
    if rate * t < 1e-3:
        x = square * t * t
        g = fall * t * (1.0 - x / 6.0 + x * x / 120.0)
        return g, fall * (1.0 - 0.5 * x + x * x / 24.0) - mu * g
    if square > 0.0:
        g = fall * np.sin(rate * t) / rate
        return g, fall * np.cos(rate * t) - mu * g
    slow, quick = np.exp((rate - mu) * t), np.exp(-(rate + mu) * t)
    g = 0.5 * (slow - quick) / rate
    return g, 0.5 * (slow + quick) - mu * g


@njit(cache=True)
def stiffening_excess(
    t: FloatArray, theta: FloatArray, damping: float, stiffness: float, gain: float, start: float
) -> FloatArray:
    """d (n,) with d'' + 2 mu d' + b^2 d = -b^2 g (theta + d)^3, d = start and d' = 0 at first; Heun's method."""
    out = np.empty(len(t))
    d, rate = start, 0.0
    out[0] = d
    for k in range(len(t) - 1):
        h = t[k + 1] - t[k]
        pull = -2.0 * damping * rate - stiffness * (d + gain * (theta[k] + d) ** 3)
        ahead, rate_ahead = d + h * rate, rate + h * pull
        pull_ahead = -2.0 * damping * rate_ahead - stiffness * (ahead + gain * (theta[k + 1] + ahead) ** 3)
        d += 0.5 * h * (rate + rate_ahead)
        rate += 0.5 * h * (pull + pull_ahead)
        out[k + 1] = d
    return out
