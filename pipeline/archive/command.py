"""``deckflex batch`` and ``deckflex catalogue``. Heavy modules are imported when a command runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline import console
from pipeline.options import DEFAULT_ESTIMATOR

if TYPE_CHECKING:
    from pipeline.archive.config import Config

Words = Annotated[
    list[str],
    typer.Argument(
        metavar="DIR|GLOB|LIST|URL", help="Logs: a directory, a pattern, a list (.txt), s3://, gs://, http(s)://."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]
GOES_ON = "what is finished is kept, and the same command goes on from there"
KEEP = (
    "What is kept of each log besides its figures: estimates, log, recording, page, tables, nothing; repeat for each."
)


def batch(
    logs: Words,
    output: Annotated[
        str, typer.Option("-o", "--output", metavar="OUT", help="Archive of results: a directory, s3://, gs://.")
    ],
    diagnose: Annotated[
        str | None, typer.Option("--diagnose", metavar="TWIN", help="Hold each log against this twin too.")
    ] = None,
    keep: Annotated[list[str] | None, typer.Option("--keep", metavar="KIND", help=KEEP)] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=1024, help="Processes on this machine; else one a core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask cluster that is there, such as tcp://host:8786.")
    ] = None,
    memory: Annotated[
        float | None, typer.Option(metavar="GB", min=0.1, help="Memory of each worker; else its share of the machine.")
    ] = None,
    estimator: Annotated[str, typer.Option(metavar="NAME", help="How it is estimated.")] = DEFAULT_ESTIMATOR,
    identifier: Annotated[str | None, typer.Option(metavar="NAME", help="How the flexure is identified.")] = None,
    shape: Annotated[str | None, typer.Option(metavar="NAME", help="How the deck's shape is found.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Option of a method, as in run; repeat.")
    ] = None,
    rig: Annotated[Path | None, typer.Option(metavar="RIG.toml", help="Rig profile of all logs.")] = None,
    compensate: Annotated[
        Path | None, typer.Option(metavar="REPORT.json", help="Diagnosis whose effects are taken out of every log.")
    ] = None,
    rrd_rate: Annotated[
        float | None, typer.Option("--rrd-rate", metavar="HZ", min=0.01, help="Thin recordings.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done; do and write nothing.")] = False,
    retry: Annotated[bool, typer.Option("--retry", help="Also logs that were set aside before.")] = False,
    rehash: Annotated[
        bool, typer.Option("--rehash", help="Look into every log, even where size and times say it is the same.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run every log of an archive; what is done already is left alone, and a run cut short goes on where it was."""
    from pipeline.archive import batch_printing as printing
    from pipeline.archive.planning import planned
    from pipeline.archive.running import run_batch
    from pipeline.archive.stores import open_store
    from pipeline.archive.workers import Wish

    if scheduler and workers:
        raise typer.BadParameter("a cluster that is there has the workers it has", param_hint="--workers")
    if not output.strip():
        raise typer.BadParameter("name a place for the results", param_hint="--output")
    config = _config(estimator, identifier, shape, settings, rig, compensate, diagnose, keep, rrd_rate)
    if dry_run:
        plan = planned(logs, open_store(output), config, retry=retry, rehash=rehash)
        if as_json:
            console.emit(printing.plan_document(plan))
        else:
            console.display(*printing.plan_report(plan))
        return
    wish = Wish(scheduler, workers, memory)
    try:
        with printing.listening() as listener:
            summary = run_batch(logs, output, config, wish, retry=retry, rehash=rehash, listener=listener)
    except KeyboardInterrupt:
        raise typer.Exit(console.complain(f"interrupted; {GOES_ON}", console.INTERRUPTED)) from None
    if as_json:
        console.emit(summary.document())
    else:
        console.display(*printing.summary_report(summary))
    if not summary.whole:
        raise typer.Exit(console.complain(printing.complaint(summary), console.BAD_DATA))


