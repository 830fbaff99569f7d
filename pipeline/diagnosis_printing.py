"""What a diagnosis found, as sentences and tables for people."""

from __future__ import annotations

from collections.abc import Iterator

from rich.table import Table

from pipeline.console import display
from pipeline.tables import plain_table
from schemas.diagnosis import Diagnosis
from stages.publish import diagnosis_words as words

AXES = ("x", "y", "z")
MOST_ROWS = 12  # of the ranked table: the rest is counted


def print_diagnosis(diagnosis: Diagnosis) -> None:
    """Print everything ``deckflex diagnose`` says on standard output."""
    display(*diagnosis_report(diagnosis))


def diagnosis_report(diagnosis: Diagnosis) -> list[object]:
    """Verdict, where, ranked table, parameters, shrinkage, errors, look-alikes, what to do next."""
    parts: list[object] = [
        f"{diagnosis.log} against {diagnosis.twin}, {diagnosis.duration_s:.0f} s",
        f"{words.HEADLINES[diagnosis.verdict]} {words.sentence(diagnosis)}",
    ]
    tables = (section_table, ranked_table, parameter_table, shrinkage_table, error_table)
    for made in (table(diagnosis) for table in tables):
        parts += ["", made] if made is not None else []
    lines = list(_lines(diagnosis))
    return [*parts, *(["", *lines] if lines else [])]


def section_table(diagnosis: Diagnosis) -> Table | None:
    """What every section of a long record says."""
    rows = words.sections(diagnosis)
    if not rows:
        return None
    table = plain_table(*words.SECTION_HEADER)
    for column in table.columns:
        column.justify = "left"
    for row in rows:
        table.add_row(*row)
    return table


def ranked_table(diagnosis: Diagnosis) -> Table | None:
    """Effects by evidence; those beyond the first dozen, unless named, are counted only."""
    shown = [row for k, row in enumerate(diagnosis.tested) if row.named or k < MOST_ROWS]
    if not shown:
        return None
    table = plain_table("effect", "evidence [nats]", "needed [nats]", "")
    table.columns[3].justify = "left"
    for row in shown:
        table.add_row(row.name, words.nats(row.evidence_nats), words.nats(row.threshold_nats), words.judged(row))
    rest = len(diagnosis.tested) - len(shown)
    if rest:
        table.add_row(f"and {rest} more", "", "", "")
    return table


def parameter_table(diagnosis: Diagnosis) -> Table | None:
    """Every parameter of every named effect with its standard deviation."""
    if not diagnosis.effects:
        return None
    table = plain_table("named effect", "parameter", "value ± std", "strongest in")
    for column in table.columns[1:]:
        column.justify = "left"
    for finding in diagnosis.effects:
        rows = list(words.parameters(finding)) or [("", "")]
        place = words.place_text(finding.places[0]).removeprefix("the ") if finding.places else ""
        for k, (name, value) in enumerate(rows):
            table.add_row(finding.name if k == 0 else "", name, value, place if k == 0 else "")
    return table


def shrinkage_table(diagnosis: Diagnosis) -> Table | None:
    """How far the gap shrinks with the answer, and with what is not the answer."""
    rows = words.shrinkage(diagnosis)
    if not diagnosis.effects and len(rows) == 1:
        return None
    table = plain_table("gap with", "before", "after", "closed", "95 % interval", title=f"gap in {diagnosis.gap.unit}")
    for name, gap in rows:
        closed, low, high = (words.percent(share) for share in (gap.closed, *gap.closed_ci95))
        table.add_row(name, f"{gap.before:.4g}", f"{gap.after:.4g}", f"{closed} %", f"{low} – {high} %")
    return table


def error_table(diagnosis: Diagnosis) -> Table | None:
    """RMSE of the estimator on log, twin, twin with effects and compensated log."""
    rows = words.error_rows(diagnosis)
    if not rows:
        return None
    title = f"RMSE of the estimate{words.against(diagnosis)}"
    table = plain_table("RMSE on", *(f"{axis} [′]" for axis in AXES), title=title)
    for name, values in rows:
        table.add_row(name, *(f"{value:.3f}" for value in values))
    return table


def _lines(diagnosis: Diagnosis) -> Iterator[str]:
    where = [words.place_text(place).removeprefix("the ") for place in diagnosis.where[:3]]
    yield from (f"where       {place}" for place in where)
    if diagnosis.transfer is not None:
        yield f"follows     {words.transfer_text(diagnosis.transfer)}"
    yield from (f"look-alike  {line}" for line in words.look_alikes(diagnosis))
    yield from (f"next        {line}" for line in diagnosis.advice)
    yield from (f"untestable  {name}: {why}" for name, why in diagnosis.untestable.items())
    yield from (f"note        {line}" for line in diagnosis.notes)
