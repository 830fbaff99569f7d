"""Installation deviation of a PHINS against the IMU beside it, from rates alone.

    w_imu(t) = R_imu_phins (w_pn(t) + R_p_n w_in),   w_pn = r - (h / 12) r x (r_k+1 - r_k-1) / 2,
    r_k = Log(R_n_p(t_k - h)^T R_n_p(t_k)) / h

The attitude's own increments give the rate of the PHINS against the level frame (the second term takes their coning
off); the level frame's rate against inertial space, w_in (3,), is fitted along, so that neither latitude nor speed
need be known. Any angle; the latency of the PHINS is fitted too and does no harm. A constant needs no two hours: of a
long record the stretch that shows it best is used, and attitudes no closer than GRID.
Source of the coning term: Bortz 1971 for a linearly varying rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from physics import quaternions, rotations
from physics.units import ARCMIN
from schemas.errors import DataError
from schemas.products import Estimate, Status
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray
from stages.align.likelihood import PRIOR_ANGLE, Nuisance, fit
from stages.align.tracks import (
    GRID,
    SEGMENT_SHORTEST,
    Cells,
    Span,
    Track,
    cell_length,
    finite_rows,
    shared_spans,
    tracks,
)
from stages.align.wahba import SEARCH_REACH, search

CORRELATION_LEAST = 0.5  # share of common motion below which the two do not belong together
LONGEST = 1800.0  # s of record used; more tells less than the axes leave open
BLOCK = 60.0  # s, in whole blocks of which the best stretch is looked for
BLOCK_CELL = 0.5  # s, rates are averaged over it for that
AXES_STD = 0.1 * ARCMIN  # rad; an IMU's gyro axes are square to each other to about 5 arcsec, seen as a rotation
STD_ESTIMATED = 3.0 * ARCMIN  # rad, largest standard deviation of a plain estimate
STD_WEAK = 60.0 * ARCMIN  # rad, and of a weak one


def installation(imu: Sequence[Track], phins: ImuSeries, epoch: int, step: float, channel: str) -> Estimate:
    """Rotation vector (3,) of ``R_imu_phins`` with the standard deviation of its error, imu-axes.

    step: length of the cells that suits the IMU, s.
    """
    good = np.zeros(0, dtype=bool) if phins.attitude is None else finite_rows(phins.attitude)
    if phins.attitude is None or np.count_nonzero(good) < 3:
        return _unknown(f"{channel} carries no attitude")
    thin = thinned(phins.stamp[good], phins.attitude[good])
    try:
        unit = tracks(thin, epoch, channel)
    except DataError as error:
        return _unknown(f"{channel}: {error.problem}")
    imu = best_excited(imu, unit)
    step = max(step, cell_length(thin))
    coarse = search(imu, unit, SEGMENT_SHORTEST, step)
    if coarse is None:
        return _unknown(f"{channel} and the IMU beside it share no stretch of {SEGMENT_SHORTEST:.0f} s")
    if coarse.correlation < CORRELATION_LEAST:
        return _unknown(f"{channel} and the IMU beside it show too little common motion")
    start = (coarse.rotation, coarse.delay)
    found = fit(imu, unit, step, start, SEGMENT_SHORTEST, nuisance=_level_frame(thin, epoch))
    return _graded(rotations.log(found.rotation), np.sqrt(np.diag(found.covariance)[:3] + AXES_STD**2))


def thinned(stamp: IntArray, attitude: FloatArray) -> ImuSeries:
    """Attitudes (n, 4) about GRID apart, and for gyro the mean rates (n, 3) of the intervals that end at them."""
    every = max(1, int(GRID * 1e9 / float(np.median(np.diff(stamp))) + 0.05))
    stamp, q = stamp[::every], attitude[::every]
    interval = (np.diff(stamp) * 1e-9)[:, None]
    rate = quaternions.log(quaternions.multiply(quaternions.conjugate(q[:-1]), q[1:])) / interval
    if len(rate) > 1:
        rate = rate - interval / 12.0 * quaternions.cross(rate, np.gradient(rate, axis=0))
    return ImuSeries(stamp[1:], rate, np.zeros_like(rate), q[1:])


def best_excited(imu: Sequence[Track], unit: Sequence[Track]) -> tuple[Track, ...]:
    """The IMU's tracks cut to the LONGEST s in which the motion tells most about its least known angle.

    A rate w tells ``w^2 I - w w^T`` about the rotation: its least eigenvalue, summed over a stretch, decides.
    """
    spans = shared_spans(imu, unit, BLOCK, (-SEARCH_REACH, SEARCH_REACH))
    starts = [span.start + BLOCK * np.arange(span.count(BLOCK)) for span in spans]
    count = round(LONGEST / BLOCK)
    if sum(map(len, starts)) <= count:
        return tuple(imu)
    told = np.concatenate([_block_information(span) for span in spans])
    total = np.cumsum(np.concatenate((np.zeros((1, 3, 3)), told)), axis=0)
    best = int(np.argmax(np.linalg.eigvalsh(total[count:] - total[:-count])[:, 0]))
    begin, end = np.concatenate(starts)[[best, best + count - 1]] + [-SEARCH_REACH, BLOCK + SEARCH_REACH]
    kept = (replace(track, start=max(track.start, begin), end=min(track.end, end)) for track in imu)
    return tuple(track for track in kept if track.end - track.start > SEGMENT_SHORTEST)


def _block_information(span: Span) -> FloatArray:
    """Information (k, 3, 3) on the rotation in each block of a span, rates against their block's mean."""
    cells = round(BLOCK / BLOCK_CELL)
    rate = span.first.rate(span.start, BLOCK_CELL, span.count(BLOCK) * cells).reshape(-1, cells, 3)
    rate = rate - rate.mean(axis=1, keepdims=True)
    product = rate.swapaxes(1, 2) @ rate
    return np.asarray(np.trace(product, axis1=1, axis2=2)[:, None, None] * np.eye(3) - product)


def _level_frame(thin: ImuSeries, epoch: int) -> Nuisance:
    stamp = (thin.stamp - epoch) * 1e-9
    assert thin.attitude is not None
    level_to_unit = quaternions.conjugate(thin.attitude)

    def regressors(pair: Cells, rotation: FloatArray) -> FloatArray:
        nearest = np.searchsorted(stamp, pair.time).clip(0, len(stamp) - 1)
        return rotation @ Rotation.from_quat(level_to_unit[nearest]).as_matrix()

    return regressors


def _graded(value: FloatArray, std: FloatArray) -> Estimate:
    worst = float(std.max())
    if worst <= STD_ESTIMATED:
        return Estimate(value, std)
    axis = "xyz"[int(np.argmax(std))]
    if worst <= STD_WEAK:
        return Estimate(value, std, Status.WEAK, f"the motion leaves {worst / ARCMIN:.1f} arcmin open about {axis}")
    reason = f"the motion does not show the angle about {axis}"
    return Estimate(value, std, Status.NOT_OBSERVABLE, reason)


def _unknown(reason: str) -> Estimate:
    return Estimate(np.zeros(3), np.full(3, PRIOR_ANGLE), Status.NOT_OBSERVABLE, reason)
