"""Whale optimisation of the fit to the autocorrelation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.identify.autocorrelation import AxisCorrelation, identify_axes, increment_autocorrelation

DAMPING_SPAN = (0.005, 2.0)  # 1/s
FREQUENCY_SPAN = (0.0, 3.0)  # rad/s: a damped sinusoid, as published, is never overdamped
LEAST_VARIANCE = 1e-16  # rad^2


@dataclass(frozen=True)
class WhaleOptimisation:
    """Whale optimisation of (mu, b^2, sigma) on the autocorrelation of angle-increment differences.

    mealpy's original algorithm; whales, iterations: its population and length. seed: of its random numbers, so that the
    same log gives the same answer. as_printed: increments as in IDAM 13-16, with omega x theta left in.
    """

    name: ClassVar[str] = "woa"
    source: ClassVar[str] = "IDAM sec. 5 (WOAM); Wang et al., Ocean Eng. 2022; IDAM eqs. 15-24, corrected"
    options: ClassVar[Mapping[str, str]] = {
        "whales": "size of the population",
        "iterations": "of the search",
        "seed": "of the search's random numbers",
        "as_printed": "increments compensated for the static angle alone (13)-(16), which fails",
    }
    whales: int = 30
    iterations: int = 150
    seed: int = 1
    as_printed: bool = False

    def identify(self, trial: Trial, alignment: Alignment) -> FlexureModel:
        """Flexure model of a trial; DataError when the units hardly overlap or the record is too short."""
        return identify_axes(self.name, trial, alignment, self._solve, self.as_printed)

    def _solve(self, correlation: AxisCorrelation) -> FloatArray:
        return search(correlation, self.whales, self.iterations, self.seed)


def search(correlation: AxisCorrelation, whales: int, iterations: int, seed: int) -> FloatArray:
    """(ln mu, ln b^2, ln sigma) with the least squared misfit that the whales find.

    They look for damping and frequency of the damped sinusoid (23); its size is linear and follows from them. Left to
    the whales too, it traps them: mu, lambda and size form one long narrow valley.
    """
    from mealpy import FloatVar
    from mealpy.swarm_based.WOA import OriginalWOA

    values = correlation.value / float(np.max(np.abs(correlation.value)))

    def misfit(whale: FloatArray) -> float:
        shape = _shape(whale, correlation)
        return float(np.mean((_variance(shape, values) * shape - values) ** 2))

    lower, upper = zip(DAMPING_SPAN, FREQUENCY_SPAN)
    problem = {"obj_func": misfit, "bounds": FloatVar(lower, upper), "minmax": "min", "log_to": None}
    best = np.asarray(OriginalWOA(epoch=iterations, pop_size=whales).solve(problem, seed=seed).solution, dtype=float)
    variance = max(_variance(_shape(best, correlation), correlation.value), LEAST_VARIANCE)
    return np.log([best[0], best[0] ** 2 + best[1] ** 2, np.sqrt(variance)])


def _shape(whale: FloatArray, correlation: AxisCorrelation) -> FloatArray:
    """(L,) autocorrelation for unit sigma of a whale (mu, lambda)."""
    mu, stiffness = float(whale[0]), float(whale[0] ** 2 + whale[1] ** 2)
    return increment_autocorrelation(mu, stiffness, 1.0, correlation.T, len(correlation.value))[1:]


def _variance(shape: FloatArray, values: FloatArray) -> float:
    """sigma^2 that suits a shape best, not negative."""
    return max(float(shape @ values / (shape @ shape)), 0.0)
