"""Throughput of ``deckflex batch``: hours of log a minute with 1 and 2 workers, and what the scheduler itself costs.

    python -m benchmarks.batch [--logs 500] [--seconds 60] [--repeats 3] [--estimator smoother] [--folder FOLDER]

The logs are short simulated ones at different dates, so that every one has a content of its own. One and two workers
run in turns over the same logs into fresh archives; each run is a process of its own, and what it takes to start
counts. The figure for the workers alone leaves the start out: it begins when each worker has ended its first log. The
last lines are the cost of a second run over an archive in which all is done, and of hashing and scheduling alone.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schemas.wire import Table, write_log
from stages.publish.simulation import simulation_tables
from twin import load_twin, make_twin, simulate

COMMAND = [sys.executable, "-c", "from pipeline.cli import main; main()"]
BASES = 8  # simulations; the others are these at other dates
DAY_NS = 86_400_000_000_000


@dataclass(frozen=True)
class Measured:
    """One run: hours of log, wall and CPU seconds of the whole command, and wall seconds between first and last log."""

    hours: float
    wall: float
    cpu: float
    steady_hours: float
    steady: float


def main() -> None:
    """Make logs, run them with one and two workers in turns, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--estimator", default="smoother")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        logs = made_logs(folder, options.logs, options.seconds)
        batch(made_logs(folder, 2, options.seconds), folder / "warm", 2, options.estimator)  # compiles what is not yet
        print(f"{options.logs} logs of {options.seconds:g} s, estimator {options.estimator}, {os.cpu_count()} cores")
        print(
            f"{'workers':>8} {'wall s':>8} {'CPU s':>8} {'h/min, all':>11} {'h/min, at work':>15} {'CPU s a log':>12}"
        )
        runs: dict[int, list[Measured]] = {1: [], 2: []}
        for _ in range(options.repeats):
            for workers, found in runs.items():
                found.append(batch(logs, folder / f"out{workers}", workers, options.estimator))
                print_run(workers, found[-1], options.logs)
        print_ratios(runs)
        print_overheads(logs, folder / "out2", options.estimator, options.logs)


def made_logs(folder: Path, count: int, seconds: float) -> Path:
    """A folder of so many logs; made once where the folder stays."""
    logs = folder / f"logs-{count}-{seconds:g}"
    if not logs.exists():
        work = folder / "making"
        work.mkdir(parents=True)
        bases = [simulated(seed, seconds) for seed in range(min(BASES, count))]
        for k in range(count):
            write_log(work / f"voyage-{k:05d}.mcap", [later(table, k * DAY_NS) for table in bases[k % BASES]])
        work.rename(logs)
    return logs


def simulated(seed: int, seconds: float) -> list[Table]:
    """A short trial at 100 Hz with PHINS, GNSS and truth."""
    table = load_twin("idam-ship").model_dump(exclude_none=True)
    table["run"] |= {"duration": seconds, "seed": seed}
    return simulation_tables(simulate(make_twin(table), np.random.default_rng(seed)))


def later(table: Table, by: int) -> Table:
    """The same channel at another date."""
    columns = {**table.columns, "header.stamp": table.columns["header.stamp"] + by}
    return Table(table.topic, table.schema, columns, table.log_time + by, table.publish_time + by, table.sequence)


def batch(logs: Path, out: Path, workers: int, estimator: str) -> Measured:
    """One run into a fresh archive."""
    shutil.rmtree(out, ignore_errors=True)
    document, wall, cpu, ends = timed(logs, out, "--workers", str(workers), "--estimator", estimator)
    each = document["hours"] / max(document["done"], 1)
    return Measured(document["hours"], wall, cpu, each * (len(ends) - workers), ends[-1] - ends[workers - 1])


def timed(logs: Path, out: Path, *words: str) -> tuple[dict, float, float, list[float]]:
    """What the command said, its wall and CPU seconds with all its workers, and when each log ended."""
    start, before = time.perf_counter(), os.times()
    command = [*COMMAND, "batch", str(logs), "-o", str(out), "--json", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    ends = [time.perf_counter() - start for _ in process.stderr]
    document = json.loads(process.stdout.read())
    if process.wait():
        raise SystemExit(f"batch failed: {document}")
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return document, time.perf_counter() - start, max(cpu, document["cpu_s"]), ends


def print_run(workers: int, run: Measured, logs: int) -> None:
    """One line."""
    rate, steady = 60.0 * run.hours / run.wall, 60.0 * run.steady_hours / run.steady
    print(f"{workers:8} {run.wall:8.1f} {run.cpu:8.1f} {rate:11.3f} {steady:8.3f} {run.cpu / logs:12.3f}", flush=True)


def print_ratios(runs: dict[int, list[Measured]]) -> None:
    """Two workers over one, run by run, so that a busy machine touches both alike."""
    pairs = list(zip(runs[1], runs[2]))
    whole = [a.wall / b.wall for a, b in pairs]
    steady = [(b.steady_hours / b.steady) / (a.steady_hours / a.steady) for a, b in pairs]
    for name, ratios in (("all", whole), ("at work", steady)):
        spread = " ".join(f"{ratio:.2f}" for ratio in ratios)
        print(f"2 workers over 1, {name}: {statistics.median(ratios):.2f} (runs: {spread})")


def print_overheads(logs: Path, out: Path, estimator: str, count: int) -> None:
    """A second run that finds everything done, and one that looks into every log again: hashing and scheduling."""
    document, wall, cpu, _ = timed(logs, out, "--estimator", estimator)
    print(f"second run: {wall:.1f} s, {cpu:.1f} s of CPU, {document['done_before']} done before")
    document, wall, cpu, ends = timed(logs, out, "--estimator", estimator, "--rehash", "--workers", "2")
    each = 1e3 * (ends[-1] - ends[1]) / max(len(ends) - 2, 1)
    print(f"every log hashed again: {wall:.1f} s, {cpu:.1f} s of CPU; {each:.1f} ms a log once the workers run")
    sizes = [sum(path.stat().st_size for path in of.rglob("*") if path.is_file()) / count / 1e6 for of in (out, logs)]
    print(f"archive: {sizes[0]:.3f} MB a log; the logs themselves {sizes[1]:.3f} MB")


if __name__ == "__main__":
    main()
