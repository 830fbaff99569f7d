"""Support vector regression of the autocorrelation, then least squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.identify.autocorrelation import AxisCorrelation, fit, identify_axes

WIDTHS_IN_RANGE = 12.0  # kernel widths in the range of lags: 2 s in 25 s


@dataclass(frozen=True)
class SupportVectorRegression:
    """Support vector regression (RBF kernel) of the autocorrelation, then least squares on the smooth curve.

    epsilon: half-width of the insensitive tube and penalty: C, both for the autocorrelation over its largest value.
    as_printed: increments as in IDAM 13-16, with omega x theta left in.
    """

    name: ClassVar[str] = "svr"
    source: ClassVar[str] = "IDAM sec. 5 (SVRAM); Zhu et al., Appl. Ocean Res. 2019; IDAM eqs. 15-24, corrected"
    options: ClassVar[Mapping[str, str]] = {
        "epsilon": "half-width of the tube, of the largest autocorrelation",
        "penalty": "C of the regression",
        "as_printed": "increments compensated for the static angle alone (13)-(16), which fails",
    }
    epsilon: float = 0.01
    penalty: float = 10.0
    as_printed: bool = False

    def identify(self, trial: Trial, alignment: Alignment) -> FlexureModel:
        """Flexure model of a trial; DataError when the units hardly overlap or the record is too short."""
        return identify_axes(self.name, trial, alignment, self._solve, self.as_printed)

    def _solve(self, correlation: AxisCorrelation) -> FloatArray:
        return fit(replace(correlation, value=smooth(correlation, self.epsilon, self.penalty)))


def smooth(correlation: AxisCorrelation, epsilon: float, penalty: float) -> FloatArray:
    """(L,) rad^2: the autocorrelation as the regression sees it."""
    from sklearn.svm import SVR

    scale = float(np.max(np.abs(correlation.value)))
    x = correlation.lag[:, None] / correlation.lag[-1]
    machine = SVR(kernel="rbf", gamma=0.5 * WIDTHS_IN_RANGE**2, C=penalty, epsilon=epsilon)
    return np.asarray(scale * machine.fit(x, correlation.value / scale).predict(x))
