"""Mutations of channels and samples: tables of a sound log by topic, changed in place."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.wire import Table
from tests.stages.decode.synthetic import changed, selected

Tables = dict[str, Table]
Change = Callable[[Table], Table]
Mutation = Callable[[Tables], None]
MAIN, SUB = "/imu/main", "/imu/sub"
G = 9.80665
SECOND = 1_000_000_000


def on(topics: str | Iterable[str], change: Change) -> Mutation:
    """The change on one channel or several."""

    def mutate(tables: Tables) -> None:
        for topic in [topics] if isinstance(topics, str) else topics:
            tables[topic] = change(tables[topic])

    return mutate


def everywhere(change: Change) -> Mutation:
    def mutate(tables: Tables) -> None:
        for topic in tables:
            tables[topic] = change(tables[topic])

    return mutate


def without(*topics: str) -> Mutation:
    def mutate(tables: Tables) -> None:
        for topic in topics:
            del tables[topic]

    return mutate


def seconds(table: Table) -> np.ndarray:
    """Since the first stamp of the channel."""
    stamp = table.columns["header.stamp"]
    return (stamp - stamp[0]) * 1e-9


def kept(keep: Callable[[np.ndarray], np.ndarray]) -> Change:
    """The rows for which keep(seconds) holds."""
    return lambda table: selected(table, np.flatnonzero(keep(seconds(table))))


def gap(start: float, stop: float) -> Change:
    return kept(lambda t: (t < start) | (t > stop))


def vector(name: str, act: Callable[[np.ndarray], np.ndarray]) -> Change:
    """act on the (n, 3) vectors of a field."""

    def change(table: Table) -> Table:
        values = act(table.vector(name).copy())
        columns = dict(table.columns) | {f"{name}.{axis}": values[:, k].copy() for k, axis in enumerate("xyz")}
        return Table(table.topic, table.schema, columns, table.log_time, table.publish_time, table.sequence)

    return change


def gyro(act: Callable[[np.ndarray], np.ndarray]) -> Change:
    return vector("angular_velocity", act)


def accel(act: Callable[[np.ndarray], np.ndarray]) -> Change:
    return vector("linear_acceleration", act)


def both(act: Callable[[np.ndarray], np.ndarray]) -> Change:
    return lambda table: accel(act)(gyro(act)(table))


def put(rows: slice, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def act(values: np.ndarray) -> np.ndarray:
        values[rows] = value
        return values

    return act


def frozen(rows: slice) -> Callable[[np.ndarray], np.ndarray]:
    def act(values: np.ndarray) -> np.ndarray:
        values[rows] = values[rows.start]
        return values

    return act


def clipped(share: float) -> Callable[[np.ndarray], np.ndarray]:
    """Every axis clipped at a share of its largest value."""

    def act(values: np.ndarray) -> np.ndarray:
        limit = share * np.abs(values).max(axis=0)
        return np.clip(values, -limit, limit)

    return act


def spikes(count: int, size: float) -> Callable[[np.ndarray], np.ndarray]:
    def act(values: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(3)
        values[rng.choice(len(values), count, replace=False), rng.integers(0, 3, count)] += size
        return values

    return act


def stamped(act: Callable[[np.ndarray], np.ndarray]) -> Change:
    return lambda table: changed(table, header__stamp=act)


def late(shift: float) -> Change:
    """By a clock that differs by so many seconds."""
    return stamped(lambda stamp: stamp + round(shift * SECOND))


def set_back(at: float, by: float) -> Change:
    """The unit's clock is set back in the midst of the record."""
    return stamped(lambda stamp: np.where(stamp - stamp[0] > at * SECOND, stamp - round(by * SECOND), stamp))


def duplicated(table: Table) -> Table:
    """Every tenth message twice."""
    rows = np.arange(len(table))
    return selected(table, np.sort(np.concatenate([rows, rows[::10]])))


def disordered(table: Table) -> Table:
    """Runs of ten messages swapped here and there."""
    rows = np.arange(len(table) // 20 * 20).reshape(-1, 2, 10)
    rows[::5] = rows[::5, ::-1]
    return selected(table, rows.ravel())


def halved(table: Table) -> Table:
    """Half the rate: means over two samples, stamped at the end of the second."""
    pairs = len(table) // 2 * 2
    second = selected(table, np.arange(1, pairs, 2))
    columns = dict(second.columns)
    for name in ("angular_velocity", "linear_acceleration"):
        means = table.vector(name)[:pairs].reshape(-1, 2, 3).mean(axis=1)
        columns |= {f"{name}.{axis}": means[:, k].copy() for k, axis in enumerate("xyz")}
    return Table(table.topic, table.schema, columns, second.log_time, second.publish_time, second.sequence)


def retyped(table: Table) -> Table:
    """The channel under another message type."""
    columns = {name: table.columns[name] for name in ("header.stamp", "header.frame_id")}
    columns |= {"temperature": np.zeros(len(table)), "variance": np.zeros(len(table))}
    return Table(
        table.topic, "sensor_msgs/msg/Temperature", columns, table.log_time, table.publish_time, table.sequence
    )


def reversed_in_time(values: np.ndarray) -> np.ndarray:
    """What another ship might have measured."""
    return values[::-1].copy()


def swapped(first: int, second: int) -> Callable[[np.ndarray], np.ndarray]:
    """Two axes exchanged: the system is left-handed."""

    def act(values: np.ndarray) -> np.ndarray:
        values[:, [first, second]] = values[:, [second, first]]
        return values

    return act


def compensated(tables: Tables) -> None:
    """The sub-IMU publishes acceleration: gravity taken out by its PHINS' attitude."""
    attitude = Rotation.from_quat(tables["/phins/sub"].quaternion("orientation"))
    tables[SUB] = accel(lambda values: values - attitude.inv().apply([0.0, 0.0, G]))(tables[SUB])
