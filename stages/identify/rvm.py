"""Relevance vector machine on a dictionary of damped sinusoids, then least squares (IDAM 25-33)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.identify.autocorrelation import AxisCorrelation, fit, identify_axes

DAMPING_SPAN = (0.01, 2.0)  # 1/s
FREQUENCY_SPAN = (0.01, 3.0)  # rad/s
ITERATIONS = 100
TOLERANCE = 1e-3


@dataclass(frozen=True)
class RelevanceVectorMachine:
    """Relevance vector machine on damped sinusoids, then least squares on what it rebuilds.

    The sparse Bayesian step (25)-(33) is scikit-learn's ARD regression; it smooths the autocorrelation. Reading the
    parameters off its strongest node, as the paper's text suggests, is useless: neighbouring nodes share the weight.
    nodes: of damping and of frequency each. as_printed: increments as in IDAM 13-16, with omega x theta left in.
    """

    name: ClassVar[str] = "rvm"
    source: ClassVar[str] = "Tipping 2001; IDAM eqs. 15-33, corrected"
    options: ClassVar[Mapping[str, str]] = {
        "nodes": "dampings and frequencies in the dictionary, each",
        "as_printed": "increments compensated for the static angle alone (13)-(16), which fails",
    }
    nodes: int = 16
    as_printed: bool = False

    def identify(self, trial: Trial, alignment: Alignment) -> FlexureModel:
        """Flexure model of a trial; DataError when the units hardly overlap or the record is too short."""
        return identify_axes(self.name, trial, alignment, self._solve, self.as_printed)

    def _solve(self, correlation: AxisCorrelation) -> FloatArray:
        return fit(replace(correlation, value=sparse_bayes(correlation, self.nodes)))


def sparse_bayes(correlation: AxisCorrelation, nodes: int) -> FloatArray:
    """(L,) rad^2: the autocorrelation as the relevance vector machine rebuilds it."""
    from sklearn.linear_model import ARDRegression

    scale = float(np.max(np.abs(correlation.value)))
    columns = dictionary(correlation.lag, nodes)
    machine = ARDRegression(max_iter=ITERATIONS, tol=TOLERANCE, fit_intercept=False)
    machine.fit(columns, correlation.value / scale)
    return np.asarray(scale * machine.predict(columns))


def dictionary(lag: FloatArray, nodes: int) -> FloatArray:
    """(L, 2 nodes^2): exp(-mu t) cos(lambda t) and exp(-mu t) sin(lambda t), columns of unit norm."""
    mu, rate = np.meshgrid(np.geomspace(*DAMPING_SPAN, nodes), np.geomspace(*FREQUENCY_SPAN, nodes))
    decay, phase = np.exp(-lag[:, None] * mu.ravel()), lag[:, None] * rate.ravel()
    columns = np.concatenate([decay * np.cos(phase), decay * np.sin(phase)], axis=1)
    return np.asarray(columns / np.linalg.norm(columns, axis=0))
