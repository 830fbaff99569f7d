"""One log of an archive from its address to its entry in the manifest: what a worker does, wherever it runs.

It hands back an outcome and never raises: a log may be anything, and none may stop the rest.
"""

from __future__ import annotations

import re
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.archive import memory
from pipeline.archive.config import Config, config_of, key_of
from pipeline.archive.entries import facts, heading
from pipeline.archive.jobs import Job, Outcome, State
from pipeline.archive.manifest import ASIDE, DONE, RESULTS, note_content, read_entry, state_of, write_entry
from pipeline.archive.outputs import write_findings, write_results
from pipeline.archive.remote import file_system, local_path, protocol_of, telling
from pipeline.archive.source import SUFFIX, Source
from pipeline.archive.stores import Store, StoreError, open_store
from pipeline.console import explained
from pipeline.diagnosing import diagnose_log, report_document
from pipeline.one_log import run_log
from pipeline.options import RunOptions
from pipeline.provenance import deckflex_version, sha256_of
from pipeline.publishing import now
from schemas.errors import DataError

SLUG = 60  # characters of a log's name that are kept in the names of its results
SHORT_KEY = 12
CHANGED = "changed while it was read; the next run looks again"
OUT_OF_MEMORY = "out of memory: fewer workers leave more for each"


def process(job: Job) -> Outcome:
    """Fetch, run, write, note."""
    warnings.simplefilter("ignore")
    wall, cpu = time.perf_counter(), time.process_time()
    memory.forget_peak()
    try:
        outcome = _processed(job, cpu)
    except StoreError as error:
        outcome = Outcome(job.source, State.STORE, reason=str(StoreError(error.problem, file=error.file or job.store)))
    except DataError as error:
        ours = error.file in (None, job.source.address)
        outcome = Outcome(job.source, State.FAILED, reason=without_file(error) if ours else str(error))
    except MemoryError:
        outcome = Outcome(job.source, State.FAILED, reason=OUT_OF_MEMORY)
    except Exception as error:
        outcome = Outcome(job.source, State.FAILED, reason=explained(error))
    took = time.perf_counter() - wall, time.process_time() - cpu
    return replace(outcome, wall_s=took[0], cpu_s=took[1], memory=memory.peak())


def without_file(error: DataError) -> str:
    """Channel, time and problem; the file is named beside."""
    return str(DataError(error.problem, channel=error.channel, time_s=error.time_s))


