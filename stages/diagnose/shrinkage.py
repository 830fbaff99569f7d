"""How far the gap shrinks once effects are added: four errors of the estimator, and the twin with the effects in it.

On the log, on the twin replayed on the log's motion, on the twin with the effects, and on the log after compensating
them. An effect that is the cause brings the third to the first and the fourth to the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from physics import quaternions
from physics.units import ARCMIN
from schemas.diagnosis import Errors
from schemas.products import Alignment, Deformation, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial, Truth
from stages import identify
from stages.align import align
from stages.estimate.smoother import Smoother
from stages.estimate.solve import Job, Solution, solve
from stages.paired import Linearisation, observe, pair
from stages.score.reference import Reference, phins_reference, truth_reference
from stages.score.rmse import angular_error
from twin.compensation import compensate
from twin.config import EffectSpec, Twin
from twin.effects import Effect
from twin.loading import dump_twin
from twin.replay import remembered, replay

WINDOW_S = 300.0
LEAST_S = 60.0  # the shortest piece worth an estimate
IDENTIFIER = "whittle"
AGAINST_PHINS = "PHINS, for log and twin alike"
AGAINST_TRUTH = "truth, for the twin alone: the log has no reference"
NOTHING = np.full(3, np.nan)


def errors(
    trial: Trial,
    twin: Twin,
    effects: Sequence[Effect],
    *,
    rng: np.random.Generator,
    realisations: int = 10,
    window_s: float = WINDOW_S,
) -> Errors:
    """RMSE of the smoother on log, twin, twin with effects and compensated log; the log's truth is never looked at.

    All on one piece of the log, at most window_s long: its middle, or about the moment of an effect that has one. The
    twin's are root mean squares over realisations of flexure, noise and PHINS errors, the main IMU being as measured;
    the noise levels of the estimator are tuned on the first one. Costs about 1.2 CPU s per realisation and twin and 3.5
    per estimate on the log, for a piece of 300 s at 100 Hz; what slower errors do in a longer log is not seen.
    """
    piece, duration = _piece(trial, effects, window_s), _end(trial)
    augmented = with_effects(twin, effects)
    streams = rng.spawn(2)
    on_twin = _twin_errors(piece, twin, streams[0], realisations, duration)
    on_augmented = _twin_errors(piece, augmented, streams[1], realisations, duration)
    before = _estimated(piece)
    freed = compensate(piece, effects, twin)
    after = freed.restore(_estimated(freed.trial))
    log, compensated = _against_phins(before, piece), _against_phins(after, freed.reference)
    known = np.isfinite(log).all()
    return Errors(
        log=log,
        twin=on_twin.phins if known else on_twin.truth,
        twin_with_effects=on_augmented.phins if known else on_augmented.truth,
        log_compensated=compensated,
        reference=AGAINST_PHINS if known else AGAINST_TRUTH,
        twin_truth=on_twin.truth,
        twin_with_effects_truth=on_augmented.truth,
        moved=_moved(before, after),
    )


def with_effects(twin: Twin, effects: Sequence[Effect]) -> Twin:
    """The twin with effects after its own."""
    return twin.model_copy(update={"effect": (*twin.effect, *(_spec(effect) for effect in effects))})


def augmented_twin(twin: Twin, effects: Sequence[Effect]) -> str:
    """TOML text of the twin with the effects, as ``load_twin`` reads it and ``simulate`` runs it."""
    return dump_twin(with_effects(twin, effects))


def _spec(effect: Effect) -> EffectSpec:
    """The table of an effect: what was stated, axes that keep the twin's value left out."""
    stated = effect.model_dump(exclude_unset=True)
    return EffectSpec(name=effect.name, **{name: _table_value(value) for name, value in stated.items()})


def _table_value(value: object) -> object:
    if isinstance(value, tuple):
        if None in value:
            return {axis: number for axis, number in zip("xyz", value) if number is not None}
        return list(value)
    return value


@dataclass(frozen=True)
class _Means:
    """RMSE (3,) arcmin over realisations, NaN without reference."""

    truth: FloatArray
    phins: FloatArray


def _twin_errors(piece: Trial, twin: Twin, rng: np.random.Generator, count: int, duration: float) -> _Means:
    tuned: _Tuned | None = None
    squares, ship = [], remembered(twin, piece)
    for stream in rng.spawn(max(count, 1)):
        drawn = replay(twin, piece, stream, duration, ship)
        alignment = align(drawn.trial)
        if tuned is None:
            flexure = identify.get(IDENTIFIER)().identify(drawn.trial, alignment)
            tuned = _Tuned(solve(drawn.trial, alignment, flexure))
        stamp, total = tuned.total(drawn.trial, alignment)
        squares.append(_squares(stamp, total, drawn.trial, drawn.truth, alignment))
    truth, phins = np.sqrt(np.mean(squares, axis=0)) / ARCMIN
    return _Means(truth, phins)


