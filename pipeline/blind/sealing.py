"""A sealed set: logs and twins without a trace of the answer, and the answers under lock."""

from __future__ import annotations

import os
import secrets
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.blind.folder import ANSWERS, Sealed, SealedLog, write_manifest
from pipeline.blind.plan import Order, Wish, plan
from pipeline.blind.pool import Progress, each
from pipeline.blind.vault import fingerprint, lock, new_key
from schemas.errors import DataError
from schemas.trial import Trial
from schemas.wire import Table, write_log
from twin.config import Twin

MODIFIED = 1_700_000_000  # s, the date that every file of a set bears


@dataclass(frozen=True)
class Job:
    """One log to be written. seed: of this log alone."""

    folder: Path
    name: str
    seed: tuple[int, ...]
    order: Order


def seal(
    folder: Path, key: Path, count: int, wish: Wish, *, seed: int | None = None, workers: int = 1,
    progress: Progress | None = None,
) -> Sealed:  # fmt: skip
    """Draw a set into a folder that does not exist or is empty, and its key into a file elsewhere.

    seed: None for one that nobody knows. Raises DataError where anything stands in the way.
    """
    _prepare(folder, key)
    source = secrets.randbits(128) if seed is None else seed
    orders = plan(count, wish, np.random.default_rng([source, 0]))
    jobs = [Job(folder, f"{k:03d}", (source, k), order) for k, order in enumerate(orders, 1)]
    answers = each(write_one, jobs, workers, "seal", progress)
    locked, commitment = lock({"seed": str(source), "logs": answers}, new_key(key))
    (folder / ANSWERS).write_bytes(locked)
    sealed = Sealed(folder, tuple(_entry(job) for job in jobs), commitment, seed is None)
    write_manifest(sealed)
    for path in folder.iterdir():
        os.utime(path, (MODIFIED, MODIFIED))
    return sealed


def write_one(job: Job) -> dict[str, Any]:
    """Write a log and its twin; hand back the answer."""
    from pipeline.blind.reality.drawing import draw_case
    from twin.loading import dump_twin

    order = job.order
    drawn = draw_case(job.seed, effects=order.effects, duration=order.duration, severity=order.severity or None)
    clocks = np.random.default_rng([*job.seed, 1])
    write_log(job.folder / f"{job.name}.mcap", recorded(drawn.trial, drawn.twin, clocks))
    (job.folder / f"{job.name}.twin.toml").write_text(dump_twin(drawn.twin), "utf-8")
    return {"name": job.name, "kind": order.kind, "without": list(order.without), **drawn.answer}


def recorded(trial: Trial, twin: Twin, rng: np.random.Generator) -> list[Table]:
    """The channels of the log contract, each message written a little after it was measured; no truth."""
    from stages.publish import simulation as wire

    tables = [
        wire.imu_table("/imu/main", trial.main, "imu_main"),
        wire.imu_table("/imu/sub", trial.sub, "imu_sub"),
    ]
    for unit, series in (("main", trial.phins_main), ("sub", trial.phins_sub)):
        if series is not None:
            tables.append(wire.phins_table(f"/phins/{unit}", series, f"phins_{unit}", twin))
    if trial.gnss is not None:
        tables.append(wire.gnss_table(trial.gnss))
    for unit, reading in (("main", trial.temperature_main), ("sub", trial.temperature_sub)):
        if reading is not None:
            tables.append(wire.temperature_table(f"/imu/{unit}/temperature", reading, f"imu_{unit}", 0.01))
    return [_late(table, rng) for table in tables]


def _late(table: Table, rng: np.random.Generator) -> Table:
    """Written 0.4 ms and more after the stamp, in the order of the stamps."""
    delay = 400_000 + np.rint(500_000.0 * rng.standard_exponential(len(table))).astype(np.int64)
    written = np.maximum.accumulate(table.log_time + delay)
    return replace(table, log_time=written, publish_time=written)


def _entry(job: Job) -> SealedLog:
    log, twin = job.folder / f"{job.name}.mcap", job.folder / f"{job.name}.twin.toml"
    return SealedLog(job.name, fingerprint(log), fingerprint(twin), job.order.without)


def _prepare(folder: Path, key: Path) -> None:
    """The folder made; DataError if it holds something, or the key is there already or would lie in the folder."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DataError("is not an empty directory; a set is sealed into a new one", file=folder)
    if key.exists():
        raise DataError("exists already; a key is never overwritten", file=key)
    if folder.resolve() in key.resolve().parents:
        raise DataError("would lie in the set that it opens; name another place for the key", file=key)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"cannot be made: {error.strerror}", file=folder) from error
