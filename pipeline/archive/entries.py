"""What is kept in figures of one log: the entry of the manifest that the catalogue is made from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.archive.config import Config
from pipeline.archive.source import Source
from pipeline.documents import run_document
from pipeline.one_log import LogRun
from schemas.products import FlexureModel, Result
from schemas.trial import Trial
from stages.archive.sea import motion_of
from stages.publish.summary import plain
from stages.publish.verdict import Grade, verdict


def heading(source: Source, sha256: str, config: Config) -> dict[str, Any]:
    """Which log, under which options; the same for results and for logs set aside."""
    return {
        "log": source.address,
        "name": source.name,
        "sha256": sha256,
        "bytes": source.size,
        "config": config.digest,
        "options": config.about(),
        "version": config.version,
    }


def facts(run: LogRun) -> dict[str, Any]:
    """Everything that a run found, in figures; arcminutes, degrees per second, UTC."""
    trial, deformation = run.decoded.trial, run.result.deformation
    judged, motion = verdict(run.result, trial), motion_of(trial)
    document: dict[str, Any] = {
        "start_utc": _utc(int(trial.main.stamp[0])),
        "end_utc": _utc(int(trial.main.stamp[-1])),
        "rig": trial.rig.name,
        "summary": run_document(run, {}),
        "verdict": {
            "grade": str(judged.grade),
            "found": judged.found,
            "reasons": list(judged.reasons),
            "usable": usable(run.result, trial),
        },
        "flexure": _flexure(deformation.flexure),
        "motion": {
            "rate_dps": np.rad2deg(motion.rate_std),
            "roughness_dps": float(np.rad2deg(motion.roughness)),
            "vertical_ms2": motion.vertical_std,
        },
    }
    return dict(plain(document))


def usable(result: Result, trial: Trial) -> bool:
    """Whether trends over voyages may use it: the truth of a simulated log, which no real one has, is not asked."""
    unaided = replace(result, scores=tuple(score for score in result.scores if score.reference != "truth"))
    return verdict(unaided, trial).grade is not Grade.BAD


def _flexure(model: FlexureModel) -> dict[str, Any]:
    """Status and standard deviations of ln mu, ln b^2, ln sigma per axis."""
    variance = np.diagonal(model.log_covariance, axis1=1, axis2=2)
    return {
        "status": [str(status) for status in model.status],
        "log_std": np.sqrt(np.maximum(variance, 0.0)),
    }


def _utc(stamp: int) -> str:
    return str(np.datetime64(stamp, "ns").astype("datetime64[us]"))
