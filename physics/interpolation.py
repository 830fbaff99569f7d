"""Attitude between its samples: never across a gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physics import quaternions

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

GAP_FACTOR = 1.5  # an interval longer than this many usual ones is a gap (one lost sample makes 2)
BREAK_FACTOR = 2.0 * GAP_FACTOR  # usual intervals without a sample after which a drawn line breaks


def usual_interval(stamp: IntArray) -> float:
    """Median sample interval in ns of stamps (n,) ns; infinite for fewer than two samples."""
    if len(stamp) < 2:
        return np.inf
    step = np.diff(stamp)
    candidate = step[len(step) // 2]
    if 2 * np.count_nonzero(step == candidate) > len(step):
        return float(candidate)  # what most of them are is the median, and is found without sorting
    return float(np.median(step))


def gap_starts(stamp: IntArray) -> IntArray:
    """Indices k after which stamps (n,) ns pause: stamp[k + 1] comes more than a few usual intervals later."""
    return np.flatnonzero(np.diff(stamp) > BREAK_FACTOR * usual_interval(stamp)).astype(np.int64)


def bracket(stamp: IntArray, at: IntArray, usual: float | None = None) -> tuple[IntArray, FloatArray, BoolArray]:
    """Where times ``at`` (m,) ns lie among increasing stamps (n,) ns.

    Returns index k (m,) and fraction f (m,) with ``at = stamp[k] + f (stamp[k+1] - stamp[k])``, f exactly 0 on a
    stamp, and valid (m,): on a stamp, or between two neighbours no further apart than a usual interval allows (ns;
    that of the stamps unless it is given).
    """
    last = max(len(stamp) - 2, 0)
    k = np.clip(np.searchsorted(stamp, at, side="right") - 1, 0, len(stamp) - 1)
    following = np.minimum(k + 1, len(stamp) - 1)
    step = stamp[following] - stamp[k]
    fraction = np.where(step > 0, (at - stamp[k]) / np.maximum(step, 1), 0.0)
    on_stamp = at == stamp[k]
    longest = GAP_FACTOR * (usual_interval(stamp) if usual is None else usual)
    inside = (at > stamp[0]) & (k <= last) & (step > 0) & (step <= longest)
    return k.astype(np.int64), np.where(on_stamp, 0.0, fraction), on_stamp | inside


def slerp_quaternions(
    stamp: IntArray, attitude: FloatArray, at: IntArray, usual: float | None = None
) -> tuple[FloatArray, BoolArray]:
    """``q(at) = q_k Exp(f Log(q_k^-1 q_k+1))`` for unit quaternions (n, 4) x, y, z, w at stamps (n,) ns.

    Returns the quaternions (k, 4) at the valid ones of ``at`` (m,) ns and the mask valid (m,): exact on a stamp,
    invalid before the first, after the last and inside a gap. usual: as in :func:`bracket`.
    """
    k, fraction, valid = bracket(stamp, at, usual)
    k, fraction = k[valid], fraction[valid]
    start = attitude[k]
    between = np.flatnonzero(fraction)
    if not len(between):
        return start, valid
    following = attitude[np.minimum(k[between] + 1, len(stamp) - 1)]
    step = quaternions.log(quaternions.multiply(quaternions.conjugate(start[between]), following))
    start[between] = quaternions.multiply(start[between], quaternions.exp(step * fraction[between, None]))
    return start, valid


def slerp(stamp: IntArray, rotation: Rotation, at: IntArray) -> tuple[Rotation, BoolArray]:
    """:func:`slerp_quaternions` for rotation objects."""
    found, valid = slerp_quaternions(stamp, rotation.as_quat(), at)
    return Rotation.from_quat(found), valid
