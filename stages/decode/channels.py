"""One table of a log -> one series of the trial: settled stamps, hull axes, SI units, unusable samples left out.

Every function returns the series and notes (a sentence each), and raises DataError where nothing can be made of the
channel. ``epoch`` (ns) is what times in notes count from.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from physics.units import DEG, DEG_PER_HOUR, STANDARD_GRAVITY
from schemas.errors import DataError
from schemas.rig import FloatArray
from schemas.trial import GnssSeries, ImuSeries, IntArray, OdometrySeries, ScalarSeries, Truth
from schemas.wire import Table
from stages.decode import attitude, columns, stamps, values
from stages.decode.profile import BodyChannel, Channel, ImuChannel
from stages.decode.windows import windows

GYRO_UNIT = {"rad/s": 1.0, "deg/s": DEG, "deg/h": DEG_PER_HOUR}
ACCEL_UNIT = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY}
MIN_SAMPLES = 20
"""Fewer samples of an inertial unit than this are no record."""
VELOCITY_AGREES = 0.3
"""Largest usual difference between an odometry's velocity and its positions', as a share of the latter."""

Notes = tuple[str, ...]
Series = TypeVar("Series")
Decoder = Callable[[Table, Channel, int | None], tuple[Series, Notes]]


def imu(table: Table, channel: ImuChannel, instantaneous: bool, epoch: int | None = None) -> tuple[ImuSeries, Notes]:
    """An inertial unit; accel is as the unit publishes it (gravity possibly removed)."""
    gyro = _in_hull(table, channel, "angular_velocity", channel.gyro_signs, GYRO_UNIT[channel.gyro_unit])
    accel = _in_hull(table, channel, "linear_acceleration", channel.accel_signs, ACCEL_UNIT[channel.accel_unit])
    _enough(len(gyro), MIN_SAMPLES)
    settled = _settle(table, channel, epoch, gyro, accel)
    keep = settled.keep
    gyro, accel = _taken(gyro, keep), _taken(accel, keep)
    good, told = values.usable(settled.stamp, gyro, accel, epoch)
    _enough(int(np.count_nonzero(good)), MIN_SAMPLES)
    used = np.flatnonzero(good)
    gyro, accel = _taken(gyro, used), _taken(accel, used)
    quaternion, about_attitude = _attitude(table, channel, keep[good])
    series = ImuSeries(settled.stamp[good], gyro, accel, quaternion, instantaneous)
    return series, settled.notes + told + about_attitude + values.remarks(series.stamp, gyro, accel)


def phins(table: Table, channel: ImuChannel, instantaneous: bool, epoch: int | None = None) -> tuple[ImuSeries, Notes]:
    """A unit that is there for its attitude; gyro and accel are NaN where it gives none."""
    found = attitude.attitude(table, channel)
    if found is None:
        raise DataError("it gives no attitude")
    quaternion, given = found
    _enough(int(np.count_nonzero(given)), MIN_SAMPLES)
    settled = _settle(table, channel, epoch, quaternion)
    stuck = values.frozen(settled.stamp, _taken(quaternion, settled.keep))
    good = given[settled.keep] & ~stuck
    if np.count_nonzero(stuck) > values.BAD_SHARE * len(stuck):
        raise DataError("its attitude is frozen: the unit is dead")
    _enough(int(np.count_nonzero(good)), MIN_SAMPLES)
    keep = settled.keep[good]
    gyro, no_gyro = _optional(table, channel, "angular_velocity", channel.gyro_signs, GYRO_UNIT[channel.gyro_unit])
    accel, no_accel = _optional(
        table, channel, "linear_acceleration", channel.accel_signs, ACCEL_UNIT[channel.accel_unit]
    )
    told = values.counted(~good, settled.stamp, epoch, "without a living attitude left out")
    gyro, accel, quaternion = _taken(gyro, keep), _taken(accel, keep), _taken(quaternion, keep)
    series = ImuSeries(settled.stamp[good], gyro, accel, quaternion, instantaneous)
    return series, settled.notes + told + no_gyro + no_accel


def gnss(table: Table, channel: Channel, epoch: int | None = None) -> tuple[GnssSeries, Notes]:
    """Position fixes; samples without a fix (negative status) or off the globe are left out.

    The covariance is NaN where the receiver does not state one.
    """
    position = np.column_stack([columns.scalar(table, channel, name) for name in ("latitude", "longitude", "altitude")])
    with np.errstate(invalid="ignore"):
        on_globe = (np.abs(position[:, 0]) <= 90.0) & (np.abs(position[:, 1]) <= 360.0)
    fixed = np.asarray(on_globe & np.isfinite(position[:, 2]))
    if columns.has(table, channel, "status"):
        fixed &= columns.scalar(table, channel, "status") >= 0
    settled = _settle(table, channel, epoch, position)
    good: np.ndarray = np.asarray(fixed)[settled.keep]
    _enough(int(np.count_nonzero(good)), 1)
    keep = settled.keep[good]
    told = values.counted(~good, settled.stamp, epoch, "without a fix left out")
    latitude, longitude, altitude = position[keep].T.copy()
    covariance = _position_covariance(table, channel)[keep]
    series = GnssSeries(settled.stamp[good], latitude * DEG, longitude * DEG, altitude, covariance)
    return series, settled.notes + told


def odometry(table: Table, channel: BodyChannel, epoch: int | None = None) -> tuple[OdometrySeries, Notes]:
    """The sled on the deck. A velocity that contradicts the positions is replaced by the positions' own."""
    R_hull_log = channel.hull_rotation
    position = columns.vector(table, channel, "position") @ R_hull_log.T
    settled = _settle(table, channel, epoch, position)
    stamp, position = settled.stamp, position[settled.keep]
    if columns.has(table, channel, "velocity"):
        velocity = columns.vector(table, channel, "velocity")[settled.keep] @ R_hull_log.T
    else:
        velocity = np.full_like(position, np.nan)
    finite = np.asarray(np.isfinite(position).all(axis=1))
    told = values.counted(~finite, stamp, epoch, "that are not finite left out")
    stamp, position, velocity = stamp[finite], position[finite], velocity[finite]
    _enough(len(stamp), MIN_SAMPLES)
    velocity, about_velocity = _agreeing_velocity(stamp, position, velocity)
    return OdometrySeries(stamp, position, velocity), settled.notes + told + about_velocity


