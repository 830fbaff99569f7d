"""Samples of a unit that no estimate should lean on: spikes, and what is clipped at the end of the range."""

from __future__ import annotations

import numpy as np

from schemas.products import BoolArray
from schemas.rig import FloatArray

SPIKE_SIGMA = 12.0  # of the local spread of second differences
SPIKE_WINDOW = 101  # samples
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
    if len(values) < SPIKE_WINDOW:
        return np.zeros(len(values), bool)
    bend = np.zeros_like(values)
    # Against the cubic through the four neighbours: waves and slamming pass, a single sample that stands out does not.
    bend[2:-2] = values[2:-2] - (4.0 * (values[1:-3] + values[3:-1]) - values[:-4] - values[4:]) / 6.0
    blocks = np.abs(bend[: len(bend) // SPIKE_WINDOW * SPIKE_WINDOW]).reshape(-1, SPIKE_WINDOW, values.shape[1])
    local = 1.4826 * np.median(blocks, axis=1)
    spread = np.repeat(np.maximum(local, np.median(local, axis=0)), SPIKE_WINDOW, axis=0)
    spread = np.concatenate([spread, np.repeat(spread[-1:], len(values) - len(spread), axis=0)])
    high = np.abs(bend) > SPIKE_SIGMA * spread + 1e-12
    # A spike leaks two thirds of its height into its neighbours' bends; only the peaks are spikes.
    found = np.zeros(len(values), bool)
    for k, axis in np.argwhere(high):
        found[k] |= abs(bend[k, axis]) >= np.abs(bend[max(k - 2, 0) : k + 3, axis]).max()
    return found


def _evenly_spaced(t: FloatArray) -> BoolArray:
    """Samples without a gap within two samples of them, where a jump would pass for a spike."""
    gap = np.concatenate([[False], np.diff(t) > 1.5 * np.median(np.diff(t))])
    near = np.convolve(gap, np.ones(5), "same") > 0.5
    return np.asarray(~(near | np.concatenate([near[1:], [False]])))


def _clipped(values: FloatArray) -> BoolArray:
    """Samples at the extreme of an axis where a clipped signal has many of them, in runs."""
    found = np.zeros(len(values), bool)
    for size in np.abs(values).T:
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
