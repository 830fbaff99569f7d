"""How much of what the main gyro shows is its own noise, and the motion behind it.

A rate that multiplies an unknown (delay, lever arm, scale) has noise of its own. Taken for motion, it tells of the
unknown what no motion told: the answer shrinks towards where it began, and its sigma with it. The mean of the motion
given the measured rates (Wiener's filter) does neither, because what it misses is not correlated with what it says.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import dct, idct
from scipy.ndimage import uniform_filter1d

from physics import matching, quaternions
from schemas.products import BoolArray
from schemas.rig import FloatArray

BLOCK_S = 0.05  # s: the increments compared; ships turn little within it
MOST_BLOCKS = 12_000  # ten minutes tell a coarse gyro's noise to a per cent
BATCHES = 16  # whose means tell how well
LINES = 17  # of the spectrum that are averaged, at least, and
WIDTH_HZ = 0.024  # so much of it


def main_noise(t: FloatArray, main: FloatArray, sub: FloatArray, good: BoolArray) -> tuple[float, float]:
    """rad^2/s, angle random walk of the main gyro squared, and its standard error (infinite where the record is short).

    t: (n,) s. main, sub: (n, 4) attitudes of both units in one frame. good: (n,) measured samples.

    What the turning of one unit against the other has in common with the main unit's own, where it is faster than a
    ship moves, is that unit's noise: motion is in the one alone, flexure and the other unit's noise in the other alone.
    """
    T = float(np.median(np.diff(t)))
    block = max(1, round(BLOCK_S / T))
    first = max(0, len(t) - block * MOST_BLOCKS) // 2
    rows = slice(first, first + block * MOST_BLOCKS, block)
    inverse = quaternions.conjugate(main[rows])
    own, between = (matching.increments(q) for q in (inverse, quaternions.multiply(inverse, sub[rows])))
    whole = np.lib.stride_tricks.sliding_window_view(good[rows], 4).all(axis=1) if len(own) > 2 else np.zeros(0, bool)
    if np.count_nonzero(whole) < 2 * BATCHES:
        return 0.0, np.inf
    # A second difference of white increments has six times their variance. Increments of an inverse run backwards.
    shared = (np.diff(own, n=2, axis=0) * np.diff(between, n=2, axis=0))[whole].mean(axis=1) / (6.0 * block * T)
    batches = np.array([batch.mean() for batch in np.array_split(shared, BATCHES)])
    return float(shared.mean()), float(batches.std(ddof=1) / np.sqrt(BATCHES))


def likely(x: FloatArray, variance: float, step: float) -> FloatArray:
    """The mean (N, c) of what is behind x (N, c), seen every ``step`` s with white noise of that variance.

    The spectrum is that of x itself, less the noise.
    """
    if len(x) < 2 or variance <= 0.0:
        return x
    mean = x.mean(axis=0)
    lines = dct(x - mean, axis=0, norm="ortho")  # continues as its mirror image at both ends: no step there
    width = min(max(LINES, round(WIDTH_HZ * 2.0 * step * len(x))), len(x))
    power = uniform_filter1d(lines**2, width, axis=0, mode="nearest")
    share = np.clip(1.0 - variance / np.maximum(power, np.finfo(float).tiny), 0.0, 1.0)
    return np.asarray(mean + idct(share * lines, axis=0, norm="ortho"))


def fast_level(x: FloatArray) -> float:
    """Variance per sample of white noise that the fast quarter of the spectrum of x (N, c) shows.

    Ships hardly move there. What does move counts as noise, and with it what is slower and smaller still.
    """
    return float(np.mean(dct(x - x.mean(axis=0), axis=0, norm="ortho")[3 * len(x) // 4 :] ** 2)) if len(x) > 1 else 0.0
