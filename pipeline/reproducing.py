"""Published experiments run over seeds: measured rows, their means beside what was printed, and the files of both."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline import experiments, reproduction_page
from pipeline.files import check_target, check_targets, staged, writing
from pipeline.one_log import Progress, Steps
from pipeline.provenance import deckflex_version
from pipeline.reproduced import Outcome, Sample
from schemas.errors import DataError
from schemas.experiment import Experiment, Figure, Panel, Row, Values

if TYPE_CHECKING:
    import polars as pl

LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn", "mealpy", "PyWavelets")
SUFFIXES = {"table": ".parquet", "text": ".md", "recording": ".rrd"}
ALL = "all"
_TEXTS = ("case", "method", "quantity", "unit", "note")


def versions() -> dict[str, str]:
    """Of this package, of Python and of the libraries that compute."""
    return {
        "deckflex": deckflex_version(),
        "python": platform.python_version(),
        **{name: version(name) for name in LIBRARIES},
    }


def measure(experiment: Experiment, seeds: int, progress: Progress | None = None) -> Outcome:
    """Run all parts over seeds 1 to ``seeds``, a part at most over its own number. Raises DataError."""
    steps = Steps(progress)
    jobs = [(seed, part) for seed in range(1, seeds + 1) for part in experiment.parts if seed <= (part.seeds or seeds)]
    samples: list[Sample] = []
    panels: tuple[Panel, ...] = ()
    with steps.step(experiment.name) as report:
        for done, (seed, part) in enumerate(jobs):
            report(done, len(jobs))
            measured = part.run(seed)
            samples += [Sample(part.title, seed, row) for row in measured.rows]
            panels += measured.panels if seed == 1 else ()
    return Outcome(experiment, tuple(samples), panels, versions())


def targets(experiment: Experiment, directory: Path) -> list[Path]:
    """Table, text and recording of an experiment."""
    return [directory / f"{experiment.name}{suffix}" for suffix in SUFFIXES.values()]


def check_directory(directory: Path, experiments: Sequence[Experiment], page: Path | None) -> None:
    """Make the directory and raise DataError unless all files can be written in it."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"cannot be made: {error.strerror}", file=directory) from error
    files = [path for experiment in experiments for path in targets(experiment, directory)]
    check_targets([*files, *([page] if page else [])], [])


def write(outcome: Outcome, directory: Path, *, recorded: bool = True) -> dict[str, str]:
    """Table, text and recording, all of them or none; recorded False: the text alone. Returns the paths by kind."""
    from stages.publish.recording.reproduction import write_reproduction

    name, said = outcome.experiment.name, reproduction_page.experiment_text(outcome)
    writers: dict[str, Callable[[Path], object]] = {
        "text": lambda path: path.write_text(said, encoding="utf-8"),
        "table": lambda path: frame(outcome).write_parquet(path, metadata=dict(outcome.versions)),
        "recording": lambda path: write_reproduction(name, said, outcome.panels, path, outcome.figures),
    }
    kinds = list(writers) if recorded else ["text"]
    files = [directory / f"{name}{SUFFIXES[kind]}" for kind in kinds]
    with staged(files) as temporary:
        for kind, target, path in zip(kinds, files, temporary, strict=True):
            with writing(target, path):
                writers[kind](path)
    return {f"{kind} {name}": str(path) for kind, path in zip(kinds, files, strict=True)}


def frame(outcome: Outcome) -> pl.DataFrame:
    """One row per measured figure: experiment, part, seed, case, method, quantity, unit, value (a list), note."""
    import polars as pl

    columns = {
        "experiment": [outcome.experiment.name for _ in outcome.samples],
        "part": [sample.part for sample in outcome.samples],
        "seed": [sample.seed for sample in outcome.samples],
        **{name: [getattr(sample.row, name) for sample in outcome.samples] for name in _TEXTS},
        "value": [list(sample.row.value) for sample in outcome.samples],
    }
    return pl.DataFrame(columns, schema_overrides={"value": pl.List(pl.Float64)})


