"""A result in figures for people and programs: plain numbers, lists and strings, angles in arcminutes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from physics.units import ARCMIN
from schemas.products import DeckShape, Deformation, FlexureModel, Result, Score
from stages.publish.best import static_angle, time_delay
from stages.publish.rows import known_rows

AXES = ("vertical", "torsion", "horizontal")  # curvature about x, y, z
REFERENCES = ("truth", "phins")


def summary(result: Result, log: str = "", wall_s: float | None = None) -> dict[str, Any]:
    """What ``run --json`` prints: the contract's keys, and under ``details`` what else a reader may ask for.

    log: the log's name (default: the provenance's). wall_s: seconds the run took. A figure that is not known is None.
    """
    deformation = result.deformation
    document = {
        "log": log or result.provenance.get("log", ""),
        "estimator": deformation.estimator,
        "identifier": result.provenance.get("identifier", deformation.flexure.method),
        "duration_s": _span(deformation),
        "samples": len(deformation.stamp),
        "static_arcmin": static_angle(deformation).value / ARCMIN,
        "time_delay_s": time_delay(deformation).value,
        "flexure": _flexure(deformation.flexure),
        "rmse_arcmin": dict.fromkeys(REFERENCES) | {s.reference: s.rmse / ARCMIN for s in result.scores},
        "deck_shape": _deck_shape(result.deck_shape),
        "warnings": list(result.warnings),
        "wall_s": wall_s,
        "details": _details(result),
    }
    plain_document: dict[str, Any] = plain(document)
    return plain_document


def plain(value: Any) -> Any:
    """The same data of lists, dicts, numbers and strings alone; a number that is not finite becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _span(deformation: Deformation) -> float:
    return float(deformation.stamp[-1] - deformation.stamp[0]) * 1e-9 if len(deformation.stamp) else 0.0


def _flexure(flexure: FlexureModel) -> dict[str, Any]:
    return {"damping": flexure.damping, "frequency": flexure.frequency, "std_arcmin": flexure.std / ARCMIN}


def _details(result: Result) -> dict[str, Any]:
    deformation = result.deformation
    static, delay = static_angle(deformation), time_delay(deformation)
    variance = known_rows(np.diagonal(deformation.covariance, axis1=1, axis2=2))
    return {
        "static_std_arcmin": static.std / ARCMIN,
        "static_status": str(static.status),
        "time_delay_std_s": delay.std,
        "time_delay_status": str(delay.status),
        "predicted_std_arcmin": np.sqrt(variance.mean(axis=0)) / ARCMIN if len(variance) else [None] * 3,
        "deformation_std_arcmin": np.nanstd(deformation.total, axis=0) / ARCMIN,
        "scores": [_score(score) for score in result.scores],
        "used": list(deformation.used),
        "notes": [*deformation.alignment.notes, *deformation.notes],
        "provenance": dict(result.provenance),
    }


def _score(score: Score) -> dict[str, Any]:
    return {
        "reference": score.reference,
        "rmse_arcmin": score.rmse / ARCMIN,
        "predicted_std_arcmin": score.predicted / ARCMIN,
        "reference_noise_arcmin": score.reference_noise / ARCMIN,
        "coverage_1_2_3_sigma": score.coverage,
        "duration_s": score.duration,
        "samples": score.samples,
    }


def _deck_shape(shape: DeckShape | None) -> dict[str, Any] | None:
    """Largest curvature per axis with its place, deflection of the line, and where a limit is exceeded."""
    if shape is None:
        return None
    peak = np.nanargmax(np.abs(shape.curvature), axis=0) if len(shape.arc_length) else np.zeros(3, int)
    figures = {
        name: {
            "peak_rad_per_m": shape.curvature[peak[i], i],
            "peak_std_rad_per_m": shape.std[peak[i], i],
            "peak_at_m": shape.arc_length[peak[i]],
            "exceeds_limit_at_m": intervals(shape.arc_length, shape.exceeds[:, i]),
        }
        for i, name in enumerate(AXES)
    }
    return {
        "method": shape.method,
        "passes": len(shape.passes),
        "length_m": float(shape.arc_length[-1] - shape.arc_length[0]),
        **figures,
        "exceeds_limit": bool(shape.exceeds.any()),
        "notes": list(shape.notes),
    }


def intervals(position: np.ndarray, flag: np.ndarray) -> list[list[float]]:
    """[[from, to], ...] of the stretches of position where flag is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flag, [False]]).astype(int)))
    return [[float(position[a]), float(position[b - 1])] for a, b in edges.reshape(-1, 2)]
