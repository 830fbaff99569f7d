"""Compiled recursions: what cannot be written as one array operation."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BLOCK = 128  # samples a phasor is turned before it is computed afresh, so that rounding cannot grow


@njit(cache=True)
def linear_recursion(
    f: FloatArray, root: FloatArray, which: IntArray, start: FloatArray, noise: FloatArray
) -> FloatArray:
    """x[k+1] = f[which[k]] x[k] + root[which[k]] noise[k] for a state of two; path (n + 1, 2) from start (2,)."""
    path = np.empty((len(which) + 1, 2))
    path[0] = start
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
    path: FloatArray, index: IntArray, chained: IntArray, left: FloatArray, right: FloatArray, root: FloatArray,
    noise: FloatArray,
) -> FloatArray:  # fmt: skip
    """States (n, 2) x[k] = left[k] before + right[k] path[index[k] + 1] + root[k] noise[k] within a path (m, 2).

    before is path[index[k]], or x[k - 1] where chained[k] is not zero (two in one interval).
    """
    out = np.empty((len(index), 2))
    for k in range(len(index)):
        before = out[k - 1] if chained[k] else path[index[k]]
        after = path[index[k] + 1]
        for i in range(2):
            drawn = root[k, i, 0] * noise[k, 0] + root[k, i, 1] * noise[k, 1]
            led = left[k, i, 0] * before[0] + left[k, i, 1] * before[1]
            out[k, i] = drawn + led + right[k, i, 0] * after[0] + right[k, i, 1] * after[1]
    return out


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
