"""Dynamic flexure at the fixed sub-IMU, as a curve in time: what the sled feels a share of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from schemas.errors import DataError
from schemas.products import BoolArray, Deformation
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.shape.rates import GAP, Reference, aligned, mended, unit

DRIFT = 600.0  # s between changes of the sub-IMU's bias in the angle integrated from rates alone
PICARD_STEPS = 5
ANGLE_STD, DELAY_STD = 2e-2, 0.05  # rad, s: left after Wahba
FLEXURE_SAMPLES = 100.0  # correlated samples of flexure that count as one, of every tenth
BATCH = 30.0  # s: longer than flexure remembers


@dataclass(frozen=True)
class Flexure:
    """theta(t) of the sub-IMU in m-axes: t (n,) s with a curve through (n, 3) rad; source says where it came from."""

    t: FloatArray
    angle: CubicSpline
    gaps: FloatArray
    source: str
    detrended: bool = False

    @cached_property
    def offset_std(self) -> FloatArray:
        """(3,) rad: how well a constant in theta is told from the static angle, by means over batches of ``BATCH``.

        The mean of a stationary flexure over the record is not zero, and nothing separates it from the static angle.
        """
        theta = self.angle(self.t)
        count = max(2, int((self.t[-1] - self.t[0]) / BATCH))
        means = np.stack([part.mean(axis=0) for part in np.array_split(theta, count)])
        # a fitted trend is twice as uncertain at its ends as the mean is
        widened = 2.0 if self.detrended else 1.0
        return np.asarray(np.maximum(widened * means.std(axis=0, ddof=1) / np.sqrt(count), 1e-9))

    def covered(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """Whether theta is known throughout [begin, end]."""
        a, b = np.searchsorted(self.t, begin, side="right"), np.searchsorted(self.t, end, side="left")
        inside = (a > 0) & (b < len(self.t))
        return np.asarray(inside & (self.gaps[np.clip(a - 1, 0, None)] == self.gaps[np.clip(b, 0, len(self.t) - 1)]))


def flexure(trial: Trial, main: Reference, deformation: Deformation | None) -> Flexure | None:
    """theta from the estimated deformation where there is one, else from the sub-IMU's rates, else None."""
    if deformation is not None and len(deformation.stamp) > 20:
        return _curve(trial.seconds(deformation.stamp), deformation.dynamic_part, "the estimated deformation")
    try:
        t, theta = from_rates(trial, main)
    except DataError:
        return None
    curve = _curve(t, theta, "the sub-IMU's rates")
    return curve and replace(curve, detrended=True)


def from_rates(trial: Trial, main: Reference) -> tuple[FloatArray, FloatArray]:
    """theta (n, 3) rad at t (n,) s from theta' + w_m x theta = R_m_s w_s - w_m - bias, by Picard iteration.

    R_m_s is constant (Wahba on rates). The product w_m x theta is as large as theta' in a seaway. What a remaining
    rotation, delay and drifting bias put into the integral is fitted to it, not to the rates: theta is stationary,
    so a fit to the integral takes least of it away.
    """
    sub = unit(trial.sub, trial.seconds(trial.sub.stamp))
    R_m_s, delay, _ = aligned(main, sub)
    begin, end = sub.begin - delay, sub.end - delay
    inside = main.covered(begin, end)
    begin, end = begin[inside], end[inside]
    w_m = main.mean(begin, end)
    apart = mended(sub.rate)[inside] @ R_m_s.T - w_m
    step = np.diff(end, prepend=begin[0])[:, None]
    drift = _hats(end)
    turned = np.cumsum(w_m * step, axis=0)
    theta = np.zeros_like(apart)
    for _ in range(PICARD_STEPS):
        middle = 0.5 * (theta + np.vstack([theta[:1], theta[:-1]]))
        theta = np.cumsum((apart - np.cross(w_m, middle)) * step, axis=0)
        theta = np.stack(
            [_detrended(theta[:, i], drift, np.column_stack([turned, w_m[:, i]])) for i in range(3)], axis=-1
        )
    return end, theta


def _hats(t: FloatArray) -> FloatArray:
    """Piecewise linear functions (n, k) of time, ``DRIFT`` or more apart: a slowly changing bias, integrated."""
    count = max(2, int((t[-1] - t[0]) / DRIFT) + 1)
    place = (t - t[0]) / (t[-1] - t[0]) * (count - 1)
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(count))))


def _detrended(x: FloatArray, drift: FloatArray, small: FloatArray) -> FloatArray:
    """x (n,) without its least-squares fit by drift (n, k) and small (n, 4), the latter's coefficients being small.

    The prior on the three angles and the delay keeps a calm ship from lending its motion to the flexure.
    """
    X, some = np.column_stack([drift, small]), slice(None, None, 10)
    free = x[some] - drift[some] @ np.linalg.lstsq(drift[some], x[some], rcond=None)[0]
    weight = 1.0 / (np.var(free) * FLEXURE_SAMPLES + 1e-18)
    prior = np.concatenate([np.full(drift.shape[1], 1e-9), [ANGLE_STD**-2] * 3, [DELAY_STD**-2]])
    normal = weight * X[some].T @ X[some] + np.diag(prior)
    return np.asarray(x - X @ np.linalg.solve(normal, weight * X[some].T @ x[some]))


def _curve(t: FloatArray, theta: FloatArray, source: str) -> Flexure | None:
    finite = np.isfinite(theta).all(axis=1)
    t, theta = t[finite], theta[finite]
    if len(t) < 20:
        return None
    gaps = np.concatenate([[0], np.cumsum(np.diff(t) > GAP * float(np.median(np.diff(t))))]).astype(float)
    return Flexure(t, CubicSpline(t, theta), gaps, source)
