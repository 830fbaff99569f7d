"""Real processes: the command, a scheduler, workers; killed for real, and gone when the test is."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

COMMAND = [sys.executable, "-c", "from pipeline.cli import main; main()"]
PATIENCE = 180.0  # s, on a machine that has other things to do


def started(*words: object, folder: Path) -> subprocess.Popen[bytes]:
    """The command as a process group of its own; what it says goes to files in the folder."""
    out, err = (folder / "out.txt").open("wb"), (folder / "err.txt").open("wb")
    return subprocess.Popen([*COMMAND, *map(str, words)], stdout=out, stderr=err, start_new_session=True)


def until(true: Callable[[], object], what: str) -> None:
    """Wait for it."""
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end, f"no {what}"
        time.sleep(0.02)


def entries(out: Path, state: str = "done") -> list[Path]:
    return sorted((out / "manifest").glob(f"*.{state}.json"))


def check_whole(out: Path) -> None:
    """Every entry is JSON and its files are there; nothing visible is half of anything."""
    for entry in entries(out):
        document = json.loads(entry.read_bytes())
        for name in document["files"].values():
            assert (out / name).read_bytes()[-8:] == b"\x89MCAP0\r\n", f"{name} is cut short"
    for path in (out / "inputs").glob("*"):
        json.loads(path.read_bytes())


class Cluster:
    """A scheduler and its workers."""

    def __init__(self, folder: Path, workers: int = 2) -> None:
        self.folder, self.workers = folder, []
        place = folder / "scheduler.json"
        words = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(place)]
        self.scheduler = self._dask(*words)
        until(lambda: place.exists() and place.stat().st_size, "scheduler")
        self.address = json.loads(place.read_text())["address"]
        for _ in range(workers):
            self.add()

    def add(self) -> None:
        words = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(self.folder)]
        self.workers.append(self._dask("worker", self.address, *words))

    def _dask(self, *words: str) -> subprocess.Popen[bytes]:
        said = (self.folder / f"{words[0]}-{time.monotonic_ns()}.txt").open("wb")
        return subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]],
                                stdout=said, stderr=said)  # fmt: skip

    def stop(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()
