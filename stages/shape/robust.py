"""Outliers told by the local spread of the data themselves, never by what a data sheet promises."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter

from schemas.products import BoolArray
from schemas.rig import FloatArray

WINDOW = 11  # samples of the running median
SPREAD_BLOCK = 101  # samples over which the spread is taken
THRESHOLD = 5.0  # spreads


def spread(x: FloatArray, block: int = SPREAD_BLOCK) -> FloatArray:
    """Local standard deviation (n, k) of x (n, k): 1.4826 median |x| over blocks of samples (x has median zero)."""
    n = len(x)
    count = max(1, n // block)
    bounds = np.linspace(0, n, count + 1).astype(int)
    levels = np.stack([np.median(np.abs(x[a:b]), axis=0) for a, b in pairwise(bounds)])
    return np.asarray(1.4826 * np.repeat(levels, np.diff(bounds), axis=0))


def hampel(x: FloatArray, threshold: float = THRESHOLD) -> BoolArray:
    """Outliers (n, k) of x (n, k): further from the running median than threshold local spreads (Hampel 1974)."""
    if len(x) < WINDOW:
        return np.zeros(x.shape, dtype=bool)
    off = x - median_filter(x, size=(WINDOW, 1), mode="nearest")
    # On a steep slope the running median is the sample itself and its spread tells nothing; second differences do.
    scale = np.maximum(
        spread(off), spread(np.diff(np.pad(x, ((1, 1), (0, 0)), mode="edge"), n=2, axis=0)) / np.sqrt(6.0)
    )
    floor = 1e-3 * np.median(scale, axis=0) + 1e-12 * np.max(np.abs(x), axis=0)
    return np.asarray(np.abs(off) > threshold * np.maximum(scale, floor))