def measured_before(experiment: Experiment, directory: Path) -> Outcome:
    """The outcome whose table stands in a directory. Raises DataError when there is none or it is another's."""
    import polars as pl

    path = directory / f"{experiment.name}.parquet"
    if not path.is_file():
        raise DataError(f"there is no table of {experiment.name} here; run it first", file=path)
    try:
        table, metadata = pl.read_parquet(path), pl.read_parquet_metadata(path)
        samples = tuple(_sample(row) for row in table.iter_rows(named=True))
    except (pl.exceptions.PolarsError, KeyError) as error:
        raise DataError(f"is not a table of an experiment: {error}", file=path) from error
    known = {name: metadata[name] for name in versions() if name in metadata}
    return Outcome(experiment, samples, (), known)


def finished(experiment: Experiment, directory: Path, seeds: int) -> bool:
    """Whether the table of an experiment stands in a directory, of these versions and with all seeds; DataError."""
    if not (directory / f"{experiment.name}.parquet").is_file():
        return False
    found = measured_before(experiment, directory)
    return found.versions == versions() and found.seeds == tuple(range(1, seeds + 1))


def _sample(row: Mapping[str, Any]) -> Sample:
    texts = {name: row[name] for name in _TEXTS}
    return Sample(row["part"], row["seed"], Row(**texts, value=tuple(row["value"])))


def selected(name: str) -> tuple[Experiment, ...]:
    """The experiment of that name, or all of them; ValueError with the names there are."""
    if name == ALL:
        return tuple(experiments.get(each) for each in experiments.names())
    return (experiments.get(name),)


def reproduce(
    chosen: Sequence[Experiment],
    directory: Path,
    seeds: int | None = None,
    page: Path | None = None,
    *,
    measured: bool = False,
    resume: bool = False,
    progress: Progress | None = None,
) -> tuple[tuple[Outcome, ...], dict[str, str]]:
    """Run experiments one after the other, each with its files, and write the page if they are all there are.

    seeds None: as many as an experiment asks for. measured: take the rows from the tables of an earlier run, whose
    recordings stay. resume: of those experiments alone whose tables hold all seeds. Returns the outcomes and the files
    by kind. Raises DataError.
    """
    whole = len(chosen) == len(experiments.names())
    target = (page or default_page(directory)) if whole else None
    if not measured:
        check_directory(directory, chosen, target)
    elif target is not None:
        check_target(target, [])
    outcomes: list[Outcome] = []
    written: dict[str, str] = {}
    for experiment in chosen:
        wanted = seeds or experiment.seeds
        kept = measured or (resume and finished(experiment, directory, wanted))
        outcome = measured_before(experiment, directory) if kept else measure(experiment, wanted, progress)
        written |= write(outcome, directory, recorded=not kept)
        outcomes.append(outcome)
    return tuple(outcomes), written | (_write_page(outcomes, target) if target else {})


def default_page(directory: Path) -> Path:
    """``docs/reproduction.md`` where there is a folder for it here, else in the directory of the tables."""
    return Path("docs/reproduction.md") if Path("docs").is_dir() else directory / "reproduction.md"


def _write_page(outcomes: Sequence[Outcome], target: Path) -> dict[str, str]:
    said = reproduction_page.page(outcomes)
    with staged([target]) as (path,), writing(target, path):
        path.write_text(said, encoding="utf-8")
    return {"page": str(target)}


def reproduction_document(outcomes: Sequence[Outcome], written: Mapping[str, str]) -> dict[str, Any]:
    """What ``--json`` prints; figures that do not exist are null."""
    return {"experiments": [_document(outcome) for outcome in outcomes], "written": dict(written)}


def _document(outcome: Outcome) -> dict[str, Any]:
    return {
        "name": outcome.experiment.name,
        "source": outcome.experiment.source,
        "seeds": list(outcome.seeds),
        "versions": dict(outcome.versions),
        "chosen": list(outcome.experiment.chosen),
        "claims": [{"claim": c, "holds": holds, "measured": said} for c, holds, said in outcome.verdicts()],
        "figures": [_figure_document(figure) for figure in outcome.figures],
    }


def _figure_document(figure: Figure) -> dict[str, Any]:
    def plain(values: Values | None) -> list[float | None] | None:
        return None if values is None else [value if np.isfinite(value) else None for value in values]

    return {
        **{name: getattr(figure, name) for name in ("part", "case", "method", "quantity", "unit", "n", "note")},
        "mean": plain(figure.mean),
        "spread": plain(figure.spread),
        "published": plain(figure.printed.value if figure.printed else None),
        "limit": plain(figure.limit.value if figure.limit else None),
    }
