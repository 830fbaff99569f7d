"""A simulated trial on which methods are run by name and scored, as every experiment needs it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from physics.units import ARCMIN
from schemas.errors import DataError
from schemas.experiment import Curve, Panel, Row, Values
from schemas.products import Alignment, Deformation, FlexureModel, Score
from schemas.rig import FloatArray
from schemas.trial import Trial, Truth
from stages import estimate, identify
from stages.align import align
from stages.score import score_all
from twin import Twin, load_twin, make_twin, simulate

DEFAULT_IDENTIFIER = "whittle"  # of methods that name none of their own
AXES = ("x (pitch)", "y (roll)", "z (heading)")
DRAWN = 3000  # points of a curve, at most
RMSE = "RMSE of the total"
RMSE_SETTLED = "RMSE, last two thirds"


def changed(name: str, **sections: Mapping[str, Any]) -> Twin:
    """The built-in twin with other values in its tables: ``changed("idam", run={"duration": 60.0})``."""
    table = load_twin(name).model_dump(exclude_none=True)
    return make_twin({**table, **{key: _merged(table[key], values) for key, values in sections.items()}})


def _merged(table: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables keep what is not named."""
    return {
        **table,
        **{k: _merged(table[k], v) if isinstance(v, Mapping) and isinstance(table.get(k), Mapping) else v
           for k, v in values.items()},
    }  # fmt: skip


@dataclass(frozen=True)
class Bench:
    """A trial with its truth and alignment; flexure models are found once per identifier."""

    trial: Trial
    truth: Truth | None
    alignment: Alignment
    found: dict[str, FlexureModel] = field(default_factory=dict)

    @classmethod
    def simulated(cls, twin: Twin, seed: int) -> Bench:
        """The trial that a twin makes of a seed."""
        simulation = simulate(twin, np.random.default_rng(seed))
        return cls(simulation.trial, simulation.truth, align(simulation.trial))

    def realigned(self, trial: Trial, truth: Truth | None) -> Bench:
        """Another trial of the same flexure, whose models are kept."""
        return Bench(trial, truth, align(trial), self.found)

    def flexure(self, identifier: str) -> FlexureModel:
        """What an identifier finds."""
        if identifier not in self.found:
            self.found[identifier] = identify.get(identifier)().identify(self.trial, self.alignment)
        return self.found[identifier]

    def answer(self, name: str, **options: Any) -> Deformation:
        """A method's deformation, the flexure found by the method's own identifier."""
        method = estimate.get(name)
        flexure = self.flexure(identifier_of(name))
        return replace(method(**options).estimate(self.trial, self.alignment, flexure), estimator=name)

    def scores(self, deformation: Deformation) -> tuple[Score, ...]:
        """Against every reference there is."""
        return score_all(deformation, self.trial, self.truth).scores


def identifier_of(estimator: str) -> str:
    """The identifier that goes with an estimator."""
    return str(getattr(estimate.get(estimator), "identifier", DEFAULT_IDENTIFIER))


def rms(error: FloatArray, unit: float = ARCMIN) -> Values:
    """Root mean square (k,) over the rows of (n, k), in a unit."""
    return tuple(float(v) for v in np.sqrt(np.mean(np.asarray(error) ** 2, axis=0)) / unit)


def late(score: Score, seconds: float) -> FloatArray:
    """The errors (k, 3) from ``seconds`` after the first one on."""
    return np.asarray(score.error[score.stamp >= score.stamp[0] + round(seconds * 1e9)])


def flexure_error(deformation: Deformation, truth: Truth) -> Values:
    """RMS (3,) arcmin of the dynamic part about the truth, the mean taken out: it is the static part's."""
    t = (truth.stamp - truth.stamp[0]) * 1e-9
    at = (deformation.stamp - truth.stamp[0]) * 1e-9
    true = np.stack([np.interp(at, t, column) for column in truth.dynamic_part.T], axis=1)
    error = deformation.dynamic_part - true
    return rms(error - error.mean(axis=0))


@dataclass(frozen=True)
class Run:
    """A method's answer on a bench and its scores, by reference."""

    label: str
    deformation: Deformation
    scores: Mapping[str, Score]


def runs(bench: Bench, methods: Iterable[str]) -> list[Run]:
    """Several methods by name."""
    return [run(bench, name) for name in methods]


def run(bench: Bench, name: str, label: str | None = None, **options: Any) -> Run:
    """One method; label: what it is called in the table."""
    found = bench.answer(name, **options)
    return Run(label or name, found, {score.reference: score for score in bench.scores(found)})


def rmse_row(
    done: Run,
    case: str = "",
    start: float = 0.0,
    reference: str = "truth",
    unit: float = ARCMIN,
    quantity: str = RMSE,
) -> Row:
    """RMSE of the total from ``start`` s on."""
    said = "arcmin" if unit == ARCMIN else "arcsec"
    return Row(case, done.label, quantity, said, rms(late(done.scores[reference], start), unit))


def tried(
    bench: Bench,
    name: str,
    label: str,
    case: str,
    start: float = 0.0,
    unit: float = ARCMIN,
    quantity: str = RMSE,
    **options: Any,
) -> Row:
    """The RMSE, or when and how the method broke down."""
    try:
        return rmse_row(run(bench, name, label, **options), case, start, unit=unit, quantity=quantity)
    except DataError as error:
        lasted = float("nan") if error.time_s is None else error.time_s
        return Row(case, label, "breaks down after", "s", (lasted,), error.problem)


def time_panels(bench: Bench, done: Sequence[Run], unit: float = ARCMIN, reference: str = "truth") -> tuple[Panel, ...]:
    """Per axis: total of every method with the truth, and errors."""
    said = "arcmin" if unit == ARCMIN else "arcsec"
    panels = []
    for axis, name in enumerate(AXES):
        totals = [_curve(r.label, r.deformation.stamp, r.deformation.total[:, axis] / unit, bench) for r in done]
        if bench.truth is not None:
            totals.append(_curve("truth", bench.truth.stamp, bench.truth.total[:, axis] / unit, bench))
        against = [(r.label, r.scores[reference]) for r in done]
        errors = [_curve(label, score.stamp, score.error[:, axis] / unit, bench) for label, score in against]
        panels.append(Panel(f"Deformation {name} [{said}]", "time [s]", f"total [{said}]", tuple(totals)))
        panels.append(Panel(f"Error {name} [{said}]", "time [s]", f"error [{said}]", tuple(errors)))
    return tuple(panels)


def _curve(name: str, stamp: Any, values: FloatArray, bench: Bench) -> Curve:
    every = max(1, len(values) // DRAWN)
    return Curve(name, bench.trial.seconds(stamp)[::every], values[::every])
