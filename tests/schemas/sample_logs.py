"""Small tables and logs to test on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schemas.wire import Table, write_log

EPOCH = 1_700_000_000_000_000_000


def imu(topic: str = "/imu/main", n: int = 200, seed: int = 0) -> Table:
    """Every field different in every row."""
    rng = np.random.default_rng(seed)
    stamp = EPOCH + np.arange(n) * 10_000_000
    columns = {"header.stamp": stamp, "header.frame_id": np.full(n, "imu", dtype=object)}
    for name, axes in (("orientation", "xyzw"), ("angular_velocity", "xyz"), ("linear_acceleration", "xyz")):
        columns |= {f"{name}.{axis}": rng.standard_normal(n) for axis in axes}
        columns[f"{name}_covariance"] = rng.standard_normal((n, 9))
    log_time = stamp + rng.integers(0, 9_000_000, n)
    return Table(topic, "sensor_msgs/msg/Imu", columns, log_time, log_time - 5, np.arange(n, dtype=np.uint32))


def score(n: int = 40) -> Table:
    """Strings of varying length, also of equal total length."""
    stamp = EPOCH + np.arange(n) * 50_000_000
    names = np.array([("smoother", "a", "", "é")[k % 4] for k in range(n)], dtype=object)
    other = np.array([("t", "truth-xy", "phins", "")[k % 4] for k in range(n)], dtype=object)
    columns = {"header.stamp": stamp, "estimator": names, "reference": other, "duration": np.arange(n) * 1.0}
    return Table("/deckflex/score", "deckflex_msgs/msg/Score", columns, stamp, stamp, np.zeros(n, np.uint32))


def small_log(path: Path, compression: str = "zstd", chunk_bytes: int = 20_000) -> list[Table]:
    """A log of several chunks; its tables."""
    tables = [imu(), imu("/imu/sub", seed=1), score()]
    write_log(path, tables, compression=compression, chunk_bytes=chunk_bytes, metadata={"voyage": {"ship": "A"}})
    return tables


def assert_same(one: Table, other: Table) -> None:
    """Times are equal, and so is every column that one has."""
    for name in ("log_time", "publish_time", "sequence"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for path, values in one.columns.items():
        assert np.array_equal(values, other.columns[path]), path
