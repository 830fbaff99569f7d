"""How much of the error against PHINS is PHINS's own.

Model per axis: ``e = w + g + (error of the estimate)``, w white per sample of the reference, g a first-order
Gauss-Markov drift, both of the two units together. The estimate's own error is smooth on the scale of a sample
(gyros carry it), so w shows in the differences of e; on the scale of a minute the drift of g dominates.
"""

from __future__ import annotations

import numpy as np

from physics.units import ARCMIN
from schemas.rig import FloatArray
from schemas.trial import IntArray

DRIFT_TAU = 300.0  # s, correlation time of the attitude drift
DRIFT_LAG = 60.0  # s, at which the drift is looked for
MIN_DRIFT_LAGS = 5  # record length in lags below which the drift cannot be seen
MIN_WHITE_SAMPLES = 100
# Upper bounds, two units together, of what is credited to the reference, from the data sheet of a survey-grade
# PHINS (0.01 deg roll and pitch, 0.01 deg secant latitude heading, taken as 1.5 sigma); more is the estimate's fault.
NOMINAL_WHITE = np.full(3, 0.06 * np.sqrt(2.0)) * ARCMIN
NOMINAL_DRIFT = np.array([0.3, 0.3, 0.6]) * np.sqrt(2.0) * ARCMIN
WHITE_CEILING = 5.0 * NOMINAL_WHITE
DRIFT_CEILING = 2.0 * NOMINAL_DRIFT


def white_noise(stamp: IntArray, error: FloatArray, interval: float) -> FloatArray:
    """White noise (3,) rad per sample of the reference: ``sigma^2 = -cov(e_k+1 - e_k, e_k+2 - e_k+1)``.

    Random walk in the estimate leaves this covariance untouched. error (n, 3) rad at stamp (n,) ns; interval: s
    between samples of the reference. The nominal value where the record is too short, at most the ceiling.
    """
    triples = _regular_triples(stamp, interval)
    if len(triples) < MIN_WHITE_SAMPLES:
        return NOMINAL_WHITE.copy()
    first, second = (error[triples[:, i + 1]] - error[triples[:, i]] for i in (0, 1))
    variance = -np.mean((first - first.mean(0)) * (second - second.mean(0)), axis=0)
    return np.minimum(np.sqrt(np.maximum(variance, 0.0)), WHITE_CEILING)


def drift(stamp: IntArray, error: FloatArray, white: FloatArray) -> FloatArray:
    """Gauss-Markov drift (3,) rad, stationary standard deviation, from the structure function at one lag T.

    ``E[(e(t+T) - e(t))^2] = 2 white^2 + 2 sigma^2 (1 - exp(-T / tau))``. The nominal value where the record is too
    short, at most the ceiling: a wandering estimate is not excused by its reference.
    """
    t = (stamp - stamp[0]) * 1e-9
    if t[-1] < MIN_DRIFT_LAGS * DRIFT_LAG:
        return NOMINAL_DRIFT.copy()
    partner = np.searchsorted(t, t + DRIFT_LAG)
    ok = partner < len(t)
    i, j = np.flatnonzero(ok), partner[ok]
    near = np.abs(t[j] - t[i] - DRIFT_LAG) < 0.05 * DRIFT_LAG
    if near.sum() < MIN_WHITE_SAMPLES:
        return NOMINAL_DRIFT.copy()
    structure = np.mean((error[j[near]] - error[i[near]]) ** 2, axis=0) - 2.0 * white**2
    variance = np.maximum(structure, 0.0) / (2.0 * (1.0 - np.exp(-DRIFT_LAG / DRIFT_TAU)))
    return np.minimum(np.sqrt(variance), DRIFT_CEILING)


def reference_noise(stamp: IntArray, error: FloatArray, interval: float, constant_std: FloatArray) -> FloatArray:
    """``sqrt(white^2 + drift^2 + constant^2)`` (3,) rad of a PHINS pair, from the error (n, 3) rad against it."""
    white = white_noise(stamp, error, interval)
    return np.sqrt(white**2 + drift(stamp, error, white) ** 2 + constant_std**2)


def _regular_triples(stamp: IntArray, interval: float) -> IntArray:
    """Indices (k, 3) of samples one reference interval apart (within 20 %), so that interpolation makes no noise."""
    step = float(np.median(np.diff(stamp))) * 1e-9 if len(stamp) > 2 else np.inf
    stride = max(1, round(interval / step)) if np.isfinite(step) else 1
    starts = np.arange(0, max(len(stamp) - 2 * stride, 0), stride)
    triples = starts[:, None] + stride * np.arange(3)
    spacing = np.diff(stamp[triples], axis=1) * 1e-9 if len(triples) else np.zeros((0, 2))
    good: IntArray = triples[(np.abs(spacing - stride * step) < 0.2 * stride * step).all(axis=1)]
    return good
