"""Attitudes of long records at other times, piece by piece: the numbers are those of :mod:`physics.interpolation`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from physics.interpolation import slerp_quaternions, usual_interval
from schemas import scratch
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray
from stages.slabs import rows, slabs


@dataclass(frozen=True)
class Attitudes:
    """Unit quaternions at stamps (n,) ns. usual: ns, interval; some: the quaternions (k, 4) of k samples in a row."""

    stamp: IntArray
    usual: float
    some: Callable[[slice], FloatArray]

    def at(self, times: IntArray) -> tuple[FloatArray, BoolArray]:
        """As :func:`physics.interpolation.slerp_quaternions`, at times (m,) ns in order."""
        if not len(times):
            return np.zeros((0, 4)), np.zeros(0, dtype=bool)
        first, last = np.searchsorted(self.stamp, times[[0, -1]])
        near = slice(max(int(first) - 2, 0), int(last) + 2)
        return slerp_quaternions(self.stamp[near], self.some(near), times, self.usual)


At = Callable[[IntArray], tuple[FloatArray, BoolArray]]


def gathered(at: At, times: IntArray) -> tuple[FloatArray, BoolArray]:
    """What ``at`` gives at all times (m,) ns: quaternions (k, 4) at the valid ones, and which (m,) these are."""
    found, valid, k = scratch.empty((len(times), 4)), np.zeros(len(times), dtype=bool), 0
    for part in slabs(len(times)):
        quaternion, valid[part] = at(times[part])
        found[k : k + len(quaternion)] = quaternion
        k += len(quaternion)
        scratch.release(found)
    return found[:k], valid


def attitudes(stamp: IntArray, values: FloatArray, quaternion: Callable[[FloatArray], FloatArray]) -> Attitudes:
    """Attitudes that ``quaternion`` makes of values (n, c), a row each."""

    def some(part: slice) -> FloatArray:
        found = quaternion(values[part])
        scratch.release(values)
        return found

    return Attitudes(stamp, usual_interval(stamp), some)


def attitudes_of(series: ImuSeries | None, then: Callable[[FloatArray], FloatArray] = lambda q: q) -> Attitudes | None:
    """Those samples of a unit that are an attitude, turned on by ``then``; None when fewer than two are."""
    if series is None or series.attitude is None:
        return None
    given = [np.linalg.norm(series.attitude[part], axis=1) for part in slabs(len(series))]
    good = np.concatenate([np.isfinite(norm) & (norm > 0.5) for norm in given] or [np.zeros(0, dtype=bool)])
    if good.sum() < 2:
        return None
    stamp, values = (scratch.shelved(rows(part, good)) for part in (series.stamp, series.attitude))
    return attitudes(stamp, values, lambda q: then(q / np.linalg.norm(q, axis=1)[:, None]))
