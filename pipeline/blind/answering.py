"""Answers to a sealed set: a diagnosis of every log, resumable, each failure recorded and none fatal."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from pipeline.blind.folder import OPENED, OWN, Sealed, SealedLog, read_json, read_manifest, write_json
from pipeline.blind.pool import Progress, each
from pipeline.blind.vault import fingerprint
from schemas.errors import DataError

Diagnoser = Callable[[Path, Path, tuple[str, ...]], dict[str, Any]]
"""From a log, its twin and the effects that the library is denied, to a report as in the log contract."""

METHODS: dict[str, str] = {
    OWN: "pipeline.blind.answering:by_diagnosis",
    "largest_residual": "pipeline.blind.baselines:largest_residual",
    "global_nis": "pipeline.blind.baselines:global_nis",
    "in_sample": "pipeline.blind.baselines:in_sample",
    "bic": "pipeline.blind.baselines:bic",
}
BASELINES = tuple(name for name in METHODS if name != OWN)


@dataclass(frozen=True)
class Task:
    """One log to be answered by one method into one file."""

    log: Path
    twin: Path
    sha256: str
    without: tuple[str, ...]
    method: str
    target: Path


@dataclass(frozen=True)
class Answered:
    """What an answering run did: logs answered now, those that failed, those answered before."""

    answered: int
    failed: tuple[str, ...]
    before: int


def answer(
    folder: Path, *, method: str = OWN, diagnoser: str | None = None, without: Sequence[str] = (), workers: int = 1,
    retry: bool = False, progress: Progress | None = None,
) -> Answered:  # fmt: skip
    """Answer every log that has no answer yet. Raises DataError when the seal has been opened.

    diagnoser: ``module:function`` of a :data:`Diagnoser` in place of the method's own. without: effects that the
    library is denied in every log, beside those of the set itself. retry: failed logs once more.
    """
    sealed = read_manifest(folder)
    if (folder / OPENED).exists():
        raise DataError("the seal has been opened; answers given now would prove nothing", file=folder / OPENED)
    tasks = [_task(sealed, entry, method, diagnoser, tuple(without)) for entry in sealed.logs]
    left = [task for task in tasks if not _is_answered(task.target, retry)]
    failures = each(answer_one, left, workers, "answer", progress)
    failed = tuple(task.log.name for task, failure in zip(left, failures) if failure)
    return Answered(len(left) - len(failed), failed, len(tasks) - len(left))


def answer_one(task: Task) -> str:
    """Write the answer, or the failure, to its file; hand back the failure in a sentence, empty when there is none."""
    start = time.process_time()
    try:
        if fingerprint(task.log) != task.sha256:
            raise DataError("is not the file that was sealed", file=task.log)
        document = _finite(resolve(task.method)(task.log, task.twin, task.without))
    except Exception as error:
        sentence = " ".join(f"{type(error).__name__}: {error}".split())
        document = {"log": task.log.name, "failure": sentence}
    document["without"] = list(task.without)
    document["cpu_s"] = time.process_time() - start
    write_json(task.target, document)
    return str(document.get("failure", ""))


def resolve(method: str) -> Diagnoser:
    """The function behind the name of a method or ``module:function``; ValueError for neither."""
    module, colon, name = METHODS.get(method, method).partition(":")
    if not colon:
        raise ValueError(f"there is no method named '{method}' (there are {', '.join(METHODS)})")
    diagnoser: Diagnoser = getattr(import_module(module), name)
    return diagnoser


def by_diagnosis(log: Path, twin: Path, without: tuple[str, ...]) -> dict[str, Any]:
    """The project's own diagnosis, without the RMSE of estimators, which no score needs."""
    from pipeline.diagnosing import diagnose_log, report_document

    return report_document(diagnose_log(log, str(twin), shrink=False, without=without))


def _task(sealed: Sealed, entry: SealedLog, method: str, diagnoser: str | None, without: tuple[str, ...]) -> Task:
    denied = tuple(dict.fromkeys((*entry.without, *without)))
    target = sealed.answers(method) / f"{entry.name}.json"
    return Task(sealed.log(entry), sealed.twin(entry), entry.sha256, denied, diagnoser or method, target)


def _is_answered(target: Path, retry: bool) -> bool:
    if not target.exists():
        return False
    return not (retry and "failure" in read_json(target))


def _finite(value: Any) -> Any:
    """The document with numbers that JSON does not know as null."""
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
