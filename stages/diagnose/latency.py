"""The main PHINS against the main gyros: what a latency of the PHINS shows, and no other effect.

E(t) = A_m R_n_m^T turns slowly, with the earth and the ship's way; a PHINS that is late by delta turns it by
A_m w delta. Its increments between step means, whitened by an autoregression, are three more channels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from physics import quaternions
from physics.interpolation import slerp_quaternions
from schemas.products import BoolArray
from schemas.rig import FloatArray
from stages.diagnose import whitening
from stages.diagnose.baseline import Baseline
from twin.effects._prediction import Signals

ORDER = 6
SMALLEST_SHARE = 0.5  # of steps that must have an attitude


@dataclass(frozen=True)
class MainMatch:
    """y: (N, 3) whitened increments, NaN where there are none. filters: (3, ORDER + 1). scale: (3,) rad."""

    y: FloatArray
    filters: FloatArray
    scale: FloatArray


def main_match(base: Baseline) -> MainMatch | None:
    """None without a PHINS at the main IMU."""
    series = base.source.trial.phins_main
    if series is None or series.attitude is None:
        return None
    stamp = np.rint(base.obs.t * 1e9).astype(np.int64)
    good = np.isfinite(series.attitude).all(axis=1)
    if good.sum() < 100:
        return None
    own = series.stamp[good] - base.source.trial.epoch
    attitude, ok = slerp_quaternions(own, series.attitude[good], stamp)
    index = base.obs.index
    if ok.mean() < SMALLEST_SHARE or not ok[index].all():
        return None
    E = np.full((len(stamp), 4), np.nan)
    E[ok] = quaternions.multiply(base.obs.main.attitude[ok], quaternions.conjugate(attitude))
    ends = np.concatenate([[0], np.repeat(np.arange(1, len(index)), np.diff(index))])
    within = quaternions.log(quaternions.multiply(E[: len(ends)], quaternions.conjugate(E[index][ends])))
    mean, _ = whitening.step_means(within, index)
    means = quaternions.multiply(quaternions.exp(np.nan_to_num(mean)), E[index])
    turned = np.zeros((len(index), 3))
    turned[1:] = quaternions.log(quaternions.multiply(means[1:], quaternions.conjugate(means[:-1])))
    turned[1:] -= np.median(turned[1:], axis=0)
    return _whitened(turned, whitening.masked(base.obs, 3))


def _whitened(turned: FloatArray, masked: BoolArray) -> MainMatch:
    filters = np.array([_autoregression(column) for column in turned.T])
    y = np.stack([lfilter(a, [1.0], column) for a, column in zip(filters, turned.T)], axis=1)
    y[: ORDER + 2] = np.nan
    y[masked] = np.nan
    scale = np.array([whitening.spread(column) for column in y.T])
    y = y / scale
    y[np.abs(y) > whitening.OUTLIER_SIGMA] = np.nan
    return MainMatch(y, filters, scale)


def _autoregression(x: FloatArray) -> FloatArray:
    """(ORDER + 1,) prediction-error filter, least squares."""
    past = np.stack([x[ORDER - k - 1 : len(x) - k - 1] for k in range(ORDER)], axis=1)
    return np.concatenate([[1.0], -np.linalg.lstsq(past, x[ORDER:], rcond=None)[0]])


def main_column(base: Baseline, match: MainMatch, signals: Signals) -> FloatArray:
    """(N, 3) what signals add to the whitened increments, zero where those are masked."""
    if signals.phins_main is None:
        return np.zeros_like(match.y)
    turned = -quaternions.rotate(base.obs.main.attitude, np.asarray(signals.phins_main))
    mean, _ = whitening.step_means(turned, base.obs.index)
    step = np.diff(mean, axis=0, prepend=mean[:1])
    out = np.stack([lfilter(a, [1.0], column) for a, column in zip(match.filters, step.T)], axis=1) / match.scale
    return np.where(np.isfinite(match.y), out, 0.0)
