"""Settling the stamps of one channel: zero stamps, disorder, clock steps, duplicates, gaps.

Stamps come out strictly increasing. Nothing is invented: samples are only left out or put in order, and every such
act is told in a note.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.rig import FloatArray
from schemas.trial import IntArray

CLOCK_STEP_NS = 1_000_000_000
"""A jump of the stamps against log_time beyond this is a step of the clock; below it, disorder is sorted."""
GLITCH_SAMPLES = 5
"""Up to so many samples in a row with stamps far off both neighbours are wrong stamps, not a clock step."""
GAP_PERIODS = 1.5
"""A distance between stamps beyond this many sample periods is a gap (one missing sample makes 2)."""
COARSE_SHARE = 0.2
"""More duplicates than this share, with different data: the stamps are too coarse to be used."""
JITTER_SHARE = 0.02
"""Jitter (rms) beyond this share of the sample period is told."""
LATEST_NS = 2**62
"""Stamps beyond this (year 2116) or not after 0 are no measurement times."""

Same = Callable[[IntArray, IntArray], NDArray[np.bool_]]


@dataclass(frozen=True)
class StampFacts:
    """What the stamps of a channel look like. Times in s; longest_gap_at: start of the longest gap, ns."""

    period: float
    jitter: float
    gaps: int
    longest_gap: float
    longest_gap_at: int
    duplicates: int
    out_of_order: int


@dataclass(frozen=True)
class Settled:
    """keep: (n,) indices of the samples used, in order of time. stamp: (n,) ns, strictly increasing."""

    keep: IntArray
    stamp: IntArray
    notes: tuple[str, ...]


def facts(stamp: IntArray) -> StampFacts:
    """Rate, jitter, gaps, duplicates and disorder of stamps in the order they were written."""
    step = np.diff(stamp)
    ordered = stamp if (step > 0).all() else _distinct_sorted(stamp)
    duplicates = len(stamp) - len(ordered)
    disorder = int(np.count_nonzero(step < 0))
    if len(ordered) < 2:
        return StampFacts(0.0, 0.0, 0, 0.0, 0, duplicates, disorder)
    step = np.diff(ordered)
    period = float(np.median(step))
    is_gap = step > GAP_PERIODS * period
    regular = step[~is_gap]
    longest = int(np.argmax(step))
    return StampFacts(
        period=period * 1e-9,
        jitter=float(np.std(regular)) * 1e-9 if len(regular) else 0.0,
        gaps=int(np.count_nonzero(is_gap)),
        longest_gap=float(step[longest]) * 1e-9 if is_gap.any() else 0.0,
        longest_gap_at=int(ordered[longest]),
        duplicates=duplicates,
        out_of_order=disorder,
    )


def _distinct_sorted(stamp: IntArray) -> IntArray:
    ordered = np.sort(stamp)
    return ordered[np.diff(ordered, prepend=ordered[:1] - 1) > 0]


def settle(stamp: IntArray, log_time: IntArray, same: Same, epoch: int | None = None) -> Settled:
    """Order and clean the stamps of a channel.

    same(i, j) tells whether samples i and j (index arrays) carry the same data. epoch: ns, what times in notes count
    from; None: the first stamp that is left. Raises DataError where no trustworthy stamps are left.
    """
    stamp, keep, notes = _measured(stamp, log_time)
    if not (len(keep) == len(stamp) and _in_order(stamp)):
        for act in (_without_glitches, _one_clock, _sorted):
            kept, told = act(stamp[keep], log_time[keep])
            keep, notes = keep[kept], notes + told
        kept, told = _distinct(stamp[keep], keep, same)
        keep, notes = keep[kept], notes + told
    start = epoch if epoch is not None else int(stamp[keep[0]])
    found = facts(stamp[keep])
    return Settled(keep, stamp[keep], notes + _jitter_note(found) + _gap_note(found, stamp[keep], start))


def _in_order(stamp: IntArray) -> bool:
    """Strictly increasing without a jump: nothing to settle (the usual case, and the arrays are large)."""
    step = np.diff(stamp)
    return len(step) > 0 and bool(step.min() > 0 and step.max() <= CLOCK_STEP_NS)


def _measured(stamp: IntArray, log_time: IntArray) -> tuple[IntArray, IntArray, tuple[str, ...]]:
    """Stamps that are set at all; the times of writing stand in where no sample has one."""
    valid = (stamp > 0) & (stamp < LATEST_NS)
    if len(stamp) and not valid.any():
        usable = bool((log_time > 0).all())
        if not usable or log_time.max() == log_time.min():
            raise DataError("no message has a stamp, and the times of writing do not tell the samples apart either")
        told = "header stamps are all zero; the times of writing (log_time) are used instead"
        return log_time, np.arange(len(stamp)), (told,)
    dropped = int(np.count_nonzero(~valid))
    note = (f"{_samples(dropped)} without a valid stamp left out",) if dropped else ()
    return stamp, np.flatnonzero(valid), note


def _jumps(stamp: IntArray) -> IntArray:
    """Indices k at which stamp k lies far from stamp k - 1, for this channel's rate."""
    step = np.abs(np.diff(stamp))
    usual = float(np.median(step)) if len(step) else 0.0
    return np.flatnonzero(step > max(CLOCK_STEP_NS, 5.0 * usual)) + 1


