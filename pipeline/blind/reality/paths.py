"""Paths on even grids and what lies between the points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def _located(first: float, step: float, t: FloatArray, points: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Cell (n,) and the fraction of it (n,) at times t, inside the grid."""
    x = (t - first) / step
    cell = np.clip(x.astype(np.int64), 0, points - 2)
    return cell, x - cell


def quintic(table: FloatArray, first: float, step: float, t: FloatArray) -> FloatArray:
    """Value, rate and acceleration (m, 3, n) at times t (n,), from a table (m, 3, k) of the same three."""
    cell, x = _located(first, step, t, table.shape[2])
    scale = np.array([1.0, step, 0.5 * step * step])[None, :, None]
    left, right = table[:, :, cell] * scale, table[:, :, cell + 1] * scale
    a0, a1, a2 = left[:, 0], left[:, 1], left[:, 2]
    p, v, a = right[:, 0] - a0 - a1 - a2, right[:, 1] - a1 - 2.0 * a2, right[:, 2] - a2
    a3, a4, a5 = 10.0 * p - 4.0 * v + a, -15.0 * p + 7.0 * v - 2.0 * a, 6.0 * p - 3.0 * v + a
    value = a0 + x * (a1 + x * (a2 + x * (a3 + x * (a4 + x * a5))))
    rate = a1 + x * (2.0 * a2 + x * (3.0 * a3 + x * (4.0 * a4 + x * 5.0 * a5)))
    acceleration = 2.0 * a2 + x * (6.0 * a3 + x * (12.0 * a4 + x * 20.0 * a5))
    return np.stack([value, rate / step, acceleration / step**2], axis=1)


def cubic(value: FloatArray, rate: FloatArray, first: float, step: float, t: FloatArray) -> FloatArray:
    """Values (n, m) at times t (n,) from values and rates (k, m) on a grid."""
    cell, x = _located(first, step, t, len(value))
    x = x[:, None]
    y = 1.0 - x
    ends = y * y * (1.0 + 2.0 * x) * value[cell] + x * x * (1.0 + 2.0 * y) * value[cell + 1]
    return ends + step * (y * y * x * rate[cell] - x * x * y * rate[cell + 1])


def between(value: FloatArray, first: float, step: float, t: FloatArray) -> FloatArray:
    """Values (n, m) at times t (n,) from values (k, m) on a fine grid: Lagrange's cubic through four points."""
    cell, _ = _located(first, step, t, len(value))
    cell = np.clip(cell, 1, len(value) - 3)
    x = ((t - first) / step - cell)[:, None]
    a, b, c, d = (value[cell + k] for k in (-1, 0, 1, 2))
    return (
        -x * (x - 1.0) * (x - 2.0) / 6.0 * a
        + (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0 * b
        - (x + 1.0) * x * (x - 2.0) / 2.0 * c
        + (x + 1.0) * x * (x - 1.0) / 6.0 * d
    )
