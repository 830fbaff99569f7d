"""Samples of a unit that no estimate should lean on: spikes, and what is clipped at the end of the range."""

from __future__ import annotations

import numpy as np

from schemas.products import BoolArray
from schemas.rig import FloatArray

SPIKE_SIGMA = 12.0  # of the local spread of second differences
SPIKE_WINDOW = 101  # samples
PIECE = 2048 * SPIKE_WINDOW  # samples worked on at a time
SPIKE_PASSES = 3  # a spike beside a larger one shows when that is gone,
SPIKES_DENSE = 0.01  # which matters where more than this share of the samples are spikes
CLIPPED_SAMPLES = 10  # at the very extreme, in runs of three and more, five times as many as at the next value


def unfit(t: FloatArray, gyro: FloatArray, accel: FloatArray) -> BoolArray:
    """(n,) samples of gyro and accel (n, 3), taken at t (n,) s, that are clipped or spikes."""
    found = _spikes(gyro) | _spikes(accel)
    bad = found | _clipped(gyro) | _clipped(accel)
    if np.count_nonzero(found) < SPIKES_DENSE * len(found):
        return bad
    even = _evenly_spaced(t)
    for _ in range(1, SPIKE_PASSES):
        if np.count_nonzero(found & even) >= SPIKES_DENSE * len(found):
            gyro, accel = _across(gyro, found), _across(accel, found)
            found = found | (_spikes(gyro) | _spikes(accel)) & even
    return bad | found


def _spikes(values: FloatArray) -> BoolArray:
    """Samples that stand out of both neighbours by many local spreads, any axis."""
    found = np.zeros(len(values), bool)
    whole = len(values) // SPIKE_WINDOW * SPIKE_WINDOW
    if not whole:
        return found
    parts = [slice(k, min(k + PIECE, whole)) for k in range(0, whole, PIECE)]
    local = np.concatenate([_local_spread(values, part) for part in parts])
    spread = np.maximum(local, np.median(local, axis=0))
    parts[-1] = slice(parts[-1].start, len(values))
    for part in parts:
        _mark_spikes(values, part, spread, found)
    return found


def _bend(values: FloatArray, first: int, last: int) -> FloatArray:
    """Rows first..last - 1 against the cubic through their four neighbours, by which waves and slamming pass, but not
    a single sample that stands out; zero at the ends of values."""
    bend = np.zeros((last - first, values.shape[1]))
    a, b = max(first, 2), min(last, len(values) - 2)
    near = values[a - 1 : b - 1] + values[a + 1 : b + 1]
    near *= 4.0
    near -= values[a - 2 : b - 2]
    near -= values[a + 2 : b + 2]
    near /= 6.0
    np.subtract(values[a:b], near, out=bend[a - first : b - first])
    return bend


def _local_spread(values: FloatArray, part: slice) -> FloatArray:
    """(k, 3) of each window of a part that holds whole ones."""
    size = np.ascontiguousarray(np.abs(_bend(values, part.start, part.stop)).T).reshape(
        values.shape[1], -1, SPIKE_WINDOW
    )
    size.partition(SPIKE_WINDOW // 2, axis=2)  # an odd number: the middle one is the median
    return np.asarray(1.4826 * size[:, :, SPIKE_WINDOW // 2].T)


def _mark_spikes(values: FloatArray, part: slice, spread: FloatArray, found: BoolArray) -> None:
    first = max(part.start - 2, 0)
    size = np.abs(_bend(values, first, min(part.stop + 2, len(values))))
    window = np.minimum(np.arange(part.start, part.stop) // SPIKE_WINDOW, len(spread) - 1)
    high = size[part.start - first :][: len(window)] > SPIKE_SIGMA * spread[window] + 1e-12
    # A spike leaks two thirds of its height into its neighbours' bends; only the peaks are spikes.
    for row, axis in np.argwhere(high):
        k = row + part.start - first
        found[row + part.start] |= size[k, axis] >= size[max(k - 2, 0) : k + 3, axis].max()


def _evenly_spaced(t: FloatArray) -> BoolArray:
    """Samples without a gap within two samples of them, where a jump would pass for a spike."""
    gap = np.concatenate([[False], np.diff(t) > 1.5 * np.median(np.diff(t))])
    near = np.convolve(gap, np.ones(5), "same") > 0.5
    return np.asarray(~(near | np.concatenate([near[1:], [False]])))


def _clipped(values: FloatArray) -> BoolArray:
    """Samples at the extreme of an axis where a clipped signal has many of them, in runs."""
    found = np.zeros(len(values), bool)
    for size in map(np.abs, values.T):
        at_extreme = size == size.max()
        in_runs = (at_extreme[2:] & at_extreme[1:-1] & at_extreme[:-2]).any()
        if np.count_nonzero(at_extreme) >= CLIPPED_SAMPLES and in_runs:
            below = size[~at_extreme]
            next_below = np.count_nonzero(below == below.max()) if len(below) else 0
            found |= at_extreme & (np.count_nonzero(at_extreme) > 5 * next_below)
    return found


def _across(values: FloatArray, bad: BoolArray) -> FloatArray:
    """Values (n, 3) with straight lines across the bad rows."""
    rows = np.arange(len(values))
    return np.stack([np.interp(rows, rows[~bad], column[~bad]) for column in values.T], axis=1)