def _without_glitches(stamp: IntArray, _: IntArray) -> tuple[IntArray, tuple[str, ...]]:
    """Leave out single samples whose stamps lie far off both neighbours, backwards or forwards."""
    cuts = _jumps(stamp)
    keep = np.ones(len(stamp), dtype=bool)
    before = int(cuts[0]) - 1 if len(cuts) else 0
    for first, last in zip(cuts, [*cuts[1:], len(stamp)]):
        jump = stamp[first] - stamp[before]
        after = stamp[last] - stamp[before] if last < len(stamp) else -jump
        wrong = last - first <= GLITCH_SAMPLES and (jump < 0 < after or (jump > after and abs(after) < CLOCK_STEP_NS))
        if wrong:
            keep[first:last] = False
        else:
            before = last - 1
    bad = int(np.count_nonzero(~keep))
    return np.flatnonzero(keep), (f"{_samples(bad)} with stamps far off their neighbours' left out",) if bad else ()


def _one_clock(stamp: IntArray, log_time: IntArray) -> tuple[IntArray, tuple[str, ...]]:
    """Where the clock was set during the record, the longest consistent part."""
    steps = _clock_steps(stamp, log_time)
    if not len(steps):
        return np.arange(len(stamp)), ()
    edges = np.concatenate([[0], steps, [len(stamp)]])
    longest = int(np.argmax(np.diff(edges)))
    first, last = int(edges[longest]), int(edges[longest + 1])
    jump = (stamp[steps[0]] - stamp[steps[0] - 1]) * 1e-9
    at = (stamp[steps[0] - 1] - stamp[0]) * 1e-9
    note = (
        f"stamps jump {'back' if jump < 0 else 'ahead'} by {abs(jump):.3f} s after {at:.3f} s of record (clock set?); "
        f"the longest consistent part is used, {last - first} of {len(stamp)} samples"
    )
    return np.arange(first, last), (note,)


def _clock_steps(stamp: IntArray, log_time: IntArray) -> IntArray:
    """Indices at which the stamps jump and the times of writing do not follow."""
    cuts = _jumps(stamp)
    if not _tells_time(log_time, stamp):
        return cuts[stamp[cuts] < stamp[cuts - 1]]
    offset = stamp - log_time
    near = np.arange(5)
    after = np.median(offset[np.minimum(cuts[:, None] + near, len(stamp) - 1)], axis=1)
    before = np.median(offset[np.maximum(cuts[:, None] - 1 - near, 0)], axis=1)
    return cuts[np.abs(after - before) > CLOCK_STEP_NS]


def _tells_time(log_time: IntArray, stamp: IntArray) -> bool:
    """Whether log_time advances as the stamps do (a recorder's clock, not a converter's constant)."""
    stride = max(len(stamp) // 100, 1)
    if len(stamp) < 2:
        return False
    written, measured = (abs(float(np.median(np.diff(times[::stride])))) for times in (log_time, stamp))
    return 0.5 * measured < written < 2.0 * measured


def _sorted(stamp: IntArray, _: IntArray) -> tuple[IntArray, tuple[str, ...]]:
    late = np.maximum.accumulate(stamp) - stamp
    disorder = int(np.count_nonzero(late > 0))
    if not disorder:
        return np.arange(len(stamp)), ()
    note = f"{_samples(disorder)} out of order (by up to {late.max() * 1e-9:.3f} s) put in order"
    return np.argsort(stamp, kind="stable"), (note,)


def _distinct(stamp: IntArray, index: IntArray, same: Same) -> tuple[IntArray, tuple[str, ...]]:
    """The first of each group of equal stamps."""
    again = np.flatnonzero(np.diff(stamp, prepend=stamp[:1] - 1) == 0)
    if not len(again):
        return np.arange(len(stamp)), ()
    differing = int(np.count_nonzero(~same(index[again - 1], index[again])))
    if differing > COARSE_SHARE * len(stamp):
        raise DataError(
            f"{differing} of {len(stamp)} samples share their stamp with another: the stamps are too coarse; "
            'rig key stamp = "log_time" would use the times of writing'
        )
    kept = np.delete(np.arange(len(stamp)), again)
    clash = f", {differing} of them with different data (the first is kept)" if differing else ""
    return kept, (f"{_samples(len(again))} with a duplicate stamp left out{clash}",)


def _jitter_note(found: StampFacts) -> tuple[str, ...]:
    if found.jitter < JITTER_SHARE * found.period or found.period == 0.0:
        return ()
    return (f"stamps jitter by {1e3 * found.jitter:.3f} ms (rms) about their period of {1e3 * found.period:.3f} ms",)


def _gap_note(found: StampFacts, stamp: IntArray, epoch: int) -> tuple[str, ...]:
    at = (found.longest_gap_at - epoch) * 1e-9
    if found.gaps == 0:
        return ()
    if found.gaps == 1:
        return (f"a gap of {found.longest_gap:.3f} s at t = {at:.3f} s",)
    lost = missing_time(stamp)
    return (f"{found.gaps} gaps, {lost:.3f} s in all, the longest {found.longest_gap:.3f} s at t = {at:.3f} s",)


def missing_time(stamp: IntArray) -> float:
    """Seconds of data missing in the gaps."""
    step: FloatArray = np.diff(stamp) * 1e-9
    period = float(np.median(step))
    return float(np.sum(step[step > GAP_PERIODS * period] - period))


def _samples(count: int) -> str:
    return f"{count} sample" if count == 1 else f"{count} samples"
