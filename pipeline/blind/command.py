"""``deckflex blind``: the diagnosis checked on sealed effects. Heavy modules are imported when a command runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline import console
from pipeline.files import check_target

app = typer.Typer(
    help="Check the diagnosis on sealed effects: draw a set, answer it without the key, open the seal once.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the sealed set.", show_default=False)]
Workers = Annotated[int, typer.Option(metavar="N", min=1, help="Processes at work.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of text.")]


@app.command(epilog="Example: deckflex blind seal sealed --logs 300 --key sealed.key --workers 2")
def seal(
    folder: Folder,
    logs: Annotated[int, typer.Option(metavar="K", min=1, max=9999, help="How many logs.")] = 300,
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Key file to write; DIR.key unless named.", show_default=False)
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Repeatable draw; without it the seed is a secret.")
    ] = None,
    duration: Annotated[
        list[float] | None, typer.Option(metavar="S", min=60.0, max=14400.0, help="Length; repeat for a choice.")
    ] = None,
    severity: Annotated[
        list[float] | None, typer.Option(metavar="X", min=0.1, max=1000.0, help="Multiple of the detectable; repeat.")
    ] = None,
    effect: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Only these effects; repeat.")] = None,
    null_share: Annotated[float, typer.Option(min=0.0, max=1.0, help="Logs without any effect.")] = 0.35,
    pair_share: Annotated[float, typer.Option(min=0.0, max=1.0, help="Logs with two effects.")] = 0.12,
    foreign_share: Annotated[float, typer.Option(min=0.0, max=1.0, help="Effects outside the library.")] = 0.1,
    leave_out_share: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Logs whose effect is taken out of the library.")
    ] = 0.06,
    workers: Workers = 1,
    as_json: Json = False,
) -> None:
    """Draw logs of an independent reality, with the twins an engineer would believe, and lock the answers away."""
    from pipeline.blind.plan import Shares, Wish
    from pipeline.blind.sealing import seal as seal_set

    shares = Shares(null_share, pair_share, foreign_share, leave_out_share)
    stated: dict[str, Any] = {"names": effect, "severities": severity, "durations": duration}
    _check_names(effect or [])
    wish = Wish(**{name: tuple(values) for name, values in stated.items() if values}, shares=shares)
    where = key or folder.with_name(f"{folder.name}.key")
    with console.progress_bar() as progress:
        sealed = seal_set(folder, where, logs, wish, seed=seed, workers=workers, progress=progress)
    if as_json:
        console.emit({"folder": str(folder), "key": str(where), "logs": len(sealed.logs), "secret": sealed.secret})
        return
    warning = "" if sealed.secret else " The seed was given, so whoever knows it can repeat the draw."
    console.display(f"sealed {len(sealed.logs)} logs in {folder}; the key is {where}.{warning}")


@app.command(epilog="Example: deckflex blind answer sealed --workers 2 --baselines")
def answer(
    folder: Folder,
    method: Annotated[str, typer.Option(metavar="NAME", help="Who answers: deckflex, or a baseline.")] = "deckflex",
    baselines: Annotated[bool, typer.Option("--baselines", help="Let all baselines answer too.")] = False,
    without: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Deny the library these effects.")] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Logs that failed once more.")] = False,
    workers: Workers = 1,
    as_json: Json = False,
) -> None:
    """Diagnose every log of a set that has no answer yet; a log that fails is recorded and the rest go on."""
    from pipeline.blind.answering import BASELINES, METHODS
    from pipeline.blind.answering import answer as answer_set

    if method not in METHODS:
        raise typer.BadParameter(f"there is none named '{method}' (there are {', '.join(METHODS)})")
    _check_names(without or [])
    done: dict[str, Any] = {}
    for name in dict.fromkeys((method, *(BASELINES if baselines else ()))):
        with console.progress_bar() as progress:
            found = answer_set(
                folder, method=name, without=without or (), workers=workers, retry=retry, progress=progress
            )
        done[name] = {"answered": found.answered, "failed": list(found.failed), "before": found.before}
    if as_json:
        console.emit({"folder": str(folder), "methods": done})
        return
    for name, counts in done.items():
        failed = f", failed: {' '.join(counts['failed'])}" if counts["failed"] else ""
        console.display(f"{name}: {counts['answered']} logs answered, {counts['before']} before{failed}")


@app.command(epilog="Example: deckflex blind score sealed --key sealed.key -o score.json --page score.md")
def score(
    folder: Folder,
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Key of the set; DIR.key unless named.", show_default=False)
    ] = None,
    again: Annotated[bool, typer.Option("--again", help="Score a set whose seal was opened before.")] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="SCORE.json", help="Score to write.", show_default=False)
    ] = None,
    page: Annotated[
        Path | None, typer.Option(metavar="SCORE.md", help="Page to write; its figure beside it.", show_default=False)
    ] = None,
    as_json: Json = False,
) -> None:
    """Open the seal, check that nothing was changed, and say how good the answers are."""
    from pipeline.blind.folder import write_json
    from pipeline.blind.page import figure, markdown
    from pipeline.blind.scoring import score as score_set

    picture = page.with_suffix(".svg") if page else None
    for target in (output, page, picture):
        if target is not None:
            check_target(target, [])
    document = score_set(folder, key or folder.with_name(f"{folder.name}.key"), again=again)
    text = markdown(document, picture.name if picture else None)
    if output:
        write_json(output, document)
    if page and picture:
        page.write_text(text, "utf-8")
        picture.write_text(figure(document), "utf-8")
    if as_json:
        console.emit(document)
    else:
        console.display(text)


def _check_names(names: list[str]) -> None:
    """Stop with exit status 2 and the list of names when one is no effect of the list."""
    from pipeline.blind.reality.severity import LISTED

    for name in names:
        if name not in LISTED:
            raise typer.BadParameter(f"there is no effect named '{name}' (there are {', '.join(LISTED)})")
