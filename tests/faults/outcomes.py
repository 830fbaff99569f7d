"""What a fault may lead to, and what is checked whatever it leads to."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schemas.wire import Table, read_log
from tests.pipeline.running import Outcome, run_command

MEMORY = 1 << 31  # bytes a run may take beyond what the tests hold; a log of a minute needs a tenth
SECONDS = 30.0  # of CPU, on a machine that has other things to do
SIGMAS = 4.0  # an error larger than this is a confident wrong answer
FLOOR = 0.2e-3 * np.pi / 180.0  # rad; errors smaller than this are none


@dataclass(frozen=True)
class Refused:
    """Exit status 1 and one line that holds all these words."""

    words: tuple[str, ...]


@dataclass(frozen=True)
class Answered:
    """An estimate that its covariance covers, and a warning that holds all these words (none: as if nothing were).

    least: share of the sound log's samples that are estimated. worst: RMSE per axis, arcmin.
    """

    words: tuple[str, ...] = ()
    least: float = 0.9
    worst: tuple[float, float, float] = (1.5, 1.5, 20.0)


def run(log: Path, out: Path) -> Outcome:
    """The main job under a lid on memory and time."""
    started = time.process_time()
    with address_space(MEMORY):
        told = run_command("run", log, "-o", out, "--json")
    assert time.process_time() - started < SECONDS
    return told


@contextmanager
def address_space(more: int) -> Iterator[None]:
    """Let the process take so many bytes more than it has, and no more."""
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if Path("/proc/self/statm").exists() else None
    before = resource.getrlimit(resource.RLIMIT_AS)
    if pages is not None:
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + more, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def assert_refused(told: Outcome, expected: Refused, log: Path, out: Path) -> None:
    assert told.status == 1, told.out[:200]
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert "internal error" not in told.err
    assert "memory" not in told.err
    assert log.name in told.err
    assert [word for word in expected.words if word not in told.err] == [], told.err
    assert not list(out.iterdir()), "nothing half-written"


def assert_answered(told: Outcome, expected: Answered, out: Path, truth: Table) -> None:
    assert told.status == 0, told.err
    assert told.err == ""
    warnings = json.loads(told.out)["warnings"]
    if expected.words:
        assert any(all(word in warning for word in expected.words) for warning in warnings), warnings
    assert [path.name for path in out.iterdir()] == ["out.mcap"]
    rmse, sigma, share = errors(out / "out.mcap", truth)
    assert share >= expected.least
    arcmin = np.deg2rad(1.0 / 60.0)
    assert (rmse / arcmin < expected.worst).all(), rmse / arcmin
    assert (rmse < SIGMAS * sigma + FLOOR).all(), f"{rmse / sigma} sigma"


def errors(written: Path, truth: Table) -> tuple[np.ndarray, np.ndarray, float]:
    """RMSE (3,) rad against the truth, what the covariance says it is (3,), and the share of samples answered."""
    table = read_log(written, ["/deckflex/deformation"]).tables["/deckflex/deformation"]
    stamp = table.columns["header.stamp"]
    when = truth.columns["header.stamp"]
    inside = (stamp >= when[0]) & (stamp <= when[-1])
    true = np.column_stack([np.interp(stamp, when, column) for column in truth.vector("total").T])
    error = (table.vector("total") - true)[inside]
    variance = table.columns["covariance"][:, [0, 4, 8]][inside]
    assert np.isfinite(error).all()
    assert (variance > 0.0).all()
    return np.sqrt((error**2).mean(axis=0)), np.sqrt(variance.mean(axis=0)), inside.sum() / len(when)
