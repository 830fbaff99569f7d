"""Diagnosis of simulated logs: ``deckflex diagnose`` from log to report.

    python -m benchmarks.diagnose [--minutes 15 120] [--twin random-sea] [--folder FOLDER]

The log's time delay is a millisecond off the twin's, so that there is something to find. Each run is a process of its
own; its start counts.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.run import timed
from schemas.wire import write_log
from stages.diagnose.shrinkage import augmented_twin
from stages.publish.simulation import simulation_tables
from twin import effects, load_twin, parse_twin, simulate, with_run


def made_log(path: Path, twin: str, minutes: float) -> None:
    """A log of the twin with a delay that it does not have."""
    changed = augmented_twin(
        with_run(load_twin(twin), duration=60.0 * minutes), [effects.build("time_delay", {"delay": 1e-3})]
    )
    write_log(path, simulation_tables(simulate(parse_twin(changed), np.random.default_rng(1))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[15.0, 120.0])
    parser.add_argument("--twin", default="random-sea")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    print(f"{'minutes':>8} {'wall s':>9} {'CPU s':>9} {'x real time':>12} {'peak GB':>9}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for minutes in options.minutes:
            log = folder / f"diagnose-{minutes:g}.mcap"
            if not log.exists():
                made_log(log, options.twin, minutes)
            wall, cpu, memory = timed(["diagnose", str(log), "--twin", options.twin, "-o", str(folder / "found.json")])
            print(f"{minutes:8g} {wall:9.1f} {cpu:9.1f} {60 * minutes / wall:12.0f} {memory:9.2f}", flush=True)


if __name__ == "__main__":
    main()
