"""The answer in a few sentences: what the deformation was, how sure that is, whether to rely on it and why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from physics.interpolation import gap_starts, usual_interval
from physics.units import ARCMIN, DEG
from schemas.products import Innovations, Result, Score, Status
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.publish.best import static_angle, time_delay
from stages.publish.rows import known_rows

AXES = ("x (pitch)", "y (roll)", "z (heading)")
REFERENCE_NAMES = {"truth": "truth", "phins": "PHINS"}

CONTRADICTED = 3.0  # RMSE over what covariance and reference allow: the error is nearly constant, 2 happens by chance
CONFIRMED = 2.0
MISSED = 0.02  # share of the trial without an estimate from which on the reader is told
COARSE = 1.0  # predicted sigma over the flexure's own: above it, the flexure of that axis is not seen
SURPRISE = 8.0  # sigma of a single innovation that no noise explains
DISAGREED = "disagreed"  # the word by which estimators say that two of their own sensors contradict each other
TURNED = 15.0 * DEG  # static angle from which on it is no error of mounting
SOON = 10.0  # s after a gap, in which a surprise may come of what happened there
PARTLY = 0.9  # share of the estimate below which a reference did not see all of it
EARLY = 10.0  # s, in which a filter may still be surprised by its start


class Grade(StrEnum):
    """Whether to rely on the answer."""

    GOOD = "good"
    CARE = "care"
    BAD = "bad"


WORDS = {
    Grade.GOOD: "The result can be relied on.",
    Grade.CARE: "The result can be used with care.",
    Grade.BAD: "Do not rely on this result.",
}


@dataclass(frozen=True)
class Verdict:
    """found: what the deformation was. sure: how well it is known, and what other sources say. reasons: what speaks
    against relying on it, the worst first; what else was odd stands in the result's warnings."""

    grade: Grade
    found: str
    sure: str
    reasons: tuple[str, ...]

    @property
    def headline(self) -> str:
        """The grade as a sentence."""
        return WORDS[self.grade]


def verdict(result: Result, trial: Trial) -> Verdict:
    """Judge a result by its covariance, references, innovations, coverage and status."""
    unused = _unused(result)
    torn = [] if result.scores else [line for line in unused if DISAGREED in line]
    bad = [*_contradictions(result), *_unknown(result), *_surprises(result, trial), *torn]
    care = [
        *_coverage(result, trial),
        *(line for line in unused if line not in torn),
        *_turned(result),
        *_coarse(result),
        *_weak(result),
        *_repaired(trial),
    ]
    grade = Grade.BAD if bad else Grade.CARE if care else Grade.GOOD
    return Verdict(grade, _found(result), _sure(result), (*bad, *care))


def closest(results: Sequence[Result]) -> tuple[Result, str] | None:
    """Of several estimators' results the one with the least RMSE against the best reference, and that as a sentence."""
    scored = [(r, min(r.scores, key=lambda score: score.reference != "truth")) for r in results if r.scores]
    if not scored:
        return None
    best, score = min(scored, key=lambda pair: float(np.linalg.norm(pair[1].rmse)))
    name = REFERENCE_NAMES[score.reference]
    return best, f"{best.deformation.estimator} comes closest to {name}: RMSE {minutes(score.rmse)} (x, y, z)."


def sigma_of(result: Result) -> FloatArray:
    """(3,) rad, RMS over time of the estimate's own standard deviation; NaN where it has none."""
    variance = known_rows(np.diagonal(result.deformation.covariance, axis1=1, axis2=2))
    if len(variance) and variance.min() < 0:
        variance = variance[(variance >= 0).all(axis=1)]
    return np.sqrt(variance.mean(axis=0)) if len(variance) else np.full(3, np.nan)


def minutes(values: FloatArray, signed: bool = False) -> str:
    """``−22.6′, 3.0′, 0.12′`` of angles in rad."""
    return ", ".join(angle(value, signed) for value in values)


def angle(radians: float, signed: bool = False) -> str:
    """An angle in arcminutes with as many digits as a person reads."""
    value = radians / ARCMIN
    if not np.isfinite(value):
        return "unknown"
    digits = 2 if abs(value) < 1 else 1 if abs(value) < 100 else 0
    return f"{value:{'+' if signed else ''}.{digits}f}′".replace("-", "−")


def flexure_std(result: Result) -> FloatArray:
    """(3,) rad, standard deviation over time of the dynamic part as it was estimated."""
    dynamic = known_rows(result.deformation.dynamic_part)
    return dynamic.std(axis=0) if len(dynamic) else np.full(3, np.nan)


def ratio(score: Score) -> FloatArray:
    """(3,) RMSE over what covariance and the reference's own noise allow; 0 where nothing is known."""
    expected = np.hypot(score.predicted, score.reference_noise)
    return np.divide(score.rmse, expected, out=np.zeros(3), where=np.isfinite(expected) & (expected > 0))


def _found(result: Result) -> str:
    static, delay = static_angle(result.deformation), time_delay(result.deformation)
    clock = "" if delay.status is Status.NOT_OBSERVABLE else f" The sub-IMU's clock is off by {_delay(delay)}."
    return (
        f"The sub-IMU stands turned against the main IMU by {minutes(static.value, True)} (x pitch, y roll, z heading)"
        f", known to {minutes(static.std)}. About that the deck bends by {minutes(flexure_std(result))} (standard "
        f"deviation), at most {minutes(_largest(result))}.{clock}"
    )


def _delay(delay: object) -> str:
    value, std = 1e3 * float(delay.value), 1e3 * float(delay.std)  # type: ignore[attr-defined]
    return f"{value:+.2f} ± {std:.2f} ms".replace("-", "−")