def _squares(
    stamp: IntArray, total: FloatArray, trial: Trial, truth: Truth, alignment: Alignment
) -> tuple[FloatArray, FloatArray]:
    """Mean square error (3,) rad^2 against truth and PHINS."""
    references = truth_reference(truth, stamp), phins_reference(trial, alignment, stamp)[0]
    return _rmse(total, references[0]) ** 2, _rmse(total, references[1]) ** 2


def _rmse(total: FloatArray, reference: Reference | None) -> FloatArray:
    """RMSE (3,) rad of total (n, 4) against a reference at the same times, NaN without one."""
    if reference is None or reference.valid.sum() < 2:
        return NOTHING
    error = angular_error(quaternions.log(total[reference.valid]), reference.rotation)
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)))


@dataclass(frozen=True)
class _Tuned:
    """The estimator with noise levels, flexure and constant sensor errors found once, for more records of one kind."""

    solution: Solution

    def total(self, trial: Trial, alignment: Alignment) -> tuple[IntArray, FloatArray]:
        """Stamps (n,) ns and R_m_s (n, 4): two rounds, linearised anew in between."""
        paired, job, like = pair(trial, alignment), Job(trial, alignment), self.solution
        at = Linearisation.at(alignment, like.at.lever_arm)
        at = replace(at, coupling=like.at.coupling, gyro_bias=like.at.gyro_bias, scale=like.at.scale)
        first = job.round(observe(paired, at), at, like.noise, like.flexure, identify=False)
        at = job.after(first, like.noise)[0]
        found = job.round(observe(paired, at), at, like.noise, like.flexure, identify=False)
        good = found.obs.good
        return trial.epoch + np.rint(found.obs.t[good] * 1e9).astype(np.int64), found.total[good]


def _estimated(trial: Trial) -> Deformation:
    alignment = align(trial)
    flexure: FlexureModel = identify.get(IDENTIFIER)().identify(trial, alignment)
    return Smoother().estimate(trial, alignment, flexure)


def _against_phins(deformation: Deformation, trial: Trial) -> FloatArray:
    reference, _ = phins_reference(trial, deformation.alignment, deformation.stamp)
    return _rmse(quaternions.exp(deformation.total), reference) / ARCMIN


def _moved(before: Deformation, after: Deformation) -> FloatArray:
    """Root mean square (3,) arcmin between two estimates where they have samples in common."""
    _, i, j = np.intersect1d(before.stamp, after.stamp, assume_unique=True, return_indices=True)
    if not len(i):
        return NOTHING
    error = angular_error(after.total[j], quaternions.exp(before.total[i]))
    return np.asarray(np.sqrt(np.mean(error**2, axis=0))) / ARCMIN


def _end(trial: Trial) -> float:
    """s from the epoch to the end of the record."""
    return float(trial.main.stamp[-1] - trial.epoch) * 1e-9 + float(np.median(np.diff(trial.main.stamp))) * 1e-9


def _piece(trial: Trial, effects: Sequence[Effect], length: float) -> Trial:
    """The middle of a record, or what lies about the moment of the first effect that has one; not longer than asked."""
    first, last = (float(stamp - trial.epoch) * 1e-9 for stamp in trial.main.stamp[[0, -1]])
    length = max(length, LEAST_S)
    if last - first <= length:
        return trial
    moments = [float(effect.time) for effect in effects if "time" in type(effect).model_fields]  # type: ignore[attr-defined]
    centre = moments[0] if moments else 0.5 * (first + last)
    begin = float(np.clip(centre - 0.5 * length, first, last - length))
    return between(trial, begin, begin + length)


def between(trial: Trial, begin: float, end: float) -> Trial:
    """The part of a trial from begin to end, s since the epoch, which stays."""
    limits = trial.epoch + np.array([begin, end]) * 1e9
    parts = {}
    for field in fields(trial):
        series = getattr(trial, field.name)
        if hasattr(series, "stamp"):
            inside = slice(*np.searchsorted(series.stamp, limits))
            arrays = {f.name: getattr(series, f.name) for f in fields(series)}
            parts[field.name] = replace(
                series, **{name: x[inside] for name, x in arrays.items() if isinstance(x, np.ndarray)}
            )
    return replace(trial, **parts)
