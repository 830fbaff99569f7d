"""One log through all stages: decode, align, identify, estimate, shape, score.

The stages are pure functions that meet in the data classes of ``schemas``; here they are strung together, timed, and
what they found odd is gathered.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.options import DEFAULT_IDENTIFIER, RunOptions
from pipeline.provenance import provenance, sha256_of
from schemas.errors import DataError
from schemas.products import Alignment, DeckShape, Deformation, Estimate, FlexureModel, Result, Score, Status
from schemas.trial import Trial
from stages.publish.best import static_angle, time_delay

if TYPE_CHECKING:
    from pipeline.compensating import Remedy
    from stages.decode import Decoded
    from twin.compensation import Compensated

AXES = ("pitch x", "roll y", "heading z")
SUSPICIOUS_RATIO = 3.0  # RMSE over predicted; the error is one slowly varying constant a run, so 2 happens by chance

Progress = Callable[[str, int, int], None]
"""Called with the step under way, how much of it is done and how much there is (0 of 0: not known)."""


@dataclass(frozen=True)
class LogRun:
    """One estimator's answer on one log; seconds: wall time of each step, in the order they ran.

    compensated: what was taken out of the log before estimating, a sentence for each effect.
    """

    path: Path
    decoded: Decoded
    identifier: str
    result: Result
    seconds: dict[str, float]
    compensated: tuple[str, ...] = ()

    @property
    def wall(self) -> float:
        """Wall time of all steps so far, s."""
        return sum(self.seconds.values())


@dataclass
class Steps:
    """The clock of the pipeline: says what is under way and keeps what each step took."""

    progress: Progress | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str) -> Iterator[Callable[[int, int], None]]:
        """Time a block and tell the progress callback; yields a callback for the step's own progress."""
        report = self._reporter(name)
        report(0, 0)
        start = time.perf_counter()
        yield report
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def _reporter(self, name: str) -> Callable[[int, int], None]:
        def report(done: int, total: int) -> None:
            if self.progress is not None:
                self.progress(name, done, total)

        return report


@dataclass(frozen=True)
class Comparison:
    """Several estimators on one log, in the order asked for. failed: by name, why one has no answer to give."""

    runs: tuple[LogRun, ...]
    failed: Mapping[str, str]


def run_log(path: Path, options: RunOptions | None = None, progress: Progress | None = None) -> LogRun:
    """Everything one log has to say, by one estimator. Raises DataError, which names the file."""
    options, steps = options or RunOptions(), Steps(progress)
    with _locating(path):
        return _finished(_prepared(path, options, steps), options.estimator, path, options, steps, True)


def compare_estimators(
    path: Path, options: RunOptions, estimators: Sequence[str], progress: Progress | None = None
) -> Comparison:
    """Several estimators on one decode and one alignment, each with its own identifier unless one is named for all.

    An identifier that serves several runs once. An estimator that can make nothing of the log leaves the others
    standing. Raises DataError, which names the file, when none has an answer, and ValueError for a name that is not
    registered.
    """
    steps, runs, failed = Steps(progress), [], {}
    with _locating(path):
        ready = _prepared(path, options, steps)
        for name in estimators:
            try:
                with _locating(path):
                    runs.append(_finished(ready, name, path, options, steps, False))
            except DataError as error:
                failed[name] = _reason(error)
        if not runs:
            raise DataError("; ".join(f"{name}: {reason}" for name, reason in failed.items()))
    return Comparison(tuple(runs), failed)


def _reason(error: DataError) -> str:
    """What an error says, without the file."""
    return str(DataError(error.problem, channel=error.channel, time_s=error.time_s))


@contextmanager
def _locating(path: Path) -> Iterator[None]:
    """Errors in the data get the name of the file."""
    try:
        yield
    except DataError as error:
        raise error.located(file=path) from error
    except np.linalg.LinAlgError as error:
        raise DataError(f"the data do not determine a solution ({error})", file=path) from error


@dataclass(frozen=True)
class _Prepared:
    """What all estimators on a log share. flexures: by identifier, with the seconds it took.

    freed: the log without what a diagnosis found in it, None where none is named.
    """

    decoded: Decoded
    alignment: Alignment
    origin: Mapping[str, str]
    freed: Compensated | None = None
    flexures: dict[str, tuple[FlexureModel, float]] = field(default_factory=dict)

    @property
    def trial(self) -> Trial:
        """What an estimator sees."""
        return self.decoded.trial if self.freed is None else self.freed.trial

    def flexure(self, identifier: str, options: RunOptions, steps: Steps) -> FlexureModel:
        """What an identifier finds; its time counts for every estimator that uses it."""
        if identifier not in self.flexures:
            with steps.step("identify"):
                model = options.settings.made("identify", identifier).identify(self.trial, self.alignment)
            self.flexures[identifier] = model, steps.seconds["identify"]
        model, steps.seconds["identify"] = self.flexures[identifier]
        return model


