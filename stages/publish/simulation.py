"""A simulation as a log: the input channels of the log contract, truth included, as tables to be written."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG
from schemas.rig import FloatArray
from schemas.trial import GnssSeries, ImuSeries, IntArray, OdometrySeries, ScalarSeries, Truth
from schemas.wire import Table
from stages.publish.tables import DECK_FRAME, MAIN_FRAME, vector
from twin.config import Twin
from twin.simulation import Simulation

ENU_FRAME = "enu"
SLIDING_FRAME = "sliding"
UNKNOWN = np.array([-1.0] + [0.0] * 8)  # covariance of what is not measured, or not known
UNTURNED = np.array([0.0, 0.0, 0.0, 1.0])
GYRO_VARIANCE = 1e-10  # rad^2/s^2, what the units themselves claim
ACCEL_VARIANCE = 1e-6  # m^2/s^4
IMU = "sensor_msgs/msg/Imu"


def simulation_tables(simulation: Simulation) -> list[Table]:
    """One table per channel the twin has, in the order of the contract; written at the time of measurement."""
    trial, twin = simulation.trial, simulation.twin
    tables = [imu_table("/imu/main", trial.main, MAIN_FRAME), imu_table("/imu/sub", trial.sub, "imu_sub")]
    for unit, series in (("main", trial.phins_main), ("sub", trial.phins_sub)):
        if series is not None:
            tables.append(phins_table(f"/phins/{unit}", series, f"phins_{unit}", twin))
    if trial.gnss is not None:
        tables.append(gnss_table(trial.gnss))
    for unit, reading in (("main", trial.temperature_main), ("sub", trial.temperature_sub)):
        if reading is not None:
            tables.append(temperature_table(f"/imu/{unit}/temperature", reading, f"imu_{unit}", twin.temperature.noise))
    if trial.sliding is not None:
        tables.append(imu_table("/sliding/imu", trial.sliding, SLIDING_FRAME))
    if trial.sled is not None and twin.deck is not None:
        tables.append(odometry_table(trial.sled, twin.deck.position_std, twin.deck.velocity_std))
    if twin.channels.truth:
        tables += truth_tables(simulation.truth)
    return tables


def imu_table(topic: str, series: ImuSeries, frame: str) -> Table:
    """An inertial unit without attitude: unit quaternion, orientation_covariance[0] = -1."""
    n = len(series)
    return _imu(topic, series, frame, constant(UNTURNED, n), constant(UNKNOWN, n))


def phins_table(topic: str, series: ImuSeries, frame: str, twin: Twin) -> Table:
    """An inertial unit with attitude and the variance of its errors (drift and noise; about east, north, up)."""
    if series.attitude is None:
        return imu_table(topic, series, frame)
    drift = np.array(twin.phins.attitude_drift_arcmin) / 60.0 * DEG
    variance = drift**2 + (twin.phins.attitude_noise_arcmin / 60.0 * DEG) ** 2
    return _imu(topic, series, frame, series.attitude, diagonal(variance, len(series)))


def gnss_table(series: GnssSeries) -> Table:
    """Fixes of a plain GNSS receiver, degrees and metres."""
    n = len(series.stamp)
    columns: dict[str, NDArray] = {
        "status.status": np.zeros(n, dtype=np.int8),
        "status.service": np.ones(n, dtype=np.uint16),
        "latitude": series.latitude / DEG,
        "longitude": series.longitude / DEG,
        "altitude": series.altitude,
        "position_covariance": series.covariance.reshape(n, 9),
        "position_covariance_type": np.full(n, 2, dtype=np.uint8),
    }
    return _table("/gnss/fix", "sensor_msgs/msg/NavSatFix", series.stamp, "gnss", columns)


def temperature_table(topic: str, series: ScalarSeries, frame: str, std: float) -> Table:
    """Readings in deg C."""
    columns = {"temperature": series.value, "variance": np.full(len(series.stamp), std**2)}
    return _table(topic, "sensor_msgs/msg/Temperature", series.stamp, frame, columns)


def odometry_table(series: OdometrySeries, position_std: float, velocity_std: float) -> Table:
    """The sled in the deck frame; its attitude is not measured (unit quaternion, no angular rate)."""
    n = len(series.stamp)
    columns: dict[str, NDArray] = {
        "child_frame_id": np.broadcast_to(SLIDING_FRAME, n),
        **vector("pose.pose.position", series.position),
        **_quaternion("pose.pose.orientation", constant(UNTURNED, n)),
        "pose.covariance": diagonal(np.array([position_std**2] * 3 + [0.0] * 3), n),
        **vector("twist.twist.linear", series.velocity),
        **vector("twist.twist.angular", constant(np.zeros(3), n)),
        "twist.covariance": diagonal(np.array([velocity_std**2] * 3 + [0.0] * 3), n),
    }
    return _table("/sliding/odom", "nav_msgs/msg/Odometry", series.stamp, DECK_FRAME, columns)


def truth_tables(truth: Truth) -> list[Table]:
    """Deformation (covariance unknown: it is exact) and the attitude of the sub-IMU, s into ENU."""
    columns = {
        **vector("total", truth.total),
        **vector("static_part", truth.static_part),
        **vector("dynamic_part", truth.dynamic_part),
        "covariance": constant(UNKNOWN, len(truth.stamp)),
    }
    tables = [_table("/truth/deformation", "deckflex_msgs/msg/Deformation", truth.stamp, MAIN_FRAME, columns)]
    if truth.attitude is not None and truth.attitude_stamp is not None:
        attitude = _quaternion("quaternion", truth.attitude)
        schema = "geometry_msgs/msg/QuaternionStamped"
        tables.append(_table("/truth/attitude", schema, truth.attitude_stamp, ENU_FRAME, attitude))
    return tables


def diagonal(variance: FloatArray, n: int) -> FloatArray:
    """The same row-major diagonal matrix in n rows, (n, k k), held once."""
    return constant(np.diag(variance).ravel(), n)


def constant(row: FloatArray, n: int) -> FloatArray:
    """The same row (k,) n times, (n, k), held once: most of a message never changes."""
    return np.broadcast_to(np.asarray(row, dtype=float), (n, len(row)))


def _imu(topic: str, series: ImuSeries, frame: str, orientation: FloatArray, covariance: FloatArray) -> Table:
    n = len(series)
    columns = {
        **_quaternion("orientation", orientation),
        "orientation_covariance": covariance,
        **vector("angular_velocity", series.gyro),
        "angular_velocity_covariance": diagonal(np.full(3, GYRO_VARIANCE), n),
        **vector("linear_acceleration", series.accel),
        "linear_acceleration_covariance": diagonal(np.full(3, ACCEL_VARIANCE), n),
    }
    return _table(topic, IMU, series.stamp, frame, columns)


def _quaternion(name: str, values: FloatArray) -> dict[str, FloatArray]:
    """Columns of a Quaternion from (n, 4) x, y, z, w."""
    return {f"{name}.{axis}": values[:, i] for i, axis in enumerate("xyzw")}


def _table(topic: str, schema: str, stamp: IntArray, frame: str, columns: Mapping[str, NDArray]) -> Table:
    n = len(stamp)
    header = {"header.stamp": stamp, "header.frame_id": np.broadcast_to(frame, n)}
    return Table(topic, schema, {**header, **columns}, stamp, stamp, np.arange(n, dtype=np.uint32))