def _largest(result: Result) -> FloatArray:
    dynamic = known_rows(result.deformation.dynamic_part)
    return np.maximum(dynamic.max(axis=0), -dynamic.min(axis=0)) if len(dynamic) else np.full(3, np.nan)


def _sure(result: Result) -> str:
    own = f"At any moment the whole angle is known to {minutes(sigma_of(result))} (one sigma, by its own covariance)"
    length = float(np.ptp(result.deformation.stamp)) * 1e-9 if len(result.deformation.stamp) else 0.0
    told = [_comparison(score, length, flexure_std(result)) for score in result.scores]
    return f"{own}; " + ("; ".join(told) if told else "nothing in the log can confirm it") + "."


def _comparison(score: Score, length: float, bends: FloatArray) -> str:
    """What a reference says. length: of the estimate, s. bends: (3,) rad, what it should be able to see."""
    name, worst = REFERENCE_NAMES[score.reference], float(ratio(score).max())
    word = "contradicts it" if worst > CONTRADICTED else "bears it out" if worst <= CONFIRMED else "agrees roughly"
    noise = score.reference_noise
    if word != "contradicts it" and (noise > bends).any():
        word = "is too uncertain itself to bear it out"
    of_it = f", of which {minutes(noise)} {name}'s own" if (noise > 0).any() else ""
    seen = f" over {score.duration:.0f} s of {length:.0f} s" if score.duration < PARTLY * length else ""
    return f"{name} {word}{seen} (RMSE {minutes(score.rmse)}{of_it})"


def _contradictions(result: Result) -> list[str]:
    return [
        f"{REFERENCE_NAMES[score.reference]} contradicts it about {AXES[i]}: "
        f"the error is {value:.1f} times what both allow"
        for score in result.scores
        for i, value in enumerate(ratio(score))
        if value > CONTRADICTED
    ]


def _unknown(result: Result) -> list[str]:
    unknown = [name for name, value in zip(AXES, sigma_of(result)) if not np.isfinite(value)]
    return [f"how well {', '.join(unknown)} is known could not be found"] if unknown else []


def _surprises(result: Result, trial: Trial) -> list[str]:
    innovations = result.deformation.innovations
    found = surprise(innovations) if innovations is not None else None
    if found is None:
        return []
    when, size, name = found
    told = f"something happened at t = {when:.0f} s that the model does not know: {name} off by {size:.0f} sigma"
    return [told + _after_gap(trial, when)]


def _after_gap(trial: Trial, when: float) -> str:
    """The gap of an IMU shortly before a surprise, if there is one: where samples are lost, clocks are set."""
    for name, stamp in (("main IMU", trial.main.stamp), ("sub-IMU", trial.sub.stamp)):
        ends = trial.seconds(stamp[gap_starts(stamp) + 1])
        near = ends[(ends > when - SOON) & (ends < when + 1.0)]
        if len(near):
            return f", soon after the {name} fell silent until t = {near[-1]:.0f} s: its clock may have jumped there"
    return ""


def surprise(innovations: Innovations) -> tuple[float, float, str] | None:
    """Time (s), size (sigma) and channel of the largest innovation after the start; None if noise can explain it."""
    values = _surprising(innovations)
    if not values.size:
        return None
    row, column = np.unravel_index(int(values.argmax()), values.shape)
    size = float(values[row, column])
    return (float(innovations.t[row]), size, innovations.names[column]) if size > SURPRISE else None


def surprise_times(innovations: Innovations) -> FloatArray:
    """Times (k,) s of all innovations that no noise explains."""
    values = _surprising(innovations)
    return innovations.t[(values > SURPRISE).any(axis=1)] if values.size else np.zeros(0)


def _surprising(innovations: Innovations) -> FloatArray:
    """Sizes (n, m) sigma, zero where unknown and while a filter finds its start."""
    values = np.where(np.isfinite(innovations.values), np.abs(innovations.values), 0.0)
    return np.where((innovations.t < innovations.t[:1] + EARLY)[:, None], 0.0, values)


def _coverage(result: Result, trial: Trial) -> list[str]:
    covered = len(result.deformation.stamp) * usual_interval(result.deformation.stamp) * 1e-9
    seconds = trial.duration - covered
    share = seconds / max(trial.duration, 1e-9)
    return [f"{seconds:.0f} s of the trial ({share:.0%}) have no estimate: data are missing"] if share > MISSED else []


def _unused(result: Result) -> list[str]:
    """Measurements the estimator had but did not trust."""
    return [line for line in result.deformation.used if "not used" in line]


def _turned(result: Result) -> list[str]:
    size = float(np.linalg.norm(static_angle(result.deformation).value))
    if not size > TURNED:
        return []
    return [f"the sub-IMU stands turned by {size / DEG:.1f}° in all: are its axes declared as they are mounted?"]


def _coarse(result: Result) -> list[str]:
    coarse = sigma_of(result) > COARSE * flexure_std(result)
    names = [name for name, flag in zip(AXES, coarse) if flag]
    return [f"{', '.join(names)} is known no better than it bends"] if names else []


def _weak(result: Result) -> list[str]:
    d = result.deformation
    static, delay = static_angle(d), time_delay(d)
    found = [f"the {what} is {e.status}" for what, e in (("static angle", static), ("time delay", delay))
             if e.status is not Status.ESTIMATED]  # fmt: skip
    axes = [name for name, status in zip(AXES, d.flexure.status) if status is not Status.ESTIMATED]
    return [*found, *([f"the flexure model is weakly determined about {', '.join(axes)}"] if axes else [])]


def _repaired(trial: Trial) -> list[str]:
    """The first few things decoding found, but not the sled's: it rightly rests between its runs."""
    return [note for note in trial.notes if not note.startswith(("/sliding", "sliding"))][:3]
