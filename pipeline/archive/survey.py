"""What an archive says: drifts of the static angle, flexure against the sea, effects that repeat, worst logs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from pipeline.archive.repeated import Reports, repeated
from pipeline.archive.rows import AXES
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.archive.line import Line
from stages.archive.repetition import Repetition
from stages.archive.trends import apart, drift, months_since, power_law

SIGNIFICANT = 0.01  # probability of a slope as large by chance below which a drift is said to be there
OFF_THE_LINE = 3.5  # standard deviations from the trend at which a voyage is pointed out
GROUPS = ("rig", "folder", "all")
WORST = 10


@dataclass(frozen=True)
class Fitted:
    """A line and the points it was fitted to. stamp: (n,) ns UTC. x, y, std: (n,). names: of the logs.

    away: (n,) distance from the line in standard deviations.
    """

    line: Line
    stamp: IntArray
    x: FloatArray
    y: FloatArray
    std: FloatArray
    names: tuple[str, ...]

    @property
    def away(self) -> FloatArray:
        """(n,) standard deviations off the line."""
        return apart(self.line, self.x, self.y, self.std)


@dataclass(frozen=True)
class Group:
    """Logs of one installation. drifts: of the static angle per axis, arcmin per month.

    laws: ln flexure against ln sea, per axis. reports: of the diagnoses, dates (k,) ns UTC theirs; effects: what they
    say together. epoch: ns UTC, where the months count from.
    """

    name: str
    frame: pl.DataFrame
    epoch: int
    drifts: tuple[Fitted, Fitted, Fitted]
    laws: tuple[Fitted, Fitted, Fitted]
    reports: Reports
    dates: IntArray
    effects: tuple[Repetition, ...]

    @property
    def months(self) -> float:
        """From the first log to the last."""
        spans = [fit.x for fit in self.drifts if len(fit.x)]
        return float(max(np.ptp(x) for x in spans)) if spans else 0.0


@dataclass(frozen=True)
class Survey:
    """frame: the rows looked at. aside: logs that were set aside, (name, reason). left_out: results not shown."""

    frame: pl.DataFrame
    groups: tuple[Group, ...]
    worst: pl.DataFrame
    aside: tuple[tuple[str, str], ...]
    left_out: int = 0

    @property
    def logs(self) -> int:
        """Logs with a result."""
        return self.frame.filter(pl.col("axis") == "x")["key"].n_unique()

    @property
    def hours(self) -> float:
        """Length of all logs together."""
        return float(self.frame.filter(pl.col("axis") == "x")["duration_s"].sum()) / 3600.0


def surveyed(frame: pl.DataFrame, by: str = "rig", left_out: int = 0) -> Survey:
    """Look at rows of the catalogue. by: what tells installations apart, one of GROUPS."""
    done = frame.filter(pl.col("state") == "done")
    names = sorted(done[by].unique().drop_nulls()) if by != "all" else ["all logs"]
    parts = [(name, done.filter(pl.col(by) == name) if by != "all" else done) for name in names]
    aside = frame.filter(pl.col("state") == "aside").select("name", "reason").rows()
    return Survey(
        done, tuple(_group(str(n), part) for n, part in parts if len(part)), worst_of(done), tuple(aside), left_out
    )


def worst_of(done: pl.DataFrame, count: int = WORST) -> pl.DataFrame:
    """A row a log, the least trustworthy first: by grade, then by error over what was expected, then by sigma."""
    order = {"bad": 0, "care": 1, "good": 2}
    columns = pl.col("rmse_ratio").max(), pl.col("predicted_std_arcmin").max()
    first = [pl.col(name).first() for name in ("name", "log", "start_utc", "grade", "doubts", "duration_s")]
    logs = done.group_by("key").agg(*first, *columns)
    ranked = logs.with_columns(pl.col("grade").replace_strict(order, default=3).alias("rank"))
    keys, down = ["rank", "rmse_ratio", "predicted_std_arcmin", "name"], [False, True, True, False]
    return ranked.sort(keys, descending=down, nulls_last=True).drop("rank").head(count)


def _group(name: str, frame: pl.DataFrame) -> Group:
    epoch = _stamps(frame).min() if len(frame) else 0
    diagnosed = frame.filter(pl.col("evidence").is_not_null())
    reports = [(name, json.loads(text)) for name, text in diagnosed.select("name", "evidence").rows()]
    drifts = [_drift(_axis(frame, axis), int(epoch)) for axis in AXES]
    laws = [_law(_axis(frame, axis)) for axis in AXES]
    return Group(name, frame, int(epoch), (drifts[0], drifts[1], drifts[2]), (laws[0], laws[1], laws[2]),
                 reports, _stamps(diagnosed), repeated(reports))  # fmt: skip


def _axis(frame: pl.DataFrame, axis: str) -> pl.DataFrame:
    return frame.filter(pl.col("axis") == axis)


def _drift(rows: pl.DataFrame, epoch: int) -> Fitted:
    """Of the static angle; logs that are not to be relied on, or do not show it, are left out."""
    good = rows.filter(pl.col("usable") & (pl.col("static_status") != "not observable"))
    good = good.filter(pl.col("static_arcmin").is_finite() & (pl.col("static_std_arcmin") > 0))
    stamp, y, std = _stamps(good), _real(good, "static_arcmin"), _real(good, "static_std_arcmin")
    line = drift(stamp, y, std, epoch)
    return Fitted(line, stamp, months_since(stamp, epoch), y, std, tuple(good["name"]))


def _law(rows: pl.DataFrame) -> Fitted:
    """ln flexure against ln roughness."""
    good = rows.filter(pl.col("usable") & (pl.col("flexure_status") != "not observable"))
    good = good.filter(
        (pl.col("flexure_std_arcmin") > 0) & (pl.col("roughness_dps") > 0) & (pl.col("flexure_log_std") > 0)
    )
    sea, flexure, std = (_real(good, name) for name in ("roughness_dps", "flexure_std_arcmin", "flexure_log_std"))
    return Fitted(power_law(sea, flexure, std), _stamps(good), np.log(sea), np.log(flexure), std, tuple(good["name"]))


def _real(frame: pl.DataFrame, column: str) -> FloatArray:
    return frame[column].to_numpy().astype(float)


def _stamps(frame: pl.DataFrame) -> IntArray:
    """ns UTC."""
    return np.asarray(frame["start_utc"].dt.epoch("ns").to_numpy(), dtype=np.int64)


def drifting(line: Line) -> bool:
    """Whether a drift is there."""
    return bool(np.isfinite(line.p_value) and line.p_value < SIGNIFICANT)


def survey_document(survey: Survey, notes: Sequence[str], path: str) -> dict[str, Any]:
    """As JSON."""
    from stages.publish.summary import plain

    document = {
        "catalogue": path,
        "logs": survey.logs,
        "hours": survey.hours,
        "set_aside": [{"name": name, "reason": reason} for name, reason in survey.aside],
        "left_out": survey.left_out,
        "installations": [_group_document(group) for group in survey.groups],
        "worst": [_plain_row(row) for row in survey.worst.iter_rows(named=True)],
        "notes": list(notes),
    }
    return dict(plain(document))


def _plain_row(row: dict[str, Any]) -> dict[str, Any]:
    return {**row, "start_utc": None if row["start_utc"] is None else row["start_utc"].isoformat()}


def _group_document(group: Group) -> dict[str, Any]:
    drifts = {axis: _line_document(fit, "arcmin_per_month") for axis, fit in zip(AXES, group.drifts)}
    laws = {axis: _line_document(fit, "exponent") for axis, fit in zip(AXES, group.laws)}
    effects = [
        {
            "effect": one.effect, "standing": str(one.standing), "evidence_nats": one.nats, "named_in": one.named,
            "against": list(one.against), "silent": len(one.silent),
            "parameters": {name: {"value": value.value, "std": value.std, "chi2": value.chi2, "dof": value.dof,
                                  "p_value": value.p_value} for name, value in one.parameters.items()},
        }
        for one in group.effects
    ]  # fmt: skip
    logs = group.frame.filter(pl.col("axis") == "x")["key"].n_unique()
    return {"name": group.name, "logs": logs, "months": group.months, "static_angle": drifts,
            "flexure_against_sea": laws, "effects": effects}  # fmt: skip


def _line_document(fit: Fitted, slope: str) -> dict[str, Any]:
    line = fit.line
    off = [name for name, away in zip(fit.names, np.abs(fit.away)) if away > OFF_THE_LINE]
    return {
        "logs": line.count, slope: line.slope, f"{slope}_std": line.slope_std, f"{slope}_ci95": list(line.slope_ci95),
        "p_value": line.p_value, "value": line.value, "value_std": line.value_std, "excess": line.excess,
        "chi2": line.chi2, "dof": line.dof, "off_the_line": off,
    }  # fmt: skip
