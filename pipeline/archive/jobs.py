"""A log to work on, and what came of it: plain data that goes to a worker and back."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from pipeline.archive.source import Source


class State(StrEnum):
    """How a log ended. KNOWN: another log of the same content is done. BEFORE: its result is there already.

    FAILED: not this time, the next run tries again. STORE: results cannot be written.
    """

    DONE = "done"
    KNOWN = "known"
    BEFORE = "there"
    ASIDE = "set aside"
    FAILED = "not now"
    STORE = "not kept"


@dataclass(frozen=True)
class Job:
    """sha256: of the content where it is known. marks: of the address, that hold no longer when its content changed.

    memory: bytes the log may take, None for what the worker has. retry: also where it was set aside before.
    """

    source: Source
    config: dict[str, Any]
    store: str
    sha256: str | None = None
    marks: tuple[str, ...] = ()
    memory: float | None = None
    retry: bool = False


@dataclass(frozen=True)
class Outcome:
    """What came of a log. reason: why not, or what was odd. figures: what its line says."""

    source: Source
    state: State
    key: str = ""
    reason: str = ""
    figures: str = ""
    grade: str = ""
    duration_s: float = 0.0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    memory: float = 0.0
