"""The command ``deckflex``. Heavy libraries are imported by the commands that need them, when they run."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from pipeline import console
from pipeline.archive.command import batch, catalogue
from pipeline.blind.command import app as blind
from pipeline.choosing import chosen_settings, named
from pipeline.files import check_input, check_target
from pipeline.options import DEFAULT_ESTIMATOR, RunOptions
from pipeline.registries import Kind, listing

app = typer.Typer(
    help="Deck deformation of ships from pairs of inertial units: MCAP logs in, angles with covariance out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(blind, name="blind")
app.command(epilog="Example: deckflex batch voyages -o archive --workers 4")(batch)
app.command(epilog="Example: deckflex catalogue archive --report archive.html --rrd archive.rrd")(catalogue)

Log = Annotated[Path, typer.Argument(metavar="LOG", help="MCAP log of a trial.", show_default=False)]
Rig = Annotated[Path | None, typer.Option("--rig", metavar="RIG.toml", help="Rig profile: topics, axes, units.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
Identifier = Annotated[
    str | None,
    typer.Option("--identifier", metavar="NAME", help="How the flexure is identified; else as the estimator wants it."),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Option of the estimator, or METHOD.KEY=VALUE; repeat for each."),
]
Shape = Annotated[str | None, typer.Option("--shape", metavar="NAME", help="How the deck's shape is found.")]
Report = Annotated[Path | None, typer.Option("--report", metavar="OUT.html", help="Page to write, for reading.")]
Rate = Annotated[float | None, typer.Option("--rrd-rate", metavar="HZ", min=0.01, help="Thin the recording.")]


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Entry point of the command; arguments None: those of the process. Exits with the command's status."""
    for library in ("OMP", "OPENBLAS", "MKL"):  # the matrices are small: more threads only get in each other's way
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    words = list(sys.argv[1:] if arguments is None else arguments)
    sys.exit(console.guarded(lambda: app(words, prog_name="deckflex"), debug="--debug" in words[:1]))


@app.callback()
def root(debug: Annotated[bool, typer.Option("--debug", help="Show where an error arose.")] = False) -> None:
    """Deck deformation of ships from pairs of inertial units: MCAP logs in, angles with covariance out."""


