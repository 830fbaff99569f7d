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
