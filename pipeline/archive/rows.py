"""The catalogue as a table: a row a log and axis, from the entries of the manifest."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

import polars as pl

from stages.publish.summary import AXES as CURVES

AXES = ("x", "y", "z")
TEXT, REAL, WHOLE, LISTED = pl.String(), pl.Float64(), pl.Int64(), pl.List(pl.String())
SCHEMA: dict[str, pl.DataType] = {
    "key": TEXT, "state": TEXT, "name": TEXT, "folder": TEXT, "log": TEXT, "sha256": TEXT, "bytes": WHOLE,
    "config": TEXT, "version": TEXT, "estimator": TEXT, "identifier": TEXT, "rig": TEXT,
    "start_utc": pl.Datetime("us", "UTC"), "duration_s": REAL, "samples": WHOLE, "reason": TEXT,
    "grade": TEXT, "usable": pl.Boolean(), "doubts": LISTED, "warnings": LISTED,
    "axis": TEXT,
    "static_arcmin": REAL, "static_std_arcmin": REAL, "static_status": TEXT,
    "time_delay_s": REAL, "time_delay_std_s": REAL, "time_delay_status": TEXT,
    "flexure_std_arcmin": REAL, "flexure_damping": REAL, "flexure_frequency": REAL,
    "flexure_log_std": REAL, "flexure_status": TEXT,
    "predicted_std_arcmin": REAL, "deformation_std_arcmin": REAL,
    "rmse_truth_arcmin": REAL, "rmse_phins_arcmin": REAL, "phins_noise_arcmin": REAL, "rmse_ratio": REAL,
    "motion_dps": REAL, "roughness_dps": REAL, "vertical_ms2": REAL,
    "deck_curvature": TEXT, "deck_peak_rad_per_m": REAL, "deck_peak_std_rad_per_m": REAL, "deck_peak_at_m": REAL,
    "deck_exceeds_limit": pl.Boolean(), "deck_passes": WHOLE,
    "twin": TEXT, "diagnosis": TEXT, "effects": LISTED, "gap_before": REAL, "gap_after": REAL, "gap_closed": REAL,
    "evidence": TEXT,
    "cpu_s": REAL, "peak_memory_gb": REAL, "finished_utc": TEXT,
}  # fmt: skip
"""Every column: angles in arcminutes, rates in degrees per second, curvature in rad/m, times in s and UTC.

