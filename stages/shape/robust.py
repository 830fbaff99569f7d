"""Outliers told by the local spread of the data themselves, never by what a data sheet promises."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from schemas.products import BoolArray
from schemas.rig import FloatArray

WINDOW = 11  # samples of the running median
SPREAD_BLOCK = 101  # samples over which the spread is taken
THRESHOLD = 5.0  # spreads


def spread(x: FloatArray, block: int = SPREAD_BLOCK) -> FloatArray:
    """Local standard deviation (n, k) of x (n, k): 1.4826 median |x| over blocks of samples (x has median zero)."""
    n, size = len(x), min(block, max(1, len(x)))
    count = max(1, n // size)
    levels = np.median(np.abs(x[: count * size]).reshape(count, size, -1), axis=1)
    which = np.minimum(np.arange(n) // size, count - 1)
    return np.asarray(1.4826 * levels[which])


def hampel(x: FloatArray, threshold: float = THRESHOLD) -> BoolArray:
    """Outliers (n, k) of x (n, k): further from the running median than threshold local spreads (Hampel 1974)."""
    if len(x) < WINDOW:
        return np.zeros(x.shape, dtype=bool)
    columns = np.ascontiguousarray(x.T)
    off = x - np.stack([median_filter(column, size=WINDOW, mode="nearest") for column in columns], axis=-1)
    # On a steep slope the running median is the sample itself and its spread tells nothing; second differences do.
    scale = np.maximum(
        spread(off), spread(np.diff(np.pad(x, ((1, 1), (0, 0)), mode="edge"), n=2, axis=0)) / np.sqrt(6.0)
    )
    floor = 1e-3 * np.median(scale, axis=0) + 1e-12 * np.max(np.abs(x), axis=0)
    return np.asarray(np.abs(off) > threshold * np.maximum(scale, floor))
