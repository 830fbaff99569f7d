"""A batch: plan, work, tell. Everything that must not be lost is written by the workers, log by log."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pipeline.archive.config import Config
from pipeline.archive.jobs import Outcome, State
from pipeline.archive.manifest import ASIDE, DONE, entry_name, open_archive, read_entry
from pipeline.archive.planning import Plan, planned
from pipeline.archive.stores import Store, open_store
from pipeline.archive.workers import Wish, crew, limited
from schemas.errors import DataError

HOUR = 3600.0
UNSEEN = "a worker wrote its result, but it is not seen from here: the output must be where all workers reach it"


@dataclass(frozen=True)
class Step:
    """A log that ended. done, total: how many. left_s: time that the rest will take, None where unknown."""

    outcome: Outcome
    done: int
    total: int
    left_s: float | None


class Listener:
    """Hears how a batch goes on; this one keeps it to itself."""

    def begun(self, total: int) -> None:
        """The workers are there, with so many logs to do."""

    def ended(self, step: Step) -> None:
        """A log ended."""


@dataclass
class Summary:
    """What a batch came to. aside, failed: (log, name, reason). stopped: why it ended early, empty where it did not."""

    output: str
    logs: int
    done: int = 0
    done_before: int = 0
    same: int = 0
    aside: list[tuple[str, str, str]] = field(default_factory=list)
    failed: list[tuple[str, str, str]] = field(default_factory=list)
    notes: tuple[str, ...] = ()
    hours: float = 0.0
    cpu_s: float = 0.0
    wall_s: float = 0.0
    peak_memory: float = 0.0
    workers: int = 0
    stopped: str = ""

    @property
    def whole(self) -> bool:
        """Whether every log has a result."""
        return not (self.aside or self.failed or self.stopped)

    @property
    def left(self) -> int:
        """Logs that were not come to, or whose results could not be kept."""
        ended = self.done + self.done_before + self.same + len(self.aside) + len(self.failed)
        return self.logs - ended

    @property
    def hours_per_minute(self) -> float | None:
        """Hours of log in a minute, None where nothing was worked on."""
        return self.hours / (self.wall_s / 60.0) if self.hours and self.wall_s else None

    def add(self, outcome: Outcome) -> None:
        """Count a log that ended."""
        told = (outcome.source.address, outcome.source.name, outcome.reason)
        self.done += outcome.state is State.DONE
        self.done_before += outcome.state is State.BEFORE
        self.same += outcome.state is State.KNOWN
        if outcome.state is State.ASIDE:
            self.aside.append(told)
        elif outcome.state is State.FAILED:
            self.failed.append(told)
        elif outcome.state is State.STORE:
            self.stopped = self.stopped or outcome.reason
        self.hours += outcome.duration_s / HOUR
        self.cpu_s += outcome.cpu_s
        self.peak_memory = max(self.peak_memory, outcome.memory)

    def document(self) -> dict[str, Any]:
        """As JSON."""
        listed = {name: [dict(zip(("log", "name", "reason"), row)) for row in getattr(self, name)]
                  for name in ("aside", "failed")}  # fmt: skip
        return {
            "output": self.output,
            "logs": self.logs,
            "done": self.done,
            "done_before": self.done_before,
            "same_content": self.same,
            "set_aside": listed["aside"],
            "failed": listed["failed"],
            "left": self.left,
            "stopped": self.stopped or None,
            "notes": list(self.notes),
            "hours": self.hours,
            "wall_s": self.wall_s,
            "cpu_s": self.cpu_s,
            "hours_per_minute": self.hours_per_minute,
            "peak_memory_gb": self.peak_memory / 1e9,
            "workers": self.workers,
        }


def run_batch(
    words: Sequence[str],
    output: str,
    config: Config,
    wish: Wish,
    *,
    retry: bool = False,
    rehash: bool = False,
    listener: Listener | None = None,
) -> Summary:
    """Every log that the words name, into the archive at output. Raises DataError where nothing can be done at all."""
    store = open_store(output)
    plan = planned(words, store, config, retry=retry, rehash=rehash)
    store.sweep()
    open_archive(store, writing=bool(plan.jobs))
    summary = begun(plan, store)
    start = time.perf_counter()
    try:
        if plan.jobs:
            _work(plan, store, wish, summary, listener or Listener())
    except DataError as error:
        summary.stopped = str(error)
    finally:
        store.sweep()
    summary.wall_s = time.perf_counter() - start
    return summary


def begun(plan: Plan, store: Store) -> Summary:
    """What is known before the work: done, set aside, unreadable."""
    summary = Summary(store.root, plan.logs, done_before=len(plan.done), same=len(plan.same), notes=plan.notes)
    for source, key in plan.aside:
        try:
            reason = str(read_entry(store, key, ASIDE).get("reason", ""))
        except DataError as error:  # it was set aside, whatever became of the reason
            reason = str(error)
        summary.aside.append((source.address, source.name, reason))
    summary.failed += [(name, name, reason) for name, reason in plan.unreadable]
    return summary


def _work(plan: Plan, store: Store, wish: Wish, summary: Summary, listener: Listener) -> None:
    clock = Clock(plan)
    with crew(wish, len(plan.jobs)) as workers:
        summary.workers = workers.threads
        listener.begun(len(plan.jobs))
        for number, outcome in enumerate(workers.outcomes(limited(plan.jobs, wish)), 1):
            summary.add(outcome)
            listener.ended(Step(outcome, number, len(plan.jobs), clock.left(outcome)))
            if outcome.state is State.DONE and summary.done == 1 and not store.exists(entry_name(outcome.key, DONE)):
                raise DataError(UNSEEN, file=store.root)


class Clock:
    """Time left, by bytes worked on where all sizes are known, else by logs."""

    def __init__(self, plan: Plan) -> None:
        sizes = [job.source.size for job in plan.jobs]
        self.by_size = all(sizes)
        self.rest = float(sum(size or 0 for size in sizes)) if self.by_size else float(len(sizes))
        self.start, self.worked = time.perf_counter(), 0.0

    def left(self, outcome: Outcome) -> float | None:
        """Seconds that the rest will take if it goes on like this."""
        share = float(outcome.source.size or 0) if self.by_size else 1.0
        self.rest -= share
        self.worked += share
        took = time.perf_counter() - self.start
        return took * self.rest / self.worked if self.worked else None
