"""The files that are kept of a log: estimates, recording, page, tables, diagnosis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.archive.config import Config, Output
from pipeline.archive.stores import StoreError
from pipeline.diagnosing import write_diagnosis
from pipeline.one_log import LogRun
from pipeline.publishing import Outputs, write_outputs
from schemas.diagnosis import Diagnosis
from schemas.errors import DataError

UNWRITTEN = "cannot be written"  # how every writer begins when the disk, not the log, is at fault


def write_results(run: LogRun, config: Config, folder: Path, stem: str) -> dict[str, Path]:
    """The wanted files of a run in a folder, by kind. Raises StoreError where the disk does not take them."""
    wanted = frozenset(config.outputs)

    def path(of: tuple[Output, ...], suffix: str) -> Path | None:
        return folder / f"{stem}{suffix}" if wanted & {str(one) for one in of} else None

    outputs = Outputs(
        log=path((Output.LOG, Output.ESTIMATES), ".mcap"),
        rrd=path((Output.RECORDING,), ".rrd"),
        parquet=path((Output.TABLES,), ".tables"),
        only_estimates=Output.LOG not in wanted,
        rrd_rate=config.rrd_rate,
        report=path((Output.PAGE,), ".html"),
    )
    with _disk_at_fault():
        _, written = write_outputs(run, outputs)
    return {kind: _named(Path(place), stem) for kind, place in written.items()}


def _named(path: Path, stem: str) -> Path:
    """Tables are called after the log; in an archive after its plain name."""
    if path.suffix != ".parquet":
        return path
    return path.rename(path.with_name(".".join([stem, *path.name.split(".")[-2:]])))


def write_findings(found: Diagnosis, config: Config, folder: Path, stem: str) -> dict[str, Path]:
    """The report of a diagnosis, and its recording and page where those of the run are kept."""
    files = {"diagnosis": folder / f"{stem}.diagnosis.json"}
    named = {"json": files["diagnosis"]}
    for kind, output, suffix in (("recording", Output.RECORDING, "rrd"), ("report", Output.PAGE, "html")):
        if output in config.outputs:
            files[f"diagnosis {kind}"] = named[kind] = folder / f"{stem}.diagnosis.{suffix}"
    with _disk_at_fault():
        write_diagnosis(found, named)
    return files


@contextmanager
def _disk_at_fault() -> Iterator[None]:
    try:
        yield
    except DataError as error:
        if error.problem.startswith(UNWRITTEN):
            raise StoreError(error.problem) from error  # the file has a name of its own until it is whole
        raise
