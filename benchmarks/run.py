"""The whole job on simulated logs of growing length: real-time factor and peak memory of ``deckflex run``, all written.

    python -m benchmarks.run [--minutes 15 60 120 480] [--day] [--twin idam-ship] [--folder FOLDER]

Each run is a process of its own, timed from outside; its cost should grow in proportion to the length of the log: the
last column is CPU seconds for an hour of log. With ``--day`` 24 hours follow, which take a quarter of an hour, 8 GB of
memory to simulate and 20 GB of disk.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMMAND = [sys.executable, "-c", "from pipeline.cli import main; main()"]


def timed(arguments: list[str]) -> tuple[float, float, float]:
    """Wall seconds, CPU seconds and peak memory (GB) of one command."""
    start = time.perf_counter()
    process = subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - start
    if status != 0:
        raise SystemExit(f"deckflex {' '.join(arguments)} failed")
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e6


def measure(minutes: float, twin: str, folder: Path) -> None:
    """Simulate, run and print one line."""
    log = folder / f"{twin}-{minutes:g}.mcap"
    if not log.exists():
        timed(["simulate", twin, "--duration", str(60 * minutes), "--seed", "1", "-o", str(log)])
    out, recording = folder / "out.mcap", folder / "out.rrd"
    for path in (out, recording):
        path.unlink(missing_ok=True)
    wall, cpu, memory = timed(["run", str(log), "-o", str(out), "--rrd", str(recording)])
    size, speed = log.stat().st_size / 1e6, 60 * minutes / wall
    print(
        f"{minutes:8g} {size:9.0f} {wall:9.1f} {cpu:9.1f} {speed:12.0f} {memory:9.2f} {60 * cpu / minutes:9.1f}",
        flush=True,
    )


def main() -> None:
    """Measure each length in turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[15.0, 60.0, 120.0, 480.0])
    parser.add_argument("--day", action="store_true")
    parser.add_argument("--twin", default="idam-ship")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    print(f"{'minutes':>8} {'log MB':>9} {'wall s':>9} {'CPU s':>9} {'x real time':>12} {'peak GB':>9} {'CPU s/h':>9}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        measure(1.0, options.twin, folder)  # compiles what is not compiled yet
        for minutes in [*options.minutes, *([1440.0] if options.day else [])]:
            measure(minutes, options.twin, folder)


if __name__ == "__main__":
    main()
