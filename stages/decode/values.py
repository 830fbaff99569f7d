"""Checks of the values of one unit, (n, 3) gyro and accel: not finite, frozen, held, saturated, spiky.

The checks only flag: :func:`usable` says which samples may be kept, :func:`remarks` says what looks odd but stays.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.rig import FloatArray
from schemas.trial import IntArray

FROZEN_S = 1.0
"""Three values of a triad unchanged for longer than this: it was stuck, the samples are left out."""
FROZEN_SAMPLES = 10
BAD_SHARE = 0.5
"""A unit with a larger share of unusable samples is refused."""
LIMITS = {"gyro": 1e3, "accel": 1e5}
"""rad/s and m/s^2 beyond anything an inertial unit measures: not a value."""
HELD_SHARE = 0.2
SATURATED_SAMPLES = 10
SPIKE_SIGMAS = 25.0
SPREAD_SAMPLES = 20_000
"""So many samples tell the usual spread well enough."""

BoolArray = NDArray[np.bool_]
_AXES = "xyz"


def usable(
    stamp: IntArray, gyro: FloatArray, accel: FloatArray, epoch: int | None = None
) -> tuple[BoolArray, tuple[str, ...]]:
    """(n,) True where the sample can be used, and what was found. Raises DataError for a dead or broken unit."""
    finite = _within(gyro, "gyro") & _within(accel, "accel")
    _refuse_mostly(~finite, "not finite or beyond any sensor's range")
    _refuse_constant(gyro[finite], "gyro")
    _refuse_constant(accel[finite], "accelerometer")
    notes = counted(~finite, stamp, epoch, "not finite or out of any sensor's range left out")
    good = finite
    for what, parts in (("all values", (gyro, accel)), ("gyro", (gyro,)), ("accelerometer", (accel,))):
        stuck = frozen(stamp, *parts)
        _refuse_mostly(stuck, f"frozen ({what} unchanged)")
        notes += counted(stuck & good, stamp, epoch, f"frozen ({what} unchanged for more than {FROZEN_S:g} s) left out")
        good = good & ~stuck
    return good, notes


def remarks(stamp: IntArray, gyro: FloatArray, accel: FloatArray) -> tuple[str, ...]:
    """What looks odd in the values but stays: held, saturated and spiky samples."""
    notes = _held(_repeated(gyro, accel))
    near = _evenly_spaced(stamp)
    for name, values in (("gyro", gyro), ("accelerometer", accel)):
        for axis, column in zip(_AXES, values.T):
            notes += _saturated(column, f"{name} {axis}")
        notes += _spiky(values, near, name)
    return notes


def every(mask: BoolArray) -> BoolArray:
    """(n,) whether all of a row of mask (n, k) are True; column by column, since numpy is slow on many short rows."""
    return np.asarray(functools.reduce(np.logical_and, mask.T))


def frozen(stamp: IntArray, *parts: FloatArray) -> BoolArray:
    """(n,) True for the repeats within stretches of rows, identical in all parts (n, k), that last too long.

    The first row of a stretch is taken for a measurement, unless all of it is zero.
    """
    repeat = np.concatenate([[False], _repeated(*parts)])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], repeat, [False]]).astype(np.int8)))
    first, last = edges[0::2], edges[1::2]
    long = (last - first >= FROZEN_SAMPLES) & ((stamp[last - 1] - stamp[first - 1]) * 1e-9 > FROZEN_S)
    first, last = first[long], last[long]
    first = first - every(np.concatenate([part[first - 1] == 0.0 for part in parts], axis=1))
    change = np.zeros(len(stamp) + 1, dtype=np.int64)
    change[first] += 1
    change[last] -= 1
    return np.cumsum(change[:-1]) > 0


def _repeated(*parts: FloatArray) -> BoolArray:
    """(n - 1,) whether a row is identical to the one before it in all parts (n, k)."""
    same = np.asarray(parts[0][1:, 0] == parts[0][:-1, 0])
    rows = np.flatnonzero(same)
    for part in parts:
        same[rows] &= every(part[rows + 1] == part[rows])
    return same


def _within(values: FloatArray, kind: str) -> BoolArray:
    limit = LIMITS[kind]
    if values.min() > -limit and values.max() < limit:  # false for NaN too
        return np.ones(len(values), dtype=bool)
    with np.errstate(invalid="ignore"):
        return every(np.abs(values) < limit)


def _refuse_mostly(bad: BoolArray, what: str) -> None:
    share = float(np.mean(bad))
    if share > BAD_SHARE:
        raise DataError(f"{100.0 * share:.0f} % of the samples are {what}")


def _refuse_constant(values: FloatArray, kind: str) -> None:
    constant = [axis for axis, column in zip(_AXES, values.T) if column.min() == column.max()]
    if constant:
        level = values[0, _AXES.index(constant[0])]
        axes = " and ".join(constant)
        raise DataError(f"the {kind} is constant on {axes} over the whole log ({level:.6g}): the unit is dead")


def counted(bad: BoolArray, stamp: IntArray, epoch: int | None, what: str) -> tuple[str, ...]:
    """A note on how many samples are bad and where the first is; none where there is nothing to tell."""
    if not bad.any():
        return ()
    at = (stamp[np.argmax(bad)] - (stamp[0] if epoch is None else epoch)) * 1e-9
    count = int(np.count_nonzero(bad))
    return (f"{count} sample{'s' if count > 1 else ''} {what}, the first at t = {at:.3f} s",)


def _held(repeated: BoolArray) -> tuple[str, ...]:
    share = float(np.mean(repeated)) if len(repeated) else 0.0
    if share < HELD_SHARE:
        return ()
    return (f"{100.0 * share:.0f} % of the samples repeat the one before: the unit is slower than its channel",)


def _saturated(column: FloatArray, name: str) -> tuple[str, ...]:
    """A clipped signal has many samples at its very extreme, in runs, and few at the next value below."""
    size = np.abs(column)
    extreme = size.max()
    at_extreme = size == extreme
    count = int(np.count_nonzero(at_extreme))
    if count < SATURATED_SAMPLES or not (at_extreme[2:] & at_extreme[1:-1] & at_extreme[:-2]).any():
        return ()
    below = size[~at_extreme]
    next_below = int(np.count_nonzero(below == below.max())) if len(below) else 0
    if count <= 5 * next_below:
        return ()
    return (f"{count} samples of {name} sit at its extreme, {extreme:.6g}: saturated?",)


def _evenly_spaced(stamp: IntArray) -> BoolArray:
    """(n - 2,) True where a sample has both neighbours at the usual distance."""
    step = np.diff(stamp)
    usual = step < 1.5 * np.median(step)
    return np.asarray(usual[1:] & usual[:-1])


def _spiky(values: FloatArray, near: BoolArray, name: str) -> tuple[str, ...]:
    counts = [_spikes(column, near) for column in values.T]
    if not any(counts):
        return ()
    places = ", ".join(f"{axis} {count}" for axis, count in zip(_AXES, counts) if count)
    return (f"{name} stands out from its neighbours by more than {SPIKE_SIGMAS:g} sigma (outliers?), times: {places}",)


def _spikes(column: FloatArray, near: BoolArray) -> int:
    """How often samples lie off the mean of their neighbours, against the spread of that difference."""
    if len(column) < 100:
        return 0
    off = np.abs(column[1:-1] - 0.5 * (column[2:] + column[:-2]))
    spread = float(np.median(off[:: max(len(off) // SPREAD_SAMPLES, 1)])) / 0.6745
    out = (off > SPIKE_SIGMAS * spread) & near if spread > 0.0 else np.zeros(len(off), dtype=bool)
    # a spike shows in its neighbours too: count runs, not samples
    return int(np.count_nonzero(out[1:] & ~out[:-1])) + int(out[0])
