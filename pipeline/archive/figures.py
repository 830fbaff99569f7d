"""The figures of an archive: angles, errors, flexure, curvature and repeating effects against date, flexure against
the sea."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import polars as pl

from pipeline.archive.repeated import stated, units_of
from pipeline.archive.rows import AXES, CURVES
from pipeline.archive.survey import Fitted, Group
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.archive.repetition import FIRM, Agreed, Repetition
from stages.archive.trends import MONTH_NS
from stages.publish.archive import Fit, Relation, Trend

NAMES = ("x (pitch)", "y (roll)", "z (heading)")
DRAWN = 60  # points of a fitted line
ERRORS = (
    ("RMSE against truth", "rmse_truth_arcmin"),
    ("RMSE against PHINS", "rmse_phins_arcmin"),
    ("predicted σ", "predicted_std_arcmin"),
)


def trends_of(group: Group, several: bool) -> Iterable[Trend]:
    """Static angle per axis with its line, effects that repeat, errors, flexure, curvature."""
    of = f", {group.name}" if several else ""
    for axis, fit in zip(NAMES, group.drifts):
        if len(fit.x):
            title, values, std = f"Static angle about {axis}{of}", fit.y[:, None], fit.std[:, None]
            yield Trend(title, "arcmin", fit.stamp, values, std, [axis], _drawn(fit, group.epoch), "Static angle")
    for one in group.effects:
        if one.standing in FIRM:
            yield from _effect(group, one, of)
    yield from _errors(group.frame, of)
    yield from _delays(group.frame, of)
    yield from _flexures(group.frame, of)
    yield from _curvatures(group.frame, of)


def _effect(group: Group, one: Repetition, of: str) -> Iterable[Trend]:
    """What the voyages that name an effect say of its parameters, with the common values; a figure for each unit."""
    units = units_of(group.reports, one.effect)
    told = [stated(report, one.effect) for _, report in group.reports]
    named = np.array([bool(values) for values in told])
    kinds = list(dict.fromkeys(units[name] for name in one.parameters))
    for unit in kinds:
        names = [name for name in one.parameters if units[name] == unit]
        found = np.array([[values[name] for name in names] for values in told if values])
        what = f" {names[0].partition('.')[0]}" if len(kinds) > 1 else ""
        stamp = group.dates[named]
        fits = [_common(stamp, one.parameters[name]) for name in names]
        yield Trend(f"{one.effect}{what}{of}", unit or "1", stamp, found[..., 0], found[..., 1], names, fits, "Effects")


def _common(stamp: IntArray, agreed: Agreed) -> Fit:
    """A common value, from the first voyage to the last."""
    ends = np.array([stamp.min(), stamp.max()], dtype=float)
    return Fit(ends, np.full(2, agreed.value), np.full(2, agreed.std), "common value")


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


def _drawn(fit: Fitted, epoch: int) -> list[Fit]:
    """The line over its own dates, where there is one."""
    if not np.isfinite(fit.line.slope):
        return []
    x = np.linspace(fit.x.min(), fit.x.max(), DRAWN)
    return [Fit(epoch + x * MONTH_NS, *fit.line.at(x))]


def relations_of(group: Group, several: bool) -> Iterable[Relation]:
    """Flexure against the sea, an axis each."""
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