def _config(
    estimator: str,
    identifier: str | None,
    shape: str | None,
    settings: list[str] | None,
    rig: Path | None,
    compensate: Path | None,
    diagnose: str | None,
    keep: list[str] | None,
    rrd_rate: float | None,
) -> Config:
    """What is done to every log, checked before the first one. Stops with status 2 where it cannot be."""
    from pipeline.archive.config import Config, Output, Text, read_text
    from pipeline.choosing import chosen_settings, named
    from pipeline.provenance import deckflex_version
    from stages.shape import names as shape_names

    for stage, option, name in (
        ("estimate", "--estimator", estimator), ("identify", "--identifier", identifier), ("shape", "--shape", shape),
    ):  # fmt: skip
        named(stage, option, name)
    chosen_settings(settings, [estimator], identifier, [shape or shape_names()[0]])
    kinds = sorted(set(keep or [str(Output.ESTIMATES)]))
    unknown = [kind for kind in kinds if kind not in list(Output)]
    if unknown:
        raise typer.BadParameter(f"'{unknown[0]}' is none of {', '.join(Output)}", param_hint="--keep")
    _check_texts(rig, compensate, diagnose)
    twin = diagnose and (read_text(Path(diagnose)) if Path(diagnose).is_file() else Text(diagnose, ""))
    return Config(
        version=deckflex_version(),
        estimator=estimator,
        identifier=identifier,
        shape=shape,
        settings=tuple(settings or ()),
        rig=read_text(rig) if rig else None,
        compensate=read_text(compensate) if compensate else None,
        twin=twin or None,
        outputs=tuple(kind for kind in kinds if kind != Output.NOTHING),
        rrd_rate=rrd_rate,
    )


def _check_texts(rig: Path | None, compensate: Path | None, twin: str | None) -> None:
    """Raise DataError for a profile, report or twin that no log could be run with."""
    if rig is not None:
        from stages.decode import load_rig

        load_rig(rig)
    if compensate is not None:
        from pipeline.compensating import load_remedy

        load_remedy(compensate)
    if twin is not None:
        from twin import load_twin

        load_twin(twin)


def catalogue(
    archive: Annotated[
        str, typer.Argument(metavar="OUT", help="Archive that deckflex batch wrote.", show_default=False)
    ],
    by: Annotated[str, typer.Option("--by", metavar="rig|folder|all", help="What tells installations apart.")] = "rig",
    where: Annotated[
        str | None, typer.Option("--where", metavar="SQL", help="Only rows for which it holds: \"grade <> 'bad'\".")
    ] = None,
    sql: Annotated[
        str | None, typer.Option("--sql", metavar="QUERY", help="Print the answer to a query of the table catalogue.")
    ] = None,
    rrd: Annotated[Path | None, typer.Option("--rrd", metavar="OUT.rrd", help="Rerun recording to write.")] = None,
    report: Annotated[Path | None, typer.Option("--report", metavar="OUT.html", help="Page to write.")] = None,
    as_json: Json = False,
) -> None:
    """Say what an archive says: drift of the static angle, flexure against the sea, effects that repeat, worst logs."""
    from pipeline.archive import catalogue as catalogues
    from pipeline.archive.catalogue_printing import catalogue_parts, frame_table, write_report
    from pipeline.archive.manifest import CATALOGUE, spare_own_files
    from pipeline.archive.remote import joined
    from pipeline.archive.reporting import archive_report
    from pipeline.archive.stores import open_store
    from pipeline.archive.survey import GROUPS, survey_document, surveyed
    from pipeline.files import check_targets
    from pipeline.provenance import deckflex_version

    if by not in GROUPS:
        raise typer.BadParameter(f"'{by}' is none of {', '.join(GROUPS)}", param_hint="--by")
    outputs = {kind: path for kind, path in {"recording": rrd, "report": report}.items() if path is not None}
    check_targets(list(outputs.values()), [])
    store = open_store(archive)
    spare_own_files(store, list(outputs.values()))
    loaded = catalogues.load_catalogue(store)
    if sql is not None:
        answer = _asked("--sql", lambda: catalogues.queried(loaded.frame, sql))
        if as_json:
            console.emit({"rows": answer.to_dicts()})
        else:
            console.display(frame_table(answer))
        return
    rows = _asked("--where", lambda: catalogues.selected(loaded.frame, where))
    shown, left_out = catalogues.latest(rows)
    survey = surveyed(shown, by, left_out)
    path = joined(store.root, CATALOGUE)
    title = Path(store.root).name or store.root
    origin = {"deckflex": deckflex_version(), "archive": title, "where": where or ""}  # wherever it lies
    made = archive_report(survey, title, loaded.notes, origin)
    written = write_report(made, outputs)
    if as_json:
        console.emit({**survey_document(survey, loaded.notes, path), "written": written})
    else:
        console.display(*catalogue_parts(made, written, path))


def _asked(option: str, question: Callable[[], Any]) -> Any:
    """Its answer; stops with status 2 where the question is wrong."""
    try:
        return question()
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint=option) from error
