"""Error of the total angle against each reference: ``e = Log(R_est R_ref^T)``, m-axes, RMSE per axis."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from physics import quaternions
from physics.units import ARCMIN
from schemas import scratch
from schemas.products import BoolArray, Deformation, Score
from schemas.rig import FloatArray
from schemas.trial import Trial, Truth
from stages.score.noise import reference_noise
from stages.score.reference import Reference, phins_reference, truth_reference
from stages.slabs import beside, rows, slabs

NOTED_STD = 0.25 * ARCMIN  # of a PHINS's installation, from which on the reader is told


@dataclass(frozen=True)
class Scoring:
    """Scores against the references present, and a sentence for each that could not be used."""

    scores: tuple[Score, ...]
    notes: tuple[str, ...]


def score(deformation: Deformation, trial: Trial, truth: Truth | None) -> tuple[Score, ...]:
    """RMSE against truth and against the PHINS pair, where present and overlapping; see :func:`score_all`."""
    return score_all(deformation, trial, truth).scores


def score_all(deformation: Deformation, trial: Trial, truth: Truth | None) -> Scoring:
    """Scores of an estimate against "truth" (if given) and "phins" (if both PHINS have attitude), with notes.

    References are interpolated to the estimate's stamps, exactly where stamps agree and never across a gap; a
    reference that does not overlap the estimate gives no score but a note.
    """
    references: list[Reference] = []
    notes: list[str] = []
    if truth is not None and len(truth.stamp):
        found = truth_reference(truth, deformation.stamp)
        references += [found] if found is not None else []
    phins, note = phins_reference(trial, deformation.alignment, deformation.stamp)
    references += [phins] if phins is not None else []
    notes += [note] if note else []
    notes += [_installation_note(phins)] if phins is not None and phins.constant_std.max() > NOTED_STD else []
    with ThreadPoolExecutor(beside(len(deformation.stamp))) as pool:  # one reference beside the other
        scores = list(pool.map(lambda reference: _against(deformation, reference), references))
    for reference, result in zip(references, scores):
        if result is None:
            notes.append(f"not scored against {reference.name}: it does not overlap the estimate in time")
    return Scoring(tuple(s for s in scores if s is not None), tuple(notes))


def _installation_note(phins: Reference) -> str:
    std = " ".join(f"{value / ARCMIN:.2g}" for value in phins.constant_std)
    return f"the error against PHINS holds a constant of its installation, known to {std} arcmin (x y z, 1 sigma) only"


def angular_error(total: FloatArray, reference: FloatArray) -> FloatArray:
    """``Log(Exp(total) R_ref^T)``, (n, 3) rad, of rotation vectors (n, 3) and quaternions (n, 4)."""
    return quaternions.log(quaternions.multiply(quaternions.exp(total), quaternions.conjugate(reference)))


def coverage(error: FloatArray, std: FloatArray) -> FloatArray:
    """Share (3,) of errors (n, 3) within 1, 2 and 3 sigma (n, 3), over all axes; NaN where sigma is unknown."""
    known = np.isfinite(std) & (std > 0)
    if not known.any():
        return np.full(3, np.nan)
    ratio = np.abs(error[known]) / std[known]
    return np.array([np.mean(ratio <= k) for k in (1.0, 2.0, 3.0)])


def _against(deformation: Deformation, reference: Reference) -> Score | None:
    seen, error, variance = _errors(deformation, reference)
    if len(error) < 2:
        return None
    stamp = scratch.shelved(rows(deformation.stamp, seen))
    rmse = np.sqrt(np.mean(error**2, axis=0))
    noise = (
        np.zeros(3)
        if reference.name == "truth"
        else reference_noise(stamp, error, reference.interval, reference.constant_std)
    )
    return Score(
        estimator=deformation.estimator,
        reference=reference.name,
        rmse=rmse,
        duration=_scored_time(stamp),
        samples=len(stamp),
        stamp=stamp,
        error=error,
        predicted=_rms_sigma(variance),
        reference_noise=np.minimum(noise, rmse),
        coverage=coverage(error, np.sqrt(np.where(variance >= 0, variance, np.nan) + noise**2)),
    )


def _errors(deformation: Deformation, reference: Reference) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Which samples (n,) there is a reference for, and their errors, rad, and the estimate's own variances, (k, 3)."""
    n = len(deformation.stamp)
    seen, error, variance = np.zeros(n, dtype=bool), scratch.empty((n, 3)), scratch.empty((n, 3))
    k = first = 0
    for part in slabs(n):
        valid = reference.valid[part]
        rotation = reference.rotation[first : first + np.count_nonzero(valid)]
        first += len(rotation)
        total = rows(deformation.total[part], valid)
        good = np.asarray(np.isfinite(total).all(axis=1))
        seen[part][np.flatnonzero(valid)[good]] = True
        into = slice(k, k := k + int(good.sum()))
        error[into] = angular_error(rows(total, good), rows(rotation, good))
        own = np.diagonal(deformation.covariance[part], axis1=1, axis2=2)
        variance[into] = rows(rows(own, valid), good)
        scratch.release(error, variance, reference.rotation, deformation.total, deformation.covariance)
    return seen, error[:k], variance[:k]


def _rms_sigma(variance: FloatArray) -> FloatArray:
    """RMS (3,) of the estimator's own sigma; NaN where it gives none."""
    known = np.isfinite(variance).all(axis=1) & (variance >= 0).all(axis=1)
    return np.sqrt(variance[known].mean(axis=0)) if known.any() else np.full(3, np.nan)


def _scored_time(stamp: np.ndarray) -> float:
    """Seconds scored: samples times the usual interval, so that gaps do not count."""
    return float(np.median(np.diff(stamp)) * len(stamp)) * 1e-9
