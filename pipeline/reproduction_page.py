"""Experiments in Markdown: every figure from a measured row, so that the same rows give the same page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from pipeline.experiments.bench import AXES
from pipeline.experiments.claims import shown
from pipeline.reproduced import Outcome, named
from schemas.experiment import Figure, Part, Values
from stages.publish.document import table

OURS = ("smoother", "spline")
ERRORS = ("RMS", "error", "mean error", "flexure", "ratio", "its own")  # what quantities begin with that are errors
HEAD = """# Published experiments, run again

Made by `deckflex reproduce all`, from measured figures alone; run it again to make it anew. The same version, seeds
and libraries give the same page.

Means over the seeds, ± their standard deviation, n seeds. x is pitch, y roll, z heading. *Published* is what the paper
prints; *limit* what the best possible estimator with the true model reaches under the same conditions, computed
beforehand from its covariance; *ours* the method of this project on the same trials, `smoother` or `spline`. A ratio
says how many times the error of ours fits into the other one. An error over few seeds scatters by 20 to 40 %: it is
mostly one slowly varying constant a run."""


def page(outcomes: Sequence[Outcome]) -> str:
    """The whole page, ending with a line break."""
    parts = [HEAD, _made_with(outcomes), _summary(outcomes), *(experiment_text(outcome) for outcome in outcomes)]
    return "\n\n".join(part.rstrip() for part in parts) + "\n"


def experiment_text(outcome: Outcome) -> str:
    """One experiment: what it is, what was chosen, claims, tables."""
    experiment = outcome.experiment
    seeds = f"Seeds {outcome.seeds[0]} to {outcome.seeds[-1]}" if len(outcome.seeds) > 1 else "Seed 1 alone"
    twins = ", ".join(f"`{name}`" for name in experiment.twins)
    parts = [
        f"## {experiment.about}",
        f"`deckflex reproduce {experiment.name}` · {experiment.source} · twin {twins} · {seeds}.",
        "Chosen here, since it is not printed or not clear:",
        "\n".join(f"- {sentence}" for sentence in experiment.chosen),
        _claims(outcome.verdicts()),
        *(_part(part, outcome.of_part(part)) for part in experiment.parts),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _made_with(outcomes: Sequence[Outcome]) -> str:
    found = {tuple(sorted(outcome.versions.items())) for outcome in outcomes}
    return "\n".join(
        "Measured with " + ", ".join(f"{name} {number}" for name, number in one) + "." for one in sorted(found)
    )


def _summary(outcomes: Sequence[Outcome]) -> str:
    rows = [
        [f"`{outcome.experiment.name}`", claim, "yes" if holds else "**no**", figures]
        for outcome in outcomes
        for claim, holds, figures in outcome.verdicts()
    ]
    return "## In short\n\n" + table(["experiment", "claim", "holds", "measured"], rows)


def _claims(verdicts: Iterable[tuple[str, bool, str]]) -> str:
    rows = [[claim, "yes" if holds else "**no**", figures] for claim, holds, figures in verdicts]
    return table(["claim", "holds", "measured"], rows) if rows else ""


def _part(part: Part, figures: Sequence[Figure]) -> str:
    if not figures:
        return ""
    body = _grids(figures) if part.grid else _listed(figures)
    return "\n\n".join(text for text in (f"### {part.title}", part.text, body) if text)


def _listed(figures: Sequence[Figure]) -> str:
    """One row a figure; columns that would be empty are left out."""
    ours = _ours(figures)
    columns: Mapping[str, list[str]] = {
        "case": [f.case for f in figures],
        "method": [f"`{f.method}`" for f in figures],
        "quantity": [f"{f.quantity} [{f.unit}]" if f.unit else f.quantity for f in figures],
        "measured": [measured(f) for f in figures],
        "n": [str(f.n) for f in figures],
        "published": [shown(f.printed.value, 5) if f.printed else "" for f in figures],
        "where": [f.printed.where if f.printed else "" for f in figures],
        "measured / ours": [_ratio(f.mean, _own(ours, f)) for f in figures],
        "published / ours": [_ratio(f.printed.value, _own(ours, f)) if f.printed else "" for f in figures],
        "limit": [shown(f.limit.value) if f.limit else "" for f in figures],
        "measured / limit": [_ratio(f.mean, f.limit.value) if f.limit else "" for f in figures],
    }
    kept = {name: cells for name, cells in columns.items() if any(cells)}
    rows = [list(cells) for cells in zip(*kept.values())]
    return "\n\n".join([table(list(kept), rows), *_notes(figures)])


def measured(figure: Figure) -> str:
    """Mean and spread: three digits of an error, five of what was found."""
    mean = shown(figure.mean, 3 if figure.quantity.startswith(ERRORS) else 5)
    return f"{mean} ± {shown(figure.spread)}" if figure.n > 1 else mean


def _ours(figures: Sequence[Figure]) -> dict[tuple[str, str], Values]:
    """The mean of our method by case and quantity, for errors alone."""
    return {(f.case, f.quantity): f.mean for f in figures if f.method in OURS and f.quantity.startswith("RMS")}


def _own(ours: Mapping[tuple[str, str], Values], figure: Figure) -> Values | None:
    return None if figure.method in OURS else ours.get((figure.case, figure.quantity))


def _ratio(values: Values, over: Values | None) -> str:
    if over is None or len(values) != len(over):
        return ""
    return shown(tuple(float(v) for v in np.array(values) / np.array(over)))


def _notes(figures: Sequence[Figure]) -> list[str]:
    said = dict.fromkeys(f"{figure.method}: {figure.note}." for figure in figures if figure.note)
    said |= dict.fromkeys(_limits(figures))
    return ["\n".join(f"- {note}" for note in said)] if said else []


def _limits(figures: Sequence[Figure]) -> list[str]:
    """What each limit is that of, in the order of the limits, the whole one before those like it."""
    methods: dict[str, dict[str, None]] = {}
    for figure in sorted(figures, key=lambda f: f.method not in OURS):
        if figure.limit:
            methods.setdefault(figure.limit.where, {})[f"`{figure.method}`"] = None
    return [f"Limit of {', '.join(names)}: {where}." for where, names in methods.items()]


def _grids(figures: Sequence[Figure]) -> str:
    """Per axis a sheet: method and row of the case against column of the case."""
    known = named(figures)
    methods = list(dict.fromkeys(figure.method for figure in figures))
    rows, columns = ([*dict.fromkeys(figure.case.split(" / ")[i] for figure in figures)] for i in (0, 1))
    quantity = figures[0].quantity
    sheets = []
    for axis, name in enumerate(AXES):
        lines = [
            [
                f"`{method}`",
                row,
                *(_cell(known.get((f"{row} / {column}", method, quantity)), axis) for column in columns),
            ]
            for method in methods
            for row in rows
        ]
        sheets.append(f"{name}, n = {figures[0].n}:\n\n" + table(["method", "misalignment / delay", *columns], lines))
    return "\n\n".join(sheets)


def _cell(figure: Figure | None, axis: int) -> str:
    if figure is None:
        return "–"
    spread = f" ± {shown((figure.spread[axis],))}" if figure.n > 1 else ""
    return shown((figure.mean[axis],)) + spread
