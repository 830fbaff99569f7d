"""Whittle likelihood of spectra under a model, its maximum by Fisher scoring, and what it is worth on data held out.

L = -sum count SHARE (ln S + I / S)    over bins, axes, halves and places in time
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from schemas.products import BoolArray
from schemas.rig import FloatArray
from stages.diagnose.spectral_data import SHARE, Spectra
from stages.diagnose.spectral_model import Model

STEP = 1e-4  # of a natural log, of the numeric derivative
ITERATIONS = 40
SETTLED = 1e-4  # nats
AT_BOUND = 1e-9


@dataclass(frozen=True)
class Fit:
    """x: (p,) natural logs. covariance: (p, p), zero for what stands at a bound. log_likelihood: nats, in sample."""

    model: Model
    x: FloatArray
    covariance: FloatArray
    log_likelihood: float

    def std(self) -> FloatArray:
        """(p,) of the natural logs."""
        return np.sqrt(np.diag(self.covariance))


def log_likelihood(data: Spectra, model: Model, x: FloatArray, axes: Sequence[int] = (0, 1, 2)) -> float:
    """Nats, up to a constant of the data; of some axes where not all are asked for."""
    data = model.data(data)
    return float(sum(_by_bin(data, model, x, axis).sum() for axis in axes))


def log_likelihood_by_bin(data: Spectra, fitted: Fit, axis: int) -> FloatArray:
    """(k,) nats of each bin about an axis, halves and places in time together."""
    return _by_bin(fitted.model.data(data), fitted.model, fitted.x, axis)


def _by_bin(data: Spectra, model: Model, x: FloatArray, axis: int) -> FloatArray:
    total = np.zeros(len(data.grid.omega))
    for half in range(len(data.count)):
        S = model.spectrum(x, axis, data.share[half])
        weight = SHARE * data.count[half]
        _add_worth(S, data.power[half, ..., axis, axis].real, weight, total)
    return total


@njit(cache=True, nogil=True)
def _add_worth(S, power, weight, total):  # type: ignore[no-untyped-def]
    """total (k,) += -weight (ln S + power / S), each (g, k), summed over g."""
    for g in range(len(S)):
        for k in range(len(total)):
            total[k] -= weight[g, k] * (np.log(S[g, k]) + power[g, k] / S[g, k])


def fit_model(data: Spectra, model: Model, start: FloatArray) -> Fit:
    """The maximum within the model's bounds nearest to a start (p,): damped Fisher scoring."""
    data = model.data(data)
    x = np.clip(start, *model.bounds)
    damping, worth = 1e-3, _worth(data, model, x)
    gradient, information = _scores(data, model, x)
    for _ in range(ITERATIONS):
        trial = _stepped(x, gradient, information, damping, model.bounds)
        if trial is None:
            break
        better = _worth(data, model, trial)
        if better <= worth:
            damping *= 8.0
            if damping > 1e6:
                break
            continue
        done = better - worth < SETTLED
        x, worth, damping = trial, better, max(damping / 6.0, 1e-7)
        gradient, information = _scores(data, model, x)
        if done:
            break
    return Fit(model, x, _covariance(x, gradient, information, model.bounds), log_likelihood(data, model, x))


def held_out(data: Spectra, fits: tuple[Fit, Fit]) -> float:
    """Log-likelihood of each half under the fit to the other one, summed."""
    return sum(log_likelihood(data.half(1 - k), fit.model, fit.x) for k, fit in enumerate(fits))


def _worth(data: Spectra, model: Model, x: FloatArray) -> float:
    centre, spread = model.prior
    return log_likelihood(data, model, x) - 0.5 * float(np.sum(((x - centre) / spread) ** 2))


def _scores(data: Spectra, model: Model, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient (p,) and Fisher information (p, p) of likelihood and prior."""
    p = len(x)
    centre, spread = model.prior
    gradient, information = -(x - centre) / spread**2, np.diag(1.0 / spread**2)
    for half in range(len(data.count)):
        for axis in range(3):
            S = model.spectrum(x, axis, data.share[half])
            weight = SHARE * data.count[half]
            acting = [index for index in range(p) if axis in model.axes_of(index)]
            slopes = np.stack([_slope(model, x, index, axis, data.share[half], S).ravel() for index in acting])
            excess = (weight * (data.power[half, ..., axis, axis].real / S - 1.0)).ravel()
            gradient[acting] += slopes @ excess
            information[np.ix_(acting, acting)] += (slopes * weight.ravel()) @ slopes.T
    return gradient, information


def _slope(model: Model, x: FloatArray, index: int, axis: int, share: FloatArray, S: FloatArray) -> FloatArray:
    """d ln S / d x_index, (g, k)."""
    moved = x.copy()
    moved[index] += STEP
    return np.asarray((model.spectrum(moved, axis, share) / S - 1.0) / STEP)


def _free(x: FloatArray, gradient: FloatArray, bounds: FloatArray) -> BoolArray:
    """Parameters that are not held at a bound."""
    low, high = bounds
    return ~(((x <= low + AT_BOUND) & (gradient < 0.0)) | ((x >= high - AT_BOUND) & (gradient > 0.0)))


def _stepped(
    x: FloatArray, gradient: FloatArray, information: FloatArray, damping: float, bounds: FloatArray
) -> FloatArray | None:
    free = np.flatnonzero(_free(x, gradient, bounds))
    if not len(free):
        return None
    part = information[np.ix_(free, free)]
    step = np.zeros_like(x)
    step[free] = np.linalg.solve(part + damping * np.diag(np.diag(part)), gradient[free])
    trial = np.clip(x + np.clip(step, -1.0, 1.0), *bounds)
    return None if np.array_equal(trial, x) else trial


def _covariance(x: FloatArray, gradient: FloatArray, information: FloatArray, bounds: FloatArray) -> FloatArray:
    free = np.flatnonzero(_free(x, gradient, bounds))
    out = np.zeros_like(information)
    out[np.ix_(free, free)] = np.linalg.pinv(information[np.ix_(free, free)], hermitian=True)
    return out