@app.command(epilog="Example: deckflex run trial.mcap -o out.mcap --rrd out.rrd")
def run(
    log: Log,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="OUT.mcap", help="Log to write.")] = None,
    rrd: Annotated[Path | None, typer.Option("--rrd", metavar="OUT.rrd", help="Rerun recording to write.")] = None,
    parquet: Annotated[Path | None, typer.Option(metavar="DIR", help="Directory for tables to write.")] = None,
    estimator: Annotated[str, typer.Option(metavar="NAME", help="How it is estimated.")] = DEFAULT_ESTIMATOR,
    identifier: Identifier = None,
    shape: Shape = None,
    settings: Set = None,
    rig: Rig = None,
    only_estimates: Annotated[bool, typer.Option("--only-estimates", help="Leave the original channels out.")] = False,
    rrd_rate: Rate = None,
    report: Report = None,
    compensate: Annotated[
        Path | None, typer.Option(metavar="REPORT.json", help="Diagnosis whose effects are taken out first.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Find the deck's deformation in a log and write it as new channels and as a recording."""
    from pipeline.documents import run_document
    from pipeline.one_log import run_log
    from pipeline.publishing import Outputs, check_outputs, loading_ahead, write_outputs
    from stages.shape import names as shape_names

    named("estimate", "--estimator", estimator)
    named("identify", "--identifier", identifier)
    named("shape", "--shape", shape)
    chosen = chosen_settings(settings, [estimator], identifier, [shape or shape_names()[0]])
    options = RunOptions(estimator, identifier, shape, rig, chosen, compensate)
    outputs = Outputs(output, rrd, parquet, only_estimates, rrd_rate, report)
    check_inputs(log, rig, compensate)
    check_outputs(outputs, log, rig, compensate)
    with console.progress_bar() as progress:
        done, written = write_outputs(run_log(log, options, loading_ahead(progress, outputs)), outputs, progress)
    if as_json:
        console.emit(run_document(done, written))
        return
    from pipeline.printing import run_report

    console.display(*run_report(done, written))


@app.command(epilog="Example: deckflex compare trial.mcap --estimator smoother --estimator filter")
def compare(
    log: Log,
    estimator: Annotated[list[str], typer.Option("--estimator", metavar="NAME", help="Repeat for each.")],
    identifier: Identifier = None,
    settings: Set = None,
    rig: Rig = None,
    rrd: Annotated[Path | None, typer.Option("--rrd", metavar="OUT.rrd", help="Rerun recording to write.")] = None,
    rrd_rate: Rate = None,
    report: Report = None,
    as_json: Json = False,
) -> None:
    """Run several estimators on one log and print their errors side by side."""
    from pipeline.documents import compare_document
    from pipeline.one_log import compare_estimators
    from pipeline.publishing import Outputs, check_outputs, write_comparison

    for name in estimator:
        named("estimate", "--estimator", name)
    named("identify", "--identifier", identifier)
    chosen = chosen_settings(settings, estimator, identifier)
    check_inputs(log, rig)
    outputs = Outputs(rrd=rrd, rrd_rate=rrd_rate, report=report)
    check_outputs(outputs, log, rig)
    options = RunOptions(identifier=identifier, rig=rig, settings=chosen)
    with console.progress_bar() as progress:
        found = compare_estimators(log, options, list(dict.fromkeys(estimator)), progress)
        written = write_comparison(found.runs, outputs, progress)
    if as_json:
        console.emit(compare_document(found, written))
        return
    from pipeline.printing import compare_report

    console.display(*compare_report(found, written))


@app.command(epilog="Example: deckflex diagnose trial.mcap --twin ship.toml -o report.json --report report.html")
def diagnose(
    log: Log,
    twin: Annotated[str, typer.Option("--twin", metavar="TWIN", help="TOML file, or name of a built-in one.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="REPORT.json", help="Report to write, for --compensate.")
    ] = None,
    rrd: Annotated[Path | None, typer.Option("--rrd", metavar="OUT.rrd", help="Rerun recording to write.")] = None,
    report: Report = None,
    rig: Rig = None,
    shrink: Annotated[
        bool, typer.Option("--shrink/--no-shrink", help="Run the estimator on log and twin, before and after.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Say where a log departs from its twin, which effect causes it, and how far the gap shrinks with it."""
    from pipeline.diagnosing import diagnose_log, report_document, write_diagnosis
    from pipeline.files import check_targets
    from pipeline.heap import keep_freed

    keep_freed()
    named_files = {"json": output, "recording": rrd, "report": report}
    outputs = {kind: path for kind, path in named_files.items() if path is not None}
    check_inputs(log, rig)
    check_targets(
        list(outputs.values()), [log, *([rig] if rig else []), *([Path(twin)] if Path(twin).is_file() else [])]
    )
    with console.progress_bar() as progress:
        found = diagnose_log(log, twin, rig=rig, shrink=shrink, progress=progress)
        write_diagnosis(found, outputs, progress)
    if as_json:
        console.emit(report_document(found))
        return
    from pipeline.diagnosis_printing import diagnosis_report

    console.display(*diagnosis_report(found))


@app.command(epilog="Example: deckflex info trial.mcap")
def info(log: Log, rig: Rig = None, as_json: Json = False) -> None:
    """Say what a log holds: channels, rates, gaps, disorder, and what can be run on it."""
    from pipeline.health import health_document, health_report, log_health

    check_inputs(log, rig)
    with console.progress_bar() as progress:
        found = log_health(log, rig, progress)
    if as_json:
        console.emit(health_document(found))
    else:
        console.display(*health_report(found))


@app.command(epilog="Example: deckflex simulate idam -o trial.mcap --seed 1 --duration 600")
def simulate(
    twin: Annotated[str, typer.Argument(metavar="TWIN", help="TOML file, or name of a built-in one.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="LOG", help="Log to write.")] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", min=0, help="Seed of all randomness.")] = None,
    duration: Annotated[float | None, typer.Option(metavar="S", min=1.0, help="Length in seconds.")] = None,
    as_json: Json = False,
) -> None:
    """Make a log, with its truth, from a twin: a description of ship, sea and sensors."""
    from pipeline.simulating import default_target, simulate_log

    target = output or default_target(twin)
    inputs = [Path(twin)] if Path(twin).is_file() else []
    check_target(target, inputs)
    with console.progress_bar() as progress:
        made = simulate_log(twin, target, seed=seed, duration=duration, progress=progress)
    if as_json:
        console.emit(made)
    else:
        console.display(f"wrote {made['log']}: {made['duration_s']:.1f} s of {made['twin']}, seed {made['seed']}")


@app.command(epilog="Example: deckflex reproduce td-ma --seeds 5")
def reproduce(
    name: Annotated[str, typer.Argument(metavar="NAME|all", help="Published experiment (deckflex list experiments).")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Directory for tables and recordings.")
    ] = Path("reproduction"),
    seeds: Annotated[int | None, typer.Option(metavar="N", min=1, help="Seeds 1 to N; else as the experiment.")] = None,
    page: Annotated[
        Path | None, typer.Option(metavar="PAGE.md", help="Page of all; else docs/reproduction.md where there is docs.")
    ] = None,
    measured: Annotated[
        bool, typer.Option("--measured", help="Make texts and page from the tables in DIR; measure nothing.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Measure only what has no whole table of this version in DIR.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run a published experiment again; published figures beside measured ones. NAME all: every one, and their page."""
    from pipeline.reproducing import reproduce as run_again
    from pipeline.reproducing import reproduction_document, selected

    try:
        experiments = selected(name)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="NAME") from error
    if page is not None and name != "all":
        raise typer.BadParameter("only all experiments together make a page", param_hint="--page")
    with console.progress_bar() as progress:
        outcomes, written = run_again(
            experiments, output, seeds, page, measured=measured, resume=resume, progress=progress
        )
    if as_json:
        console.emit(reproduction_document(outcomes, written))
        return
    from pipeline.reproduction_printing import reproduction_report

    console.display(*reproduction_report(outcomes, written))


@app.command("list", epilog="Example: deckflex list estimators")
def list_(kind: Annotated[Kind, typer.Argument(help="What to list.")], as_json: Json = False) -> None:
    """List what there is to choose from."""
    entries = listing(kind)
    if as_json:
        console.emit({str(kind): [{"name": entry.name, "about": entry.about} for entry in entries]})
        return
    from pipeline.tables import listing_table

    rows = [(entry.name, entry.about) for entry in entries]
    console.display(listing_table(str(kind), rows) if rows else f"there are no {kind} in this version")


@app.command(epilog="Example: deckflex view out.rrd")
def view(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording (.rrd), or a log, which is run first.")],
    rig: Rig = None,
    web: Annotated[bool, typer.Option("--web", help="In the browser instead of a window.")] = False,
) -> None:
    """Open the Rerun viewer on a recording, on this machine only."""
    from pipeline.viewer import view as open_viewer

    check_inputs(file, rig)
    with console.progress_bar() as progress:
        open_viewer(file, RunOptions(rig=rig), console.display, web=web, progress=progress)


@app.command(epilog="Example: deckflex version")
def version(as_json: Json = False) -> None:
    """Print the version."""
    from pipeline.provenance import deckflex_version

    document: dict[str, Any] = {"version": deckflex_version()}
    if as_json:
        console.emit(document)
    else:
        console.display(document["version"])


def check_inputs(log: Path, *others: Path | None) -> None:
    """Raise DataError unless the files can be read."""
    for path in (log, *others):
        if path is not None:
            check_input(path)