usable: whether trends use the log; the truth of a simulated one has no say in it.
static_*: the angle between the units, about the axis. flexure_log_std: standard deviation of ln flexure_std_arcmin.
rmse_ratio: RMSE over what the estimate's covariance and the reference's noise allow, the largest of the references.
motion_dps: of the ship about the axis, roughness_dps: pitch and roll together. deck_*: the curvature about the axis
(vertical, torsion, horizontal). evidence: JSON of what the diagnosis named and tested, in the row of x. A log that was
set aside has one row, without axis, and its reason.
"""

Row = dict[str, Any]


def frame_of(entries: Iterable[Mapping[str, Any]]) -> pl.DataFrame:
    """All rows of the entries."""
    rows = [row for entry in entries for row in rows_of(entry)]
    return pl.DataFrame([{name: row.get(name) for name in SCHEMA} for row in rows], schema=SCHEMA, strict=False)


def rows_of(entry: Mapping[str, Any]) -> list[Row]:
    """A row for each axis; one for a log that was set aside."""
    if entry["state"] != "done":
        return [_head(entry)]
    head = {**_head(entry), **_of_log(entry), **_diagnosed(entry)}
    report = entry.get("diagnosis")
    evidence = {"evidence": _evidence(report)} if report else {}
    return [{**head, **_of_axis(entry, i), **(evidence if i == 0 else {})} for i in range(3)]


def _evidence(report: Mapping[str, Any]) -> str:
    """What combines over logs: named effects with their parameters, and how the others were tested."""
    tested = [
        {name: row[name] for name in ("name", "evidence_nats", "threshold_nats", "named")} for row in report["tested"]
    ]
    return json.dumps({"effects": report["effects"], "tested": tested}, separators=(",", ":"))


def _head(entry: Mapping[str, Any]) -> Row:
    folder, _, _ = str(entry["name"]).replace("\\", "/").rpartition("/")
    names = ("key", "state", "name", "log", "sha256", "bytes", "config", "version", "reason")
    return {**{name: entry.get(name) for name in names}, "folder": folder}


def _of_log(entry: Mapping[str, Any]) -> Row:
    summary, details = entry["summary"], entry["summary"]["details"]
    return {
        "estimator": summary["estimator"],
        "identifier": summary["identifier"],
        "rig": entry["rig"],
        "start_utc": _when(entry["start_utc"]),
        "duration_s": summary["duration_s"],
        "samples": summary["samples"],
        "grade": entry["verdict"]["grade"],
        "usable": entry["verdict"].get("usable", entry["verdict"]["grade"] != "bad"),
        "doubts": entry["verdict"]["reasons"],
        "warnings": summary["warnings"],
        "time_delay_s": summary["time_delay_s"],
        "time_delay_std_s": details["time_delay_std_s"],
        "time_delay_status": details["time_delay_status"],
        "roughness_dps": entry["motion"]["roughness_dps"],
        "vertical_ms2": entry["motion"]["vertical_ms2"],
        "cpu_s": entry["cost"]["cpu_s"],
        "peak_memory_gb": entry["cost"]["peak_memory_gb"],
        "finished_utc": entry["finished_utc"],
    }


def _when(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


def _of_axis(entry: Mapping[str, Any], i: int) -> Row:
    summary, details = entry["summary"], entry["summary"]["details"]
    flexure = summary["flexure"]
    return {
        "axis": AXES[i],
        "static_arcmin": summary["static_arcmin"][i],
        "static_std_arcmin": details["static_std_arcmin"][i],
        "static_status": details["static_status"],
        "flexure_std_arcmin": flexure["std_arcmin"][i],
        "flexure_damping": flexure["damping"][i],
        "flexure_frequency": flexure["frequency"][i],
        "flexure_log_std": entry["flexure"]["log_std"][i][2],
        "flexure_status": entry["flexure"]["status"][i],
        "predicted_std_arcmin": details["predicted_std_arcmin"][i],
        "deformation_std_arcmin": details["deformation_std_arcmin"][i],
        "motion_dps": entry["motion"]["rate_dps"][i],
        **_scored(details["scores"], i),
        **_deck(summary["deck_shape"], i),
    }


def _scored(scores: Iterable[Mapping[str, Any]], i: int) -> Row:
    row: Row = {}
    ratios = []
    for score in scores:
        rmse, own, noise = (
            score[name][i] for name in ("rmse_arcmin", "predicted_std_arcmin", "reference_noise_arcmin")
        )
        row[f"rmse_{score['reference']}_arcmin"] = rmse
        if score["reference"] == "phins":
            row["phins_noise_arcmin"] = noise
        allowed = ((own or 0.0) ** 2 + (noise or 0.0) ** 2) ** 0.5
        ratios += [rmse / allowed] if rmse is not None and allowed > 0 else []
    return {**row, "rmse_ratio": max(ratios, default=None)}


def _deck(shape: Mapping[str, Any] | None, i: int) -> Row:
    if shape is None:
        return {}
    curve = shape[CURVES[i]]
    return {
        "deck_curvature": CURVES[i],
        "deck_peak_rad_per_m": curve["peak_rad_per_m"],
        "deck_peak_std_rad_per_m": curve["peak_std_rad_per_m"],
        "deck_peak_at_m": curve["peak_at_m"],
        "deck_exceeds_limit": bool(curve["exceeds_limit_at_m"]),
        "deck_passes": shape["passes"],
    }


def _diagnosed(entry: Mapping[str, Any]) -> Row:
    report = entry.get("diagnosis")
    if report is None:
        return {"diagnosis": entry.get("diagnosis_problem")}
    gap = report["gap"]
    return {
        "twin": report["twin"],
        "diagnosis": report["verdict"],
        "effects": [effect["name"] for effect in report["effects"]],
        "gap_before": gap["before"],
        "gap_after": gap["after"],
        "gap_closed": gap["closed"],
    }
