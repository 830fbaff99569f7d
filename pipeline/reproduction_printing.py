"""What ``deckflex reproduce`` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.table import Table

from pipeline.experiments.claims import shown
from pipeline.reproduced import Outcome
from pipeline.tables import plain_table
from schemas.experiment import Figure, Part

COLUMNS = ("method", "quantity", "measured", "±", "n", "published", "limit")


def reproduction_report(outcomes: Sequence[Outcome], written: Mapping[str, str]) -> list[object]:
    """Every experiment's tables and claims, and what was written."""
    parts = [part for outcome in outcomes for part in _experiment(outcome)]
    return [*parts, "", *(f"wrote       {kind}: {path}" for kind, path in written.items())]


def _experiment(outcome: Outcome) -> list[object]:
    experiment = outcome.experiment
    seeds = f"seeds {outcome.seeds[0]} to {outcome.seeds[-1]}"
    head = [f"{experiment.name}: {experiment.about}", f"source      {experiment.source}", f"measured    {seeds}"]
    chosen = [f"chosen      {sentence}" for sentence in experiment.chosen]
    tables = [item for part in experiment.parts for item in ("", _table(part, outcome.of_part(part)))]
    claims = [f"{'holds' if holds else 'DOES NOT HOLD'}: {claim} ({said})" for claim, holds, said in outcome.verdicts()]
    return [*head, *chosen, *tables, "", *claims, ""]


def _table(part: Part, figures: Sequence[Figure]) -> Table:
    table = plain_table("case", *COLUMNS, title=part.title)
    for figure in figures:
        table.add_row(
            figure.case,
            figure.method,
            f"{figure.quantity} [{figure.unit}]",
            shown(figure.mean, 3),
            shown(figure.spread) if figure.n > 1 else "",
            str(figure.n),
            shown(figure.printed.value, 5) if figure.printed else "",
            shown(figure.limit.value) if figure.limit else "",
        )
    return table
