"""Logs to measure on: synthetic, but of the contract's layout and of real size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schemas.wire import Table, write_log

_EPOCH = 1_767_225_600_000_000_000
IMU_TOPICS = ("/imu/main", "/imu/sub", "/phins/main", "/phins/sub")


def write_trial(path: Path, duration_s: float, compression: str = "zstd", *, vary: bool = False) -> int:
    """Four IMU topics at 100 Hz and GNSS at 1 Hz; the number of messages. vary: covariances change all the time."""
    rng = np.random.default_rng(1)
    tables = [_imu(topic, duration_s, rng, vary) for topic in IMU_TOPICS]
    tables.append(_gnss(duration_s, rng))
    write_log(path, tables, compression=compression)
    return sum(map(len, tables))


def _times(duration_s: float, rate: float, rng: np.random.Generator) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    stamp = _EPOCH + np.arange(round(duration_s * rate)) * round(1e9 / rate)
    return stamp, stamp + rng.integers(1_000_000, 5_000_000, len(stamp))


def _imu(topic: str, duration_s: float, rng: np.random.Generator, vary: bool) -> Table:
    stamp, log_time = _times(duration_s, 100.0, rng)
    n = len(stamp)
    t = (stamp - _EPOCH) * 1e-9
    frame = np.full(n, topic.strip("/").replace("/", "_"), dtype=object)
    columns: dict[str, NDArray[np.generic]] = {"header.stamp": stamp, "header.frame_id": frame}
    for k, axis in enumerate("xyzw"):
        columns[f"orientation.{axis}"] = np.cos(0.05 * np.sin(0.8 * t + k)) + 1e-5 * rng.standard_normal(n)
    for k, axis in enumerate("xyz"):
        columns[f"angular_velocity.{axis}"] = 0.1 * np.sin(0.8 * t + k) + 1e-4 * rng.standard_normal(n)
        columns[f"linear_acceleration.{axis}"] = 0.5 * np.cos(0.8 * t + k) + 1e-3 * rng.standard_normal(n)
    for name in ("orientation", "angular_velocity", "linear_acceleration"):
        columns[f"{name}_covariance"] = (
            1e-6 * np.tile(np.eye(3).ravel(), (n, 1)) * ((1.0 + 1e-3 * t[:, None]) if vary else 1.0)
        )
    return Table(topic, "sensor_msgs/msg/Imu", columns, log_time, log_time, np.arange(n, dtype=np.uint32))


def _gnss(duration_s: float, rng: np.random.Generator) -> Table:
    stamp, log_time = _times(duration_s, 1.0, rng)
    n = len(stamp)
    columns = {
        "header.stamp": stamp,
        "header.frame_id": np.full(n, "gnss", dtype=object),
        "latitude": 45.0 + 1e-6 * rng.standard_normal(n).cumsum(),
        "longitude": 126.0 + 1e-6 * rng.standard_normal(n).cumsum(),
        "altitude": 20.0 + rng.standard_normal(n),
        "position_covariance": np.tile(np.eye(3).ravel(), (n, 1)),
    }
    return Table("/gnss/fix", "sensor_msgs/msg/NavSatFix", columns, log_time, log_time, np.arange(n, dtype=np.uint32))