def temperature(table: Table, channel: Channel, epoch: int | None = None) -> tuple[ScalarSeries, Notes]:
    """Temperature, deg C."""
    value = columns.scalar(table, channel, "temperature")
    settled = _settle(table, channel, epoch, value)
    value = value[settled.keep]
    good = np.isfinite(value) & (np.abs(value) < 500.0)
    _enough(int(np.count_nonzero(good)), 1)
    told = values.counted(~good, settled.stamp, epoch, "that are no temperature left out")
    return ScalarSeries(settled.stamp[good], value[good]), settled.notes + told


def truth(deformation: Table, channel: Channel, attitude_table: Table | None, about: Channel) -> Truth:
    """Truth of a simulated log."""
    parts = [columns.vector(deformation, channel, name) for name in ("total", "static_part", "dynamic_part")]
    settled = _settle(deformation, channel, None, *parts)
    good = np.logical_and.reduce([values.every(np.isfinite(part)) for part in parts])[settled.keep]
    _enough(int(np.count_nonzero(good)), 2)
    total, static_part, dynamic_part = (_taken(part, settled.keep[good]) for part in parts)
    when, attitudes = _true_attitude(attitude_table, about) if attitude_table else (None, None)
    return Truth(settled.stamp[good], total, static_part, dynamic_part, when, attitudes)


def _true_attitude(table: Table, channel: Channel) -> tuple[IntArray, FloatArray]:
    quaternion = columns.vector(
        table, channel.model_copy(update={"fields": {"orientation": "quaternion"}}), "orientation"
    )
    norm = attitude.norm_of(quaternion)
    settled = _settle(table, channel, None, quaternion)
    good = norm[settled.keep] > 0.5
    keep = settled.keep[good]
    return settled.stamp[good], _taken(quaternion, keep) / norm[keep, None]


