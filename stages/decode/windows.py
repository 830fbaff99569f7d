"""Means over short windows without gaps: what the plausibility checks compare."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schemas.rig import FloatArray
from schemas.trial import IntArray

WINDOW_S = 0.5


def windows(stamp: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Means of values (n, k) over gap-free windows of about half a second; stamp of each window's last sample."""
    size = window_size(stamp)
    usable = regular(stamp, size)
    count = len(usable)
    means = np.ones(size) @ values[: count * size].reshape(count, size, -1) / size
    return stamp[size - 1 : count * size : size][usable], means[usable]


def window_size(stamp: IntArray) -> int:
    """Samples in half a second, at least one."""
    return max(1, round(WINDOW_S / (float(np.median(np.diff(stamp))) * 1e-9)))


def regular(stamp: IntArray, size: int) -> NDArray[np.bool_]:
    """(n // size,) True for the windows without a gap."""
    count = len(stamp) // size
    rows = stamp[: count * size].reshape(count, size)
    period = float(np.median(np.diff(stamp)))
    return np.asarray(rows[:, -1] - rows[:, 0] <= 1.2 * size * period)