def slug_of(name: str) -> str:
    """A log's name as part of a file's: letters, digits, and nothing that a path could be made of."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name.rpartition("/")[2].removesuffix(SUFFIX))
    return plain.strip("-")[:SLUG] or "log"


def _processed(job: Job, cpu: float) -> Outcome:
    config = config_of(job.config)
    if config.version != deckflex_version():
        raise DataError(f"this worker has deckflex {deckflex_version()}, the batch was started by {config.version}")
    store = open_store(job.store)
    with _fetched(job.source) as path:
        before = _look(path)
        sha256 = job.sha256 or _hashed(path)
        task = Task(job, config, store, path, sha256, key_of(sha256, config), cpu)
        known = _known(task)
        if known is not None:
            return known
        memory.check_memory(path, job.memory or _worker_memory(), config.twin is not None)
        return _worked(task, before)


@dataclass(frozen=True)
class Task:
    """A log that is at hand. path: of this machine. key: of its result. cpu: of the process when it began, s."""

    job: Job
    config: Config
    store: Store
    path: Path
    sha256: str
    key: str
    cpu: float

    @property
    def head(self) -> dict[str, Any]:
        """What every entry begins with."""
        return heading(self.job.source, self.sha256, self.config)

    def noted(self) -> None:
        """Remember the content of the address, so that the next run need not look into it."""
        note_content(self.store, self.job.source, self.sha256, self.job.marks)


@contextmanager
def _fetched(source: Source) -> Iterator[Path]:
    """The log as a file of this machine: where it is, or a copy that is gone afterwards."""
    if not protocol_of(source.address):
        yield local_path(source.address)
        return
    with tempfile.TemporaryDirectory(prefix="deckflex-", dir=_worker_folder(), ignore_cleanup_errors=True) as folder:
        path = Path(folder) / f"{slug_of(source.name)}{SUFFIX}"
        with telling(source.address):
            file_system(source.address).get_file(source.address, str(path))
        yield path


def _worker_folder() -> str | None:
    """Where a Dask worker keeps its files, which are cleared away when it dies; None outside one."""
    from distributed import get_worker

    try:
        return str(get_worker().local_directory)
    except ValueError:
        return None


def _worker_memory() -> float | None:
    """Bytes that each thread of a Dask worker has; None outside one, or where it has no limit."""
    from distributed import get_worker

    try:
        worker = get_worker()
    except ValueError:
        return None
    limit = worker.memory_manager.memory_limit
    return float(limit) / worker.state.nthreads if limit else None


def _hashed(path: Path) -> str:
    with telling(path):
        return sha256_of(path)


def _look(path: Path) -> tuple[int, int, int]:
    with telling(path):
        known = path.stat()
    return known.st_size, known.st_mtime_ns, known.st_ino


def _known(task: Task) -> Outcome | None:
    """What an entry says that is there already: of an earlier run, of another batch, or of a log with the same content.

    None where there is none that holds: one whose files are gone, or that cannot be read, is made anew.
    """
    state = state_of(task.store, task.key)
    if state is None or (state == ASIDE and task.job.retry):
        return None
    try:
        entry = read_entry(task.store, task.key, state)
        if state == DONE and not all(task.store.exists(name) for name in entry["files"].values()):
            return None
    except (DataError, KeyError, AttributeError):
        return None
    task.noted()
    if state == ASIDE:
        return Outcome(task.job.source, State.ASIDE, task.key, reason=str(entry.get("reason", "")))
    if entry.get("log") == task.job.source.address:
        return Outcome(task.job.source, State.BEFORE, task.key, reason="done before")
    return Outcome(task.job.source, State.KNOWN, task.key, reason=f"same content as {entry.get('name')}")


def _worked(task: Task, before: tuple[int, int, int]) -> Outcome:
    """Run, keep what is wanted, and write the entry last."""
    with tempfile.TemporaryDirectory(prefix="deckflex-") as texts, task.store.scratch() as made:
        options = task.config.run_options(Path(texts))
        try:
            run = run_log(task.path, options)
        except DataError as error:
            if _look(task.path) != before:
                raise DataError(CHANGED) from error
            return _set_aside(task, without_file(error))
        if run.result.provenance["log.sha256"] != task.sha256:
            raise DataError(CHANGED)
        told = facts(run)
        told["summary"]["log"] = task.job.source.address
        files = write_results(run, task.config, made, slug_of(task.job.source.name))
        told |= _diagnosed(task, options, Path(texts), made, files)
        return _stored(task, told, files)


def _set_aside(task: Task, reason: str) -> Outcome:
    write_entry(task.store, task.key, ASIDE, {**task.head, "reason": reason})
    task.noted()
    return Outcome(task.job.source, State.ASIDE, task.key, reason=reason)


def _diagnosed(task: Task, options: RunOptions, texts: Path, made: Path, files: dict[str, Path]) -> dict[str, Any]:
    """The diagnosis where a twin is named; that there is none does not take the rest away."""
    twin = task.config.twin
    if twin is None:
        return {}
    name = str(twin.written(texts)) if twin.content else twin.name
    try:
        found = diagnose_log(task.path, name, rig=options.rig, shrink=False)
    except DataError as error:
        return {"diagnosis": None, "diagnosis_problem": without_file(error)}
    found = replace(found, log=task.job.source.address, twin=twin.name)
    files |= write_findings(found, task.config, made, slug_of(task.job.source.name))
    return {"diagnosis": report_document(found)}


def _stored(task: Task, told: dict[str, Any], files: dict[str, Path]) -> Outcome:
    """The files to their places, then the entry: from then on the log is done."""
    folder = f"{RESULTS}/{slug_of(task.job.source.name)}-{task.key[:SHORT_KEY]}"
    known = _known(task)  # another batch may have been faster
    if known is not None:
        return known
    places = {kind: f"{folder}/{path.name}" for kind, path in files.items()}
    for kind, path in files.items():
        task.store.put(path, places[kind])
    cost = {"cpu_s": time.process_time() - task.cpu, "peak_memory_gb": memory.peak() / memory.GB}
    write_entry(task.store, task.key, DONE, {**task.head, **told, "files": places, "cost": cost, "finished_utc": now()})
    task.noted()
    duration = float(told["summary"]["duration_s"])
    return Outcome(task.job.source, State.DONE, task.key, told.get("diagnosis_problem", ""), figures_of(told),
                   told["verdict"]["grade"], duration)  # fmt: skip


def figures_of(told: dict[str, Any]) -> str:
    """What the line of a log says: error or standard deviation per axis, and what a diagnosis named."""
    summary = told["summary"]
    known = {name: rmse for name, rmse in summary["rmse_arcmin"].items() if rmse is not None}
    name, values = next(iter(known.items()), ("", summary["details"]["predicted_std_arcmin"]))
    figures = " ".join("–" if value is None else f"{value:.2f}" for value in values)
    line = f"RMSE {figures}′ ({name})" if name else f"σ {figures}′"
    report = told.get("diagnosis")
    if report is None:
        return line
    named = ", ".join(effect["name"] for effect in report["effects"]) or report["verdict"].replace("_", " ")
    return f"{line}, {named}"
