"""Writing what a run found: log, recording, Parquet tables; all of them whole, or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.files import check_targets, staged, writing
from pipeline.one_log import LogRun, Progress, Steps
from schemas.errors import DataError
from schemas.wire import Table

OWN_TOPICS = "/deckflex/"
METADATA_NAME = "deckflex"


@dataclass(frozen=True)
class Outputs:
    """Files to write; None: not wanted. rrd_rate: Hz at most in the recording (None: every sample).

    only_estimates: leave the original channels out of the log. parquet: a directory, one file a channel in it.
    """

    log: Path | None = None
    rrd: Path | None = None
    parquet: Path | None = None
    only_estimates: bool = False
    rrd_rate: float | None = None

    @property
    def files(self) -> dict[str, Path]:
        """Log and recording, as far as they are wanted."""
        return {kind: path for kind, path in (("log", self.log), ("recording", self.rrd)) if path is not None}


def check_outputs(outputs: Outputs, log: Path, rig: Path | None = None) -> None:
    """Raise DataError before the work starts if the outputs cannot be written, or would touch an input."""
    check_targets(list(outputs.files.values()), [log, rig] if rig else [log])
    if outputs.parquet is not None and outputs.parquet.exists() and not outputs.parquet.is_dir():
        raise DataError("is a file; name a directory for the Parquet tables", file=outputs.parquet)
    if outputs.log is not None and not outputs.only_estimates:
        _check_first_run(log)


def write_outputs(run: LogRun, outputs: Outputs, progress: Progress | None = None) -> tuple[LogRun, dict[str, str]]:
    """Write what is wanted. Returns the run with the time it took, and the files by kind. Raises DataError."""
    steps = Steps(progress, dict(run.seconds))
    files, tables = outputs.files, _tables(run, outputs)
    parquet = {} if outputs.parquet is None else _parquet_files(outputs.parquet, tables)
    targets = [*files.values(), *parquet]
    writers: dict[str, Callable[[Path], None]] = {
        "log": lambda path: _write_log(path, run, tables, outputs),
        "recording": lambda path: _write_recording(path, run, outputs),
    }
    with steps.step("write"), staged(targets) as temporary:
        for (kind, target), path in zip(files.items(), temporary):
            with writing(target):
                writers[kind](path)
        for (target, table), path in zip(parquet.items(), temporary[len(files) :], strict=True):
            with writing(target):
                _write_parquet(path, table)
    written = {kind: str(path) for kind, path in files.items()}
    if outputs.parquet is not None:
        written["tables"] = str(outputs.parquet)
    return (replace(run, seconds=steps.seconds) if targets else run), written


def parquet_name(topic: str) -> str:
    """File name of a topic's table; nothing in a topic can lead out of the directory."""
    return topic.strip("/").replace("/", ".") + ".parquet"


def _check_first_run(log: Path) -> None:
    from schemas.wire import scan_log

    own = [channel.topic for channel in scan_log(log).channels if channel.topic.startswith(OWN_TOPICS)]
    if own:
        problem = "the log holds estimates already; run the original log, or write --only-estimates"
        raise DataError(problem, file=log, channel=own[0])


def _tables(run: LogRun, outputs: Outputs) -> Sequence[Table]:
    if outputs.log is None and outputs.parquet is None:
        return ()
    from stages.publish.tables import result_tables

    return result_tables(run.result, run.decoded.trial)


def _write_log(path: Path, run: LogRun, tables: Sequence[Table], outputs: Outputs) -> None:
    from schemas.wire import append_tables, write_log

    metadata = {METADATA_NAME: dict(run.result.provenance)}
    if outputs.only_estimates:
        write_log(path, tables, metadata=metadata)
    else:
        append_tables(run.path, path, tables, metadata=metadata)


def _write_recording(path: Path, run: LogRun, outputs: Outputs) -> None:
    from stages.publish.rerun_bridge import save_run

    save_run(run.result, run.decoded.trial, path, truth=run.decoded.truth, rate=outputs.rrd_rate)


def _parquet_files(directory: Path, tables: Sequence[Table]) -> Mapping[Path, Table]:
    with writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
    return {directory / parquet_name(table.topic): table for table in tables}


def _write_parquet(path: Path, table: Table) -> None:
    import polars as pl

    pl.DataFrame(dict(table.columns)).write_parquet(path)
