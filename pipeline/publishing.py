"""Writing what a run found: log, recording, page, Parquet tables; all of them whole, or none."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread

from pipeline.files import check_targets, staged, writing
from pipeline.one_log import LogRun, Progress, Steps
from schemas.errors import DataError
from stages.publish import OWN_TOPICS
from stages.slabs import beside

Writer = Callable[[Path], None]


@dataclass(frozen=True)
class Outputs:
    """Files to write; None: not wanted. rrd_rate: Hz at most in the recording (None: every sample).

    only_estimates: leave the original channels out of the log. parquet: a directory for tables. report: an HTML page.
    """

    log: Path | None = None
    rrd: Path | None = None
    parquet: Path | None = None
    only_estimates: bool = False
    rrd_rate: float | None = None
    report: Path | None = None

    @property
    def files(self) -> dict[str, Path]:
        """Log, recording and page, as far as they are wanted."""
        named = {"log": self.log, "recording": self.rrd, "report": self.report}
        return {kind: path for kind, path in named.items() if path is not None}


def check_outputs(outputs: Outputs, log: Path, *others: Path | None) -> None:
    """Raise DataError before the work starts if the outputs cannot be written, or would touch an input."""
    check_targets(list(outputs.files.values()), [log, *(path for path in others if path)])
    if outputs.parquet is not None and outputs.parquet.exists() and not outputs.parquet.is_dir():
        raise DataError("is a file; name a directory for the Parquet tables", file=outputs.parquet)


def write_outputs(run: LogRun, outputs: Outputs, progress: Progress | None = None) -> tuple[LogRun, dict[str, str]]:
    """Write what is wanted. Returns the run with the time it took, and the files by kind. Raises DataError."""
    if not outputs.files and outputs.parquet is None:
        return run, {}
    run = _told_of_replacing(run, outputs)
    writers: dict[str, Writer] = {
        "log": lambda path: _write_log(path, run, outputs),
        "recording": lambda path: _write_recording(path, run, outputs),
        "report": lambda path: _write_page(path, run),
    }
    steps = Steps(progress, dict(run.seconds))
    with steps.step("write"):
        at_a_time = beside(len(run.result.deformation.stamp))
        written = _write_all(outputs.files, writers, lambda: _write_parquet(run, outputs.parquet), at_a_time)
    return replace(run, seconds=steps.seconds), written


def write_comparison(runs: Sequence[LogRun], outputs: Outputs, progress: Progress | None = None) -> dict[str, str]:
    """One recording and one page with every estimator's curves, as far as they are wanted. Raises DataError."""
    results, decoded = [run.result for run in runs], runs[0].decoded

    def record(path: Path) -> None:
        with recording(path):
            from stages.publish.recording.comparison import write_comparison

            write_comparison(results, decoded.trial, decoded.truth, path, outputs.rrd_rate)

    def report(path: Path) -> None:
        from stages.publish.page.comparison import comparison_page

        save_page(comparison_page(results, decoded.trial, now()), path)

    with Steps(progress).step("write"):
        return _write_all(outputs.files, {"recording": record, "report": report}, dict)


def save_page(page: str, path: Path) -> None:
    """Write a page as UTF-8."""
    path.write_text(page, encoding="utf-8")


def now() -> str:
    """The time a page is made, as text."""
    return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")


def _write_all(
    files: Mapping[str, Path], writers: Mapping[str, Writer], others: Callable[[], dict[str, str]], at_a_time: int = 2
) -> dict[str, str]:
    """Every file under a temporary name first, so many beside each other; all of them appear at once, or none."""
    with staged(list(files.values())) as temporary:

        def write(kind: str, target: Path, path: Path) -> None:
            with writing(target, path):
                writers[kind](path)

        with ThreadPoolExecutor(at_a_time) as pool:
            for _ in pool.map(write, files.keys(), files.values(), temporary):
                pass
        also = others()
    return {kind: str(path) for kind, path in files.items()} | also


def _told_of_replacing(run: LogRun, outputs: Outputs) -> LogRun:
    """The run, with a warning where the log holds estimates already, which the copy will not."""
    own = [channel.topic for channel in run.decoded.log.channels if channel.topic.startswith(OWN_TOPICS)]
    if not own or outputs.log is None or outputs.only_estimates:
        return run
    warning = f"the log holds estimates already ({', '.join(sorted(own))}); in the copy they are replaced by the new"
    return replace(run, result=replace(run.result, warnings=(*run.result.warnings, warning)))


def _write_log(path: Path, run: LogRun, outputs: Outputs) -> None:
    from stages.publish.log import publish_log

    publish_log(run.result, run.decoded.trial, run.path, path, only_estimates=outputs.only_estimates)


def _write_recording(path: Path, run: LogRun, outputs: Outputs) -> None:
    with recording(path):
        from stages.publish.rerun_bridge import write_recording

        write_recording(run.result, run.decoded.trial, run.decoded.truth, path, outputs.rrd_rate)


def loading_ahead(progress: Progress | None, outputs: Outputs) -> Progress | None:
    """The callback, which has what a recording needs loaded as soon as the estimate is at work in compiled loops."""
    if outputs.rrd is None:
        return progress
    loader = Thread(target=_load_rerun, daemon=True)

    def report(step: str, done: int, total: int) -> None:
        if step == "estimate" and loader.ident is None:
            loader.start()
        if progress is not None:
            progress(step, done, total)

    return report


def _load_rerun() -> None:
    os.environ.setdefault("RUST_LOG", "off")
    with suppress(ImportError):  # whoever needs it will say so
        import pyarrow as pa

        import stages.publish.rerun_bridge  # noqa: F401

        pa.array([0.0])  # its first array loads more


@contextmanager
def recording(path: Path) -> Iterator[None]:
    """Say what Rerun has to say of a full disk, in one line; before its first import."""
    os.environ.setdefault("RUST_LOG", "off")
    try:
        yield
    except RuntimeError as error:
        raise DataError(f"cannot be written: {error}", file=path) from error


def _write_page(path: Path, run: LogRun) -> None:
    from stages.publish.page.run import run_page

    save_page(run_page(run.result, run.decoded.trial, now()), path)


def _write_parquet(run: LogRun, directory: Path | None) -> dict[str, str]:
    if directory is None:
        return {}
    from stages.publish.log import write_parquet

    with writing(directory):
        paths = write_parquet(run.result, directory, run.path.stem)
    return {f"table {path.name.split('.')[-2]}": str(path) for path in paths}
