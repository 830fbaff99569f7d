"""A survey in words, tables and figures: what the terminal, the page and the recording of an archive all say."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import polars as pl

from pipeline.archive.repeated import units_of
from pipeline.archive.rows import AXES, CURVES
from pipeline.archive.survey import OFF_THE_LINE, Fitted, Group, Survey, drifting
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.archive.line import Line
from stages.archive.repetition import Repetition, Standing
from stages.archive.trends import MONTH_NS
from stages.publish.archive import AGAINST_THE_SEA, ArchiveReport, Fit, Listing, Relation, Trend
from stages.publish.document import number

NAMES = ("x (pitch)", "y (roll)", "z (heading)")
DRAWN = 60  # points of a fitted line
DISTRUST = {"bad": "do not rely on it", "care": "with care", "good": "good"}
ERRORS = (
    ("RMSE against truth", "rmse_truth_arcmin"),
    ("RMSE against PHINS", "rmse_phins_arcmin"),
    ("predicted σ", "predicted_std_arcmin"),
)
FIRM = (Standing.REPEATS, Standing.VARIES)


def archive_report(survey: Survey, title: str, notes: Sequence[str], provenance: dict[str, str]) -> ArchiveReport:
    """The answer, figures against date and the sea, tables."""
    return ArchiveReport(
        title=title,
        about=about(survey),
        grade=_grade(survey),
        headline=_headline(survey),
        sentences=[sentence for group in survey.groups for sentence in sentences(group, len(survey.groups) > 1)],
        trends=[trend for group in survey.groups for trend in _trends(group, len(survey.groups) > 1)],
        listings=listings(survey),
        warnings=[*warnings(survey), *notes],
        provenance=provenance,
        relations=[relation for group in survey.groups for relation in _relations(group, len(survey.groups) > 1)],
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
    size = f"{_signed(line.slope, 3)} ± {number(line.slope_std, 2)}′ a month ({whole})"
    if drifting(line):
        return f"About {axis} the static angle drifts by {size}, p = {line.p_value:.1g}."
    return f"About {axis} no drift is seen: {size}; at most {max(abs(low), abs(high)):.2g}′ a month with 95 %."


def _signed(value: float, digits: int) -> str:
    return ("+" if value >= 0 else "−") + number(abs(value), digits)


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
        _listing(survey, "Effects over the voyages", EFFECT_HEADER, effect_rows),
        Listing("Least trustworthy logs", WORST_HEADER, worst_rows(survey)),
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
EFFECT_HEADER = ("installation", "effect", "standing", "evidence [nats]", "named in", "against", "parameters")
WORST_HEADER = ("log", "start (UTC)", "verdict", "error/expected", "predicted σ [′]", "why")


def drift_rows(group: Group) -> list[tuple[str, ...]]:
    """A row an axis."""
    return [
        (group.name, axis, str(line.count), f"{line.value:+.3f} ± {line.value_std:.3f}",
         f"{_signed(line.slope, 3)} ± {number(line.slope_std, 2)}",
         f"{_signed(line.slope_ci95[0], 2)} to {_signed(line.slope_ci95[1], 2)}",
         f"{line.p_value:.2g}", f"{line.excess:.2g}")
        for axis, line in _known(group.drifts)
    ]  # fmt: skip


def law_rows(group: Group) -> list[tuple[str, ...]]:
    """A row an axis: flexure grows with the sea to the power of the exponent."""
    return [
        (group.name, axis, str(line.count), f"{np.exp(line.value):.3f}", f"{line.slope:+.2f} ± {line.slope_std:.2f}",
         f"{line.p_value:.2g}", f"{100 * line.excess:.0f}")
        for axis, line in _known(group.laws)
    ]  # fmt: skip


def _known(fits: Iterable[Fitted]) -> list[tuple[str, Line]]:
    """Lines that could be fitted, each with its axis."""
    return [(axis, fit.line) for axis, fit in zip(NAMES, fits) if np.isfinite(fit.line.slope)]


def effect_rows(group: Group) -> list[tuple[str, ...]]:
    """A row an effect."""
    return [
        (group.name, one.effect, str(one.standing), f"{one.nats:.1f}", str(one.named), str(len(one.against)),
         parameters_of(group, one))
        for one in group.effects
    ]  # fmt: skip


def parameters_of(group: Group, one: Repetition) -> str:
    """``delay 4.02e-03 ± 1e-05 s``, with a mark where the logs disagree."""
    units = units_of(group.reports, one.effect)
    return "; ".join(
        f"{name} {value.value:.4g} ± {value.std:.2g} {units.get(name, '')}".strip()
        + ("" if value.agrees else f" (the logs disagree: χ² {value.chi2:.0f} of {value.dof})")
        for name, value in one.parameters.items()
    )


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


def _trends(group: Group, several: bool) -> Iterable[Trend]:
    """Static angle per axis with its line, errors, flexure, curvature."""
    of = f", {group.name}" if several else ""
    for axis, fit in zip(NAMES, group.drifts):
        if len(fit.x):
            title = f"Static angle about {axis}{of}"
            yield Trend(
                title,
                "arcmin",
                fit.stamp,
                fit.y[:, None],
                fit.std[:, None],
                [axis],
                _drawn(fit, group.epoch),
                "Static angle",
            )
    yield from _errors(group.frame, of)
    yield from _delays(group.frame, of)
    yield from _flexures(group.frame, of)
    yield from _curvatures(group.frame, of)


def _errors(frame: pl.DataFrame, of: str) -> Iterable[Trend]:
    """Per axis the errors beside what was expected: heading is known far worse than the rest, so axes stand apart."""
    known = {name: _by_axis(frame, column) for name, column in ERRORS}
    known = {name: found for name, found in known.items() if np.isfinite(found[1]).any()}
    for i, axis in enumerate(NAMES if known else ()):
        stamp = next(iter(known.values()))[0]
        values = np.stack([found[1][:, i] for found in known.values()], axis=1)
        yield Trend(f"Error about {axis}{of}", "arcmin", stamp, values, None, list(known), tab="Accuracy")


def _flexures(frame: pl.DataFrame, of: str) -> Iterable[Trend]:
    columns = (
        ("Flexure σ", "arcmin", "flexure_std_arcmin"),
        ("Damping μ", "1/s", "flexure_damping"),
        ("Frequency λ", "rad/s", "flexure_frequency"),
        ("Motion of the ship, σ of the rate", "deg/s", "motion_dps"),
    )
    for title, unit, column in columns:
        stamp, values = _by_axis(frame, column)
        std = values * _by_axis(frame, "flexure_log_std")[1] if column == "flexure_std_arcmin" else None
        if np.isfinite(values).any():
            yield Trend(title + of, unit, stamp, values, std, NAMES, tab="Flexure")


def _curvatures(frame: pl.DataFrame, of: str) -> Iterable[Trend]:
    """Per kind of curvature, in 1e-5 rad/m: each changes by far less than one differs from another."""
    stamp, values = _by_axis(frame, "deck_peak_rad_per_m")
    std = _by_axis(frame, "deck_peak_std_rad_per_m")[1]
    for i, (axis, curve) in enumerate(zip(AXES, CURVES)):
        if np.isfinite(values[:, i]).any():
            kind = curve if curve == "torsion" else f"{curve} curvature"
            title, name = f"Largest {kind} of the deck{of}", f"{axis} ({curve})"
            value, spread = 1e5 * values[:, i, None], 1e5 * std[:, i, None]
            yield Trend(title, "1e-5 rad/m", stamp, value, spread, [name], tab="Deck shape")


def _delays(frame: pl.DataFrame, of: str) -> Iterable[Trend]:
    delay = frame.filter((pl.col("axis") == "x") & pl.col("time_delay_s").is_not_null())
    if len(delay):
        value, std = (1e3 * delay[name].cast(pl.Float64).fill_null(np.nan).to_numpy()[:, None]
                      for name in ("time_delay_s", "time_delay_std_s"))  # fmt: skip
        stamp = delay["start_utc"].dt.epoch("ns").to_numpy().astype(np.int64)
        yield Trend(f"Time delay of the sub-IMU{of}", "ms", stamp, value, std, ["time delay"], tab="Accuracy")


def _by_axis(frame: pl.DataFrame, column: str) -> tuple[IntArray, FloatArray]:
    """Stamps (k,) and values (k, 3), NaN where unknown."""
    parts = [frame.filter(pl.col("axis") == axis).sort("key") for axis in AXES]
    stamp = parts[0]["start_utc"].dt.epoch("ns").to_numpy().astype(np.int64)
    return stamp, np.stack([part[column].cast(pl.Float64).fill_null(np.nan).to_numpy() for part in parts], axis=1)


def _drawn(fit: Fitted, epoch: int) -> Fit | None:
    """The line over its own dates."""
    if not np.isfinite(fit.line.slope):
        return None
    x = np.linspace(fit.x.min(), fit.x.max(), DRAWN)
    return Fit(epoch + x * MONTH_NS, *fit.line.at(x))


def _relations(group: Group, several: bool) -> Iterable[Relation]:
    of = f", {group.name}" if several else ""
    for axis, fit in zip(NAMES, group.laws):
        if not np.isfinite(fit.line.slope):
            continue
        x = np.linspace(fit.x.min(), fit.x.max(), DRAWN)
        value, std = fit.line.at(x)
        curve = np.exp(value)
        yield Relation(
            f"Flexure about {axis} against the sea{of}",
            "pitch and roll rate of the ship, σ [deg/s]", "flexure σ [arcmin]",
            np.exp(fit.x), np.exp(fit.y), np.exp(fit.y) * fit.std, Fit(np.exp(x), curve, curve * std),
        )  # fmt: skip
