"""Installation deviation of a PHINS against the IMU beside it, from rates alone.

    w_imu(t) = R_imu_phins (Log(R_n_p(t - h)^T R_n_p(t)) / h + R_p_n w_in)

The attitude's own increments give the rate of the PHINS against the level frame; the level frame's rate against
inertial space, w_in (3,), is fitted along, so that neither latitude nor speed need be known. Any angle; the latency of
the PHINS is fitted too and does no harm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from physics import rotations
from physics.units import ARCMIN
from schemas.errors import DataError
from schemas.products import Estimate, Status
from schemas.rig import FloatArray
from schemas.trial import ImuSeries
from stages.align.likelihood import PRIOR_ANGLE, Nuisance, fit
from stages.align.tracks import SEGMENT_SHORTEST, Cells, Track, tracks
from stages.align.wahba import search

CORRELATION_LEAST = 0.5  # share of common motion below which the two do not belong together
AXES_STD = 0.1 * ARCMIN  # rad; an IMU's gyro axes are square to each other to about 5 arcsec, seen as a rotation
STD_ESTIMATED = 3.0 * ARCMIN  # rad, largest standard deviation of a plain estimate
STD_WEAK = 60.0 * ARCMIN  # rad, and of a weak one


def installation(imu: Sequence[Track], phins: ImuSeries, epoch: int, step: float, channel: str) -> Estimate:
    """Rotation vector (3,) of ``R_imu_phins`` with the standard deviation of its error, imu-axes."""
    if phins.attitude is None or len(phins) < 3:
        return _unknown(f"{channel} carries no attitude")
    try:
        unit = tracks(rate_series(phins, phins.attitude), epoch, channel)
    except DataError as error:
        return _unknown(f"{channel}: {error.problem}")
    coarse = search(imu, unit, SEGMENT_SHORTEST, step)
    if coarse is None:
        return _unknown(f"{channel} and the IMU beside it share no stretch of {SEGMENT_SHORTEST:.0f} s")
    if coarse.correlation < CORRELATION_LEAST:
        return _unknown(f"{channel} and the IMU beside it show too little common motion")
    start = (coarse.rotation, coarse.delay)
    found = fit(imu, unit, step, start, SEGMENT_SHORTEST, nuisance=_level_frame(phins, phins.attitude, epoch))
    return _graded(rotations.log(found.rotation), np.sqrt(np.diag(found.covariance)[:3] + AXES_STD**2))


def rate_series(phins: ImuSeries, attitude: FloatArray) -> ImuSeries:
    """The attitude's rotation increments as mean rates (n - 1, 3) over the intervals that end at the stamps."""
    turn = Rotation.from_quat(attitude)
    increments = (turn[:-1].inv() * turn[1:]).as_rotvec()
    rate = increments / (np.diff(phins.stamp) * 1e-9)[:, None]
    return ImuSeries(phins.stamp[1:], rate, np.zeros_like(rate))


def _level_frame(phins: ImuSeries, attitude: FloatArray, epoch: int) -> Nuisance:
    stamp = (phins.stamp - epoch) * 1e-9
    level_to_unit = Rotation.from_quat(attitude).inv()

    def regressors(pair: Cells, rotation: FloatArray) -> FloatArray:
        nearest = np.searchsorted(stamp, pair.time).clip(0, len(stamp) - 1)
        return rotation @ level_to_unit[nearest].as_matrix()

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
