"""What ``--json`` prints: plain data in the units people see (arcminutes, seconds, 1/s, rad/s, rad/m)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from physics.units import ARCMIN
from pipeline.one_log import LogRun
from schemas.products import DeckPass, DeckShape, FlexureModel, Score

Document = dict[str, Any]


def run_document(run: LogRun, written: Mapping[str, str]) -> Document:
    """One run; written: the files it wrote, by kind."""
    deformation, alignment = run.result.deformation, run.result.deformation.alignment
    return {
        "log": str(run.path),
        "estimator": deformation.estimator,
        "identifier": run.identifier,
        "duration_s": run.decoded.trial.duration,
        "samples": len(deformation.stamp),
        "static_arcmin": arcmin(alignment.static.value),
        "static_std_arcmin": arcmin(alignment.static.std),
        "static_status": str(alignment.static.status),
        "time_delay_s": number(alignment.time_delay.value),
        "time_delay_std_s": number(alignment.time_delay.std),
        "time_delay_status": str(alignment.time_delay.status),
        "flexure": _flexure(deformation.flexure),
        "rmse_arcmin": {score.reference: arcmin(score.rmse) for score in run.result.scores},
        "predicted_arcmin": {score.reference: arcmin(score.predicted) for score in run.result.scores},
        "reference_noise_arcmin": {score.reference: arcmin(score.reference_noise) for score in run.result.scores},
        "deck_shape": None if run.result.deck_shape is None else _deck_shape(run.result.deck_shape),
        "used": list(deformation.used),
        "warnings": list(run.result.warnings),
        "written": dict(written),
        "provenance": dict(run.result.provenance),
        "wall_s": run.wall,
    }


def compare_document(runs: Sequence[LogRun], written: Mapping[str, str]) -> Document:
    """Several estimators on one log."""
    return {
        "log": str(runs[0].path),
        "identifier": runs[0].identifier,
        "duration_s": runs[0].decoded.trial.duration,
        "estimators": [_compared(run) for run in runs],
        "written": dict(written),
        "wall_s": sum(run.seconds["estimate"] for run in runs) + runs[0].wall - runs[0].seconds["estimate"],
    }


def arcmin(angles: object) -> list[float | None]:
    """Angles in rad as arcminutes; None where there is no figure."""
    return [number(angle / ARCMIN) for angle in np.asarray(angles, float)]


def number(value: object) -> float | None:
    """A plain number; JSON knows no NaN and no infinity, so those become null."""
    plain = float(np.asarray(value, float))
    return plain if math.isfinite(plain) else None


def numbers(values: object) -> list[float | None]:
    """:func:`number` of each."""
    return [number(value) for value in np.asarray(values, float).ravel()]


def _compared(run: LogRun) -> Document:
    return {
        "estimator": run.result.deformation.estimator,
        "samples": len(run.result.deformation.stamp),
        "rmse_arcmin": {score.reference: arcmin(score.rmse) for score in run.result.scores},
        "predicted_arcmin": {score.reference: arcmin(score.predicted) for score in run.result.scores},
        "coverage": {score.reference: _coverage(score) for score in run.result.scores},
        "used": list(run.result.deformation.used),
        "warnings": list(run.result.warnings),
        "wall_s": run.seconds["estimate"],
    }


def _coverage(score: Score) -> dict[str, float | None]:
    return dict(zip(("1_sigma", "2_sigma", "3_sigma"), numbers(score.coverage), strict=True))


def _flexure(model: FlexureModel) -> Document:
    return {
        "method": model.method,
        "damping": numbers(model.damping),
        "frequency": numbers(model.frequency),
        "std_arcmin": arcmin(model.std),
        "status": [str(status) for status in model.status],
    }


def _deck_shape(shape: DeckShape) -> Document:
    vertical, torsion, horizontal = range(3)
    curves = {"vertical_curvature": vertical, "torsion": torsion, "horizontal_curvature": horizontal}
    return {
        "method": shape.method,
        "passes": [_deck_pass(run) for run in shape.passes],
        "arc_length_m": numbers(shape.arc_length),
        **{name: numbers(shape.curvature[:, axis]) for name, axis in curves.items()},
        "std": {name: numbers(shape.std[:, axis]) for name, axis in curves.items()},
        "exceeds_limit": np.asarray(shape.exceeds.any(axis=1)).tolist(),
    }


def _deck_pass(run: DeckPass) -> Document:
    return {
        "index": run.index,
        "forward": run.forward,
        "samples": len(run.stamp),
        "length_m": number(np.ptp(run.arc_length)) if len(run.arc_length) else 0.0,
        "exceeds_limit": bool(run.exceeds.any()),
    }