def _prepared(path: Path, options: RunOptions, steps: Steps) -> _Prepared:
    """Decode (hashing the file beside it), take out what a diagnosis found, align."""
    from stages.align import align

    remedy = _remedy(options)
    with ThreadPoolExecutor(max_workers=1) as pool:
        sha256 = pool.submit(sha256_of, path)
        with steps.step("decode") as report:
            decoded = _decode(path, options, report)
        origin = provenance(path, sha256.result(), options, decoded.trial.rig.name)
    freed = None
    if remedy is not None:
        with steps.step("compensate"):
            freed = remedy.applied(decoded.trial)
    with steps.step("align"):
        alignment = align(decoded.trial if freed is None else freed.trial)
    return _Prepared(decoded, alignment, origin, freed)


def _remedy(options: RunOptions) -> Remedy | None:
    """What the diagnosis that the options name says to take out; read before the log is."""
    if options.compensate is None:
        return None
    from pipeline.compensating import load_remedy

    return load_remedy(options.compensate)


def _finished(ready: _Prepared, name: str, path: Path, options: RunOptions, steps: Steps, with_shape: bool) -> LogRun:
    """Estimate, find the shape, score; the time of what was shared counts for every estimator."""
    from stages.score import score_all

    own, freed = Steps(steps.progress, dict(steps.seconds)), ready.freed
    trial = ready.trial if freed is None else freed.reference
    identifier = options.identifier or own_identifier(name)
    flexure = ready.flexure(identifier, options, own)
    with own.step("estimate"):
        deformation = options.settings.made("estimate", name).estimate(ready.trial, ready.alignment, flexure)
        deformation = deformation if freed is None else freed.restore(deformation)
    deck_shape, trouble = _shape(options, trial, deformation, own) if with_shape else (None, ())
    with own.step("score"):
        scoring = score_all(deformation, trial, ready.decoded.truth)
    warnings = dict.fromkeys([*_warnings(trial, deformation, scoring.scores), *trouble, *scoring.notes])
    origin = {**ready.origin, "estimator": name, "identifier": identifier}
    result = Result(deformation, deck_shape, scoring.scores, tuple(warnings), origin)
    return LogRun(path, ready.decoded, identifier, result, own.seconds, freed.notes if freed else ())


def _decode(path: Path, options: RunOptions, report: Callable[[int, int], None]) -> Decoded:
    from stages.decode import decode, load_rig

    profile = load_rig(options.rig) if options.rig else None
    return decode(path, profile, report)


def own_identifier(estimator: str) -> str:
    """The identifier that goes with an estimator; the default one where it names none."""
    from stages import estimate

    return str(getattr(estimate.get(estimator), "identifier", DEFAULT_IDENTIFIER))


def _shape(
    options: RunOptions, trial: Trial, deformation: Deformation, steps: Steps
) -> tuple[DeckShape | None, tuple[str, ...]]:
    """Shape of the deck where a sled was run; a bad sled record leaves the rest of the answer standing."""
    from stages import shape

    if trial.sliding is None or trial.sled is None:
        return None, ()
    try:
        with steps.step("deck shape"):
            method = options.settings.made("shape", options.shape or shape.names()[0])
            return method.shape(trial, deformation), ()
    except DataError as error:
        return None, (f"no deck shape: {error}",)


def _warnings(trial: Trial, deformation: Deformation, scores: Sequence[Score]) -> tuple[str, ...]:
    """What a person must know before trusting the figures, a sentence each."""
    return (
        *trial.notes,
        *deformation.alignment.notes,
        *_doubts("static angle", static_angle(deformation)),
        *_doubts("time delay", time_delay(deformation)),
        *_flexure_doubts(deformation.flexure),
        *deformation.notes,
        *(sentence for score in scores for sentence in _contradictions(score)),
    )


def _doubts(what: str, estimate: Estimate) -> tuple[str, ...]:
    if estimate.status is Status.ESTIMATED:
        return ()
    return (f"{what} {_judged(estimate.status, estimate.reason)}",)


def _flexure_doubts(flexure: FlexureModel) -> tuple[str, ...]:
    """One sentence for all axes that share a status and its reason."""
    judged: dict[str, list[str]] = {}
    for axis, status, why in zip(AXES, flexure.status, flexure.reason, strict=True):
        if status is not Status.ESTIMATED:
            judged.setdefault(_judged(status, why), []).append(axis)
    return tuple(f"flexure, {', '.join(axes)}: {sentence}" for sentence, axes in judged.items())


def _judged(status: Status, why: str) -> str:
    return f"{status}: {why}" if why else f"{status}"


def _contradictions(score: Score) -> list[str]:
    """Axes on which a reference lies much further away than the estimate's own covariance and the reference allow."""
    expected = np.hypot(score.predicted, score.reference_noise)
    ratio = np.divide(score.rmse, expected, out=np.zeros(3), where=expected > 0)
    return [
        f"{axis}: the error against {score.reference} is {r:.1f} times what its covariance predicts"
        for axis, r in zip(AXES, ratio, strict=True)
        if r > SUSPICIOUS_RATIO
    ]
