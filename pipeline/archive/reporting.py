"""A survey in words, tables and figures: what the terminal, the page and the recording of an archive all say."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import polars as pl

from pipeline.archive.figures import NAMES, relations_of, trends_of
from pipeline.archive.repeated import units_of
from pipeline.archive.survey import OFF_THE_LINE, Fitted, Group, Survey, drifting
from schemas.diagnosis import ParameterEstimate
from stages.archive.line import Line
from stages.archive.repetition import FIRM, Agreed, Repetition
from stages.publish.archive import AGAINST_THE_SEA, ArchiveReport, Listing
from stages.publish.diagnosis_words import value_text
from stages.publish.document import number

PLAIN = 1e-4  # standard deviations between it and its inverse are written without exponents
DISTRUST = {"bad": "do not rely on it", "care": "with care", "good": "good"}


def archive_report(survey: Survey, title: str, notes: Sequence[str], provenance: dict[str, str]) -> ArchiveReport:
    """The answer, figures against date and the sea, tables."""
    return ArchiveReport(
        title=title,
        about=about(survey),
        grade=_grade(survey),
        headline=_headline(survey),
        sentences=[sentence for group in survey.groups for sentence in sentences(group, len(survey.groups) > 1)],
        trends=[trend for group in survey.groups for trend in trends_of(group, len(survey.groups) > 1)],
        listings=listings(survey),
        warnings=[*warnings(survey), *notes],
        provenance=provenance,
        relations=[relation for group in survey.groups for relation in relations_of(group, len(survey.groups) > 1)],
    )


def about(survey: Survey) -> str:
    """How much there is, and from when to when."""
    aside = f"; {len(survey.aside)} logs set aside" if survey.aside else ""
    if survey.frame.is_empty():
        return f"no log with a result{aside}"
    first, last = survey.frame["start_utc"].min(), survey.frame["start_utc"].max()
    return f"{survey.logs} logs, {survey.hours:.2f} h, {_day(first)} to {_day(last)}{aside}"


def _day(when: object) -> str:
    return str(when)[:10]


def _grade(survey: Survey) -> str:
    bad = survey.frame.filter((pl.col("axis") == "x") & (pl.col("grade") == "bad"))
    if not survey.logs or 2 * len(bad) > survey.logs:
        return "bad"
    moved = any(drifting(fit.line) for group in survey.groups for fit in group.drifts)
    found = any(one.standing in FIRM for group in survey.groups for one in group.effects)
    return "care" if moved or found or len(bad) or survey.aside else "good"


def _headline(survey: Survey) -> str:
    if not survey.logs:
        return "No log of this archive has a result."
    if not any(np.isfinite(fit.line.slope) for group in survey.groups for fit in group.drifts):
        return "Too few logs at different times to see a drift of the static angle."
    moved = [axis for i, axis in enumerate(NAMES) if any(drifting(group.drifts[i].line) for group in survey.groups)]
    named = sorted({one.effect for group in survey.groups for one in group.effects if one.standing in FIRM})
    said = f"The static angle drifts about {', '.join(moved)}." if moved else "No drift of the static angle is seen."
    return said + (f" Repeats over the voyages: {', '.join(named)}." if named else "")


def sentences(group: Group, several: bool) -> list[str]:
    """The drift of each axis in words."""
    of = f"{group.name}: " if several else ""
    if all(not np.isfinite(fit.line.slope) for fit in group.drifts):
        return [f"{of}too few logs at different times for a trend."] if several else []
    return [of + _drift_words(axis, fit.line, group.months) for axis, fit in zip(NAMES, group.drifts)]


def _drift_words(axis: str, line: Line, months: float) -> str:
    if not np.isfinite(line.slope):
        return f"About {axis} too few logs can be used for a trend."
    low, high = line.slope_ci95
    whole = f"{_signed(line.slope * months, 2)}′ over {months:.1f} months"
    size = f"{_with_std(line.slope, line.slope_std)}′ a month ({whole})"
    if drifting(line):
        return f"About {axis} the static angle drifts by {size}, p = {line.p_value:.1g}."
    return f"About {axis} no drift is seen: {size}; at most {max(abs(low), abs(high)):.2g}′ a month with 95 %."


def _signed(value: float, digits: int) -> str:
    return ("+" if value >= 0 else "−") + number(abs(value), digits)


def _with_std(value: float, std: float) -> str:
    """Both to the second digit of the standard deviation: ``+3.90 ± 0.32``."""
    digits = 1 - math.floor(math.log10(float(f"{std:.1e}"))) if std > 0 else 3
    digits = min(max(digits, 0), 6)
    return _minus(f"{value:+.{digits}f} ± {std:.{digits}f}")


def _minus(text: str) -> str:
    """A minus sign before a figure, not a hyphen."""
    return f"−{text[1:]}" if text.startswith("-") else text


def warnings(survey: Survey) -> list[str]:
    """What a reader should distrust."""
    out = (
        [f"{survey.left_out} results of other options, versions or earlier contents are not shown"]
        if survey.left_out
        else []
    )
    for group in survey.groups:
        for axis, fit in zip(NAMES, group.drifts):
            if fit.line.excess > 0 and fit.line.chi2 > 4 * max(fit.line.dof, 1):
                out.append(
                    f"{group.name}: static angles about {axis} scatter by {fit.line.excess:.2g}′ more than they say"
                )
            off = [name for name, away in zip(fit.names, np.abs(fit.away)) if away > OFF_THE_LINE]
            if off:
                out.append(
                    f"{group.name}: far off the trend about {axis}: {', '.join(off[:5])}"
                    + (" …" if len(off) > 5 else "")
                )
    return out


def listings(survey: Survey) -> list[Listing]:
    """Drifts, flexure against the sea, effects that repeat, worst logs, logs set aside; those that have anything."""
    every = [
        _listing(survey, "Drift of the static angle", DRIFT_HEADER, drift_rows),
        _listing(survey, AGAINST_THE_SEA, LAW_HEADER, law_rows),
        _listing(survey, "Verdicts of the diagnoses", VERDICT_HEADER, verdict_rows),
        _listing(survey, "Effects over the voyages", EFFECT_HEADER, effect_rows),
        _listing(survey, "Size of the effects that repeat", SIZE_HEADER, size_rows),
        Listing("Least trustworthy logs", WORST_HEADER, worst_rows(survey)),
        Listing("Without a diagnosis", ("log", "reason"), undiagnosed(survey)),
        Listing("Set aside", ("log", "reason"), sorted(survey.aside)),
    ]
    return [listing for listing in every if listing.rows]


def _listing(
    survey: Survey, title: str, header: Sequence[str], rows: Callable[[Group], list[tuple[str, ...]]]
) -> Listing:
    """The rows of every installation; of a single one without its name."""
    found = [row for group in survey.groups for row in rows(group)]
    if len(survey.groups) > 1:
        return Listing(title, header, found)
    return Listing(title, header[1:], [row[1:] for row in found])


DRIFT_HEADER = (
    "installation",
    "axis",
    "logs",
    "static angle [′]",
    "drift [′/month]",
    "95 %",
    "p",
    "excess scatter [′]",
)
LAW_HEADER = ("installation", "axis", "logs", "flexure σ at the mean sea [′]", "exponent", "p", "scatter [%]")
VERDICT_HEADER = ("installation", "verdict", "logs", "gap closed, median [%]")
EFFECT_HEADER = ("installation", "effect", "standing", "evidence [nats]", "against", "logs that name it")
SIZE_HEADER = ("installation", "effect", "parameter", "common value", "χ²", "the logs")
WORST_HEADER = ("log", "start (UTC)", "verdict", "error/expected", "predicted σ [′]", "why")


def drift_rows(group: Group) -> list[tuple[str, ...]]:
    """A row an axis."""
    return [
        (group.name, axis, str(line.count), _with_std(line.value, line.value_std),
         _with_std(line.slope, line.slope_std),
         f"{_signed(line.slope_ci95[0], 2)} to {_signed(line.slope_ci95[1], 2)}",
         f"{line.p_value:.2g}", f"{line.excess:.2g}")
        for axis, line in _known(group.drifts)
    ]  # fmt: skip


def law_rows(group: Group) -> list[tuple[str, ...]]:
    """A row an axis: flexure grows with the sea to the power of the exponent."""
    return [
        (group.name, axis, str(line.count), f"{np.exp(line.value):.3f}", _with_std(line.slope, line.slope_std),
         f"{line.p_value:.2g}", f"{100 * line.excess:.0f}")
        for axis, line in _known(group.laws)
    ]  # fmt: skip


def _known(fits: Iterable[Fitted]) -> list[tuple[str, Line]]:
    """Lines that could be fitted, each with its axis."""
    return [(axis, fit.line) for axis, fit in zip(NAMES, fits) if np.isfinite(fit.line.slope)]


def verdict_rows(group: Group) -> list[tuple[str, ...]]:
    """A row a verdict, the most frequent first."""
    told = group.frame.filter((pl.col("axis") == "x") & pl.col("twin").is_not_null()).group_by("diagnosis")
    counted = told.agg(pl.len().alias("logs"), pl.col("gap_closed").median())
    return [
        (group.name, verdict.replace("_", " "), str(logs), "–" if closed is None else f"{100 * closed:.1f}")
        for verdict, logs, closed in counted.sort("logs", "diagnosis", descending=[True, False]).rows()
    ]


def undiagnosed(survey: Survey) -> list[tuple[str, str]]:
    """Logs that could not be held against the twin, with the reason."""
    without = (pl.col("axis") == "x") & pl.col("twin").is_null() & pl.col("diagnosis").is_not_null()
    return sorted(survey.frame.filter(without).select("name", "diagnosis").rows())


def effect_rows(group: Group) -> list[tuple[str, ...]]:
    """A row an effect."""
    return [
        (group.name, one.effect, str(one.standing), f"{one.nats:.1f}", str(len(one.against)), _naming(one))
        for one in group.effects
    ]  # fmt: skip


def _naming(one: Repetition) -> str:
    """How many logs name it; a single one by its own name."""
    return one.pointing[0] if one.named == 1 and one.pointing else str(one.named)


def size_rows(group: Group) -> list[tuple[str, ...]]:
    """A row a parameter of the effects that repeat; of those named once the log's own report tells."""
    return [
        (group.name, one.effect, name, *_size(agreed, units.get(name, "")))
        for one in group.effects
        if one.standing in FIRM
        for units in [units_of(group.reports, one.effect)]
        for name, agreed in one.parameters.items()
    ]


def _size(agreed: Agreed, unit: str) -> tuple[str, str, str]:
    """``0.003993 ± 4.3e-06 s``, ``9.1 of 8``, ``agree``."""
    if PLAIN <= agreed.std < 1.0 / PLAIN:
        shown = f"{_with_std(agreed.value, agreed.std)} {unit}".strip()
    else:
        shown = _minus(value_text(ParameterEstimate(agreed.value, agreed.std, unit)))
    return shown, f"{agreed.chi2:.1f} of {agreed.dof}", "agree" if agreed.agrees else "disagree"


def worst_rows(survey: Survey) -> list[tuple[str, ...]]:
    """The logs to look at first; none where all are good."""
    shown = survey.worst.filter(pl.col("grade") != "good")
    return [
        (row["name"], f"{row['start_utc']:%Y-%m-%d %H:%M}", DISTRUST.get(row["grade"], row["grade"]),
         _number(row["rmse_ratio"]), _number(row["predicted_std_arcmin"]), "; ".join((row["doubts"] or [])[:1]))
        for row in shown.iter_rows(named=True)
    ]  # fmt: skip


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
