"""Attitude of a unit: from the driver's convention to the quaternion of ``R_n_body`` (hull axes to ENU)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics import quaternions
from physics.units import DEG
from schemas.rig import FloatArray
from schemas.trial import ImuSeries
from schemas.wire import Table
from stages.decode import columns
from stages.decode.axes import R_ENU_NAV
from stages.decode.profile import Attitude, ImuChannel

NORM_TOLERANCE = 0.05
"""A quaternion whose norm is further from 1 is none."""


def attitude(table: Table, channel: ImuChannel) -> tuple[FloatArray, NDArray[np.bool_]] | None:
    """Quaternions (n, 4) x, y, z, w of ``R_n_body`` and (n,) True where one is given; None without attitude.

    Where none is given the quaternion is the identity. Unavailable: orientation_covariance[0] == -1, a quaternion
    that is zero or far from unit, an angle that is not finite.
    """
    convention = channel.attitude
    if convention.form == "none":
        return None
    if convention.form == "euler":
        return _from_angles(table, channel)
    if not columns.has(table, channel, "orientation"):
        return None
    quaternion = columns.vector(table, channel, "orientation")
    norm = norm_of(quaternion)
    given = (np.abs(norm - 1.0) < NORM_TOLERANCE) & ~_declared_unavailable(table, channel)
    if not given.any():
        return None
    if not given.all():
        quaternion = np.where(given[:, None], quaternion, (0.0, 0.0, 0.0, 1.0))
    return _to_enu_hull(quaternion, convention, channel.hull_rotation), given


def from_angles(heading: FloatArray, pitch: FloatArray, roll: FloatArray, convention: Attitude) -> FloatArray:
    """``R_n_b = Rz(heading) Rx(pitch) Ry(roll)``: quaternions (n, 4) of angles (n,) in the driver's unit and signs."""
    signs = (
        -1.0 if convention.heading_positive == "clockwise" else 1.0,
        1.0 if convention.pitch_positive == "bow up" else -1.0,
        1.0 if convention.roll_positive == "starboard down" else -1.0,
    )
    factor = DEG if convention.unit == "deg" else 1.0
    return quaternions.from_euler(*(sign * factor * angle for sign, angle in zip(signs, (heading, pitch, roll))))


def with_gravity(unit: ImuSeries, source: ImuSeries, R_imu_source: FloatArray, gravity: float) -> ImuSeries:
    """``f = a + R_b_n (0, 0, g)``: specific force from acceleration whose gravity the unit removed.

    source: the series whose attitude is used (the unit itself, or the PHINS beside it); R_imu_source: its mounting.
    Interval means take gravity at the middle of the interval. Samples beyond the source's attitude are left out.
    """
    from physics.interpolation import slerp_quaternions  # scipy is slow to import, and gravity rarely removed

    assert source.attitude is not None
    half = 0 if unit.instantaneous else int(np.median(np.diff(unit.stamp))) // 2
    q_n_source, valid = slerp_quaternions(source.stamp, source.attitude, unit.stamp - half)
    q_n_imu = quaternions.multiply(q_n_source, _quaternion(R_imu_source.T))
    restored = unit.accel[valid] + quaternions.rotate(quaternions.conjugate(q_n_imu), np.array([0.0, 0.0, gravity]))
    own = None if unit.attitude is None else unit.attitude[valid]
    return ImuSeries(unit.stamp[valid], unit.gyro[valid], restored, own, unit.instantaneous)


def norm_of(quaternion: FloatArray) -> FloatArray:
    """(n,) norms of (n, 4)."""
    return np.sqrt(np.einsum("ij,ij->i", quaternion, quaternion))


def _from_angles(table: Table, channel: ImuChannel) -> tuple[FloatArray, NDArray[np.bool_]] | None:
    angles = [columns.scalar(table, channel, name) for name in ("heading", "pitch", "roll")]
    given = np.asarray(np.isfinite(angles).all(axis=0))
    heading, pitch, roll = (np.where(given, angle, 0.0) for angle in angles)
    return (from_angles(heading, pitch, roll, channel.attitude), given) if given.any() else None


def _declared_unavailable(table: Table, channel: ImuChannel) -> NDArray[np.bool_]:
    covariance = columns.array(table, channel, "orientation_covariance", 9)
    if covariance is None:
        return np.zeros(len(table), dtype=bool)
    return np.asarray(covariance[:, 0] == -1.0)


def _to_enu_hull(quaternion: FloatArray, convention: Attitude, R_hull_log: FloatArray) -> FloatArray:
    """``R_enu_hull = R_enu_nav R_nav_log R_hull_log^T``, unit quaternions."""
    mapped = quaternions.conjugate(quaternion) if convention.inverse else quaternion
    R_enu_nav = R_ENU_NAV[convention.frame]
    if not np.array_equal(R_enu_nav, np.eye(3)):
        mapped = quaternions.multiply(_quaternion(R_enu_nav), mapped)
    if not np.array_equal(R_hull_log, np.eye(3)):
        mapped = quaternions.multiply(mapped, _quaternion(R_hull_log.T))
    return np.asarray(mapped / norm_of(mapped)[:, None])


def _quaternion(R_a_b: FloatArray) -> FloatArray:
    """Quaternion (4,) of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation  # slow to import, and most logs need none

    return np.asarray(Rotation.from_matrix(R_a_b).as_quat())