def _settle(table: Table, channel: Channel, epoch: int | None, *data: FloatArray) -> stamps.Settled:
    def same(i: IntArray, j: IntArray) -> np.ndarray:
        equal = [(part[i] == part[j]).reshape(len(i), -1).all(axis=1) for part in data]
        return np.logical_and.reduce(equal)

    _enough(len(table), 1)
    return stamps.settle(columns.stamps(table, channel), np.asarray(table.log_time, dtype=np.int64), same, epoch)


def _taken(rows: FloatArray, keep: IntArray) -> FloatArray:
    """rows[keep], without a copy where that is all of them in order (the usual case, and the arrays are large)."""
    whole = len(keep) == len(rows) and bool((keep == np.arange(len(rows))).all())
    return rows if whole else rows[keep]


def _in_hull(table: Table, channel: ImuChannel, field: str, signs: tuple[int, int, int], unit: float) -> FloatArray:
    """A vector field in hull axes and SI: R_hull_log diag(signs) v unit."""
    log = columns.vector(table, channel, field)
    matrix = channel.hull_rotation * np.array(signs, dtype=float) * unit
    if np.array_equal(matrix, np.eye(3)):
        return log
    with np.errstate(invalid="ignore", over="ignore"):
        hull: FloatArray = log @ matrix.T
    return hull


def _optional(
    table: Table, channel: ImuChannel, field: str, signs: tuple[int, int, int], unit: float
) -> tuple[FloatArray, Notes]:
    if not columns.has(table, channel, field):
        return np.full((len(table), 3), np.nan), (f"publishes no {field}",)
    vectors = _in_hull(table, channel, field, signs, unit)
    if len(vectors) and (vectors == vectors[0]).all():
        return np.full((len(table), 3), np.nan), (f"its {field} is constant and left out",)
    return vectors, ()


def _attitude(table: Table, channel: ImuChannel, keep: IntArray) -> tuple[FloatArray | None, Notes]:
    """Attitude of an inertial unit at the samples kept; a placeholder or a patchy one counts as none."""
    found = attitude.attitude(table, channel)
    if found is None:
        return None, ()
    quaternion, given = _taken(found[0], keep), found[1][keep]
    if (quaternion == quaternion[0]).all():
        return None, ()
    if not given.all():
        return None, (f"its attitude is missing in {np.count_nonzero(~given)} samples and not used",)
    return quaternion, ()


def _position_covariance(table: Table, channel: Channel) -> FloatArray:
    covariance = columns.array(table, channel, "position_covariance", 9)
    if covariance is None:
        return np.full((len(table), 3, 3), np.nan)
    kind = table.columns.get("position_covariance_type")
    unknown = np.zeros(len(table), dtype=bool) if kind is None else np.asarray(kind) == 0
    return np.where(unknown[:, None], np.nan, covariance).reshape(-1, 3, 3)


def _agreeing_velocity(stamp: IntArray, position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, Notes]:
    """The velocity given, or the positions' own where there is none or the two contradict each other."""
    derived = np.gradient(position, (stamp - stamp[0]) * 1e-9, axis=0)
    if not np.isfinite(velocity).all():
        return derived, ("gives no velocity; that of its positions is used",)
    at, mean_position = windows(stamp, position)
    _, mean_velocity = windows(stamp, velocity)
    if len(at) < 3:
        return velocity, ()
    expected = np.gradient(mean_position, (at - at[0]) * 1e-9, axis=0)
    # where the sled has just started or stopped, or was set back, the two differ for good reasons
    off, size = (np.linalg.norm(part, axis=1) for part in (mean_velocity - expected, expected))
    moving = size > 0.2 * size.max()
    if float(np.median(off[moving] / size[moving])) > VELOCITY_AGREES:
        return derived, ("its velocity contradicts its positions (not in the deck frame?); the positions' own is used",)
    return velocity, ()


def _enough(count: int, least: int) -> None:
    if count < least:
        had = "no usable message" if count == 0 else f"only {count} usable message{'s' if count > 1 else ''}"
        raise DataError(f"it has {had}; at least {least} {'is' if least == 1 else 'are'} needed")
