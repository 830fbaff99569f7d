"""Rates of two units brought into one frame and one clock, sample by sample.

Model of a unit c (sled or sub-IMU) beside the main IMU m, both in hull axes up to a constant rotation R_m_c::

    R_m_c w_c(t) = w_m(t - delay) + bias + what the structure between them does

The rotation comes from Wahba's problem on rates (Davenport 1968; Markley, J. Astronaut. Sci. 36, 1988), because
integrals gather drift; the delay from its residual against lag. Both are starting values which the regression refines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from schemas.errors import DataError
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries
from stages.shape.robust import hampel, spread

GAP = 1.5  # sample intervals: a longer step is a gap
WAHBA_PRIOR = 0.2  # rad: what the rotation is believed to be when the ship hardly moves
LAG_RANGE, LAG_STEP = 1.0, 0.05  # s: search for the delay
LAG_GAIN = 0.8  # the residual must fall below this share of that at lag 0 before a coarse lag is believed
CORRELATED = 100.0  # samples that count as one in the rotation's prior weight


@dataclass(frozen=True)
class Unit:
    """Samples of one unit: the mean rate (n, 3) rad/s over each interval [begin, end] (n,) s."""

    begin: FloatArray
    end: FloatArray
    rate: FloatArray


def unit(series: ImuSeries, seconds: FloatArray) -> Unit:
    """Samples of a series with their intervals; rows that are not finite are left out."""
    finite = np.isfinite(series.gyro).all(axis=1)
    t = seconds[finite]
    if len(t) < 20:
        raise DataError(f"{len(t)} usable gyro samples, too few")
    step = float(np.median(np.diff(t)))
    end = t + 0.5 * step if series.instantaneous else t
    return Unit(end - step, end, series.gyro[finite])


@dataclass(frozen=True)
class Reference:
    """The main IMU as a curve: integrated rate, to be averaged over any interval and shifted in time."""

    t: FloatArray
    angle: CubicSpline
    gaps: FloatArray

    def mean(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Mean rate (n, 3) rad/s over [begin, end]."""
        return np.asarray((self.angle(end) - self.angle(begin)) / (end - begin)[:, None])

    def slope(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Mean angular acceleration (n, 3) rad/s^2 over [begin, end]."""
        return np.asarray((self.angle(end, 1) - self.angle(begin, 1)) / (end - begin)[:, None])

    def covered(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """Whether the unit was recording throughout [begin, end]."""
        a, b = np.searchsorted(self.t, begin, side="right"), np.searchsorted(self.t, end, side="left")
        return np.asarray(
            (a > 1) & (b < len(self.t) - 1) & (self.gaps[np.clip(b, 0, len(self.t) - 1)] == self.gaps[a - 1])
        )


def reference(series: ImuSeries, seconds: FloatArray) -> Reference:
    """The main IMU's integrated rate; outliers are replaced by the mean of their neighbours."""
    u = unit(series, seconds)
    rate = mended(u.rate)
    step = np.diff(u.end, prepend=u.begin[0])
    angle = np.cumsum(rate * step[:, None], axis=0)
    gap = np.concatenate([[0], np.cumsum(np.diff(u.end) > GAP * (u.end[0] - u.begin[0]))]).astype(float)
    return Reference(u.end, CubicSpline(u.end, angle), gap)


def mended(rate: FloatArray) -> FloatArray:
    """Rates (n, k) with outliers interpolated over, for units whose every sample is needed."""
    bad = hampel(rate, threshold=10.0)
    index, out = np.arange(len(rate)), rate.copy()
    for axis in np.flatnonzero(bad.any(axis=0)):
        good = ~bad[:, axis]
        out[~good, axis] = np.interp(index[~good], index[good], rate[good, axis])
    return out


def wahba(w_m: FloatArray, w_c: FloatArray) -> FloatArray:
    """R_m_c (3, 3) minimising sum |w_m - R_m_c w_c|^2 + prior towards identity, rates (n, 3) without their means.

    The prior (``WAHBA_PRIOR``, weighted by the spread of the residual) decides axes about which the ship did not turn.
    """
    noise = float(np.mean(spread(w_m - w_c) ** 2)) + 1e-18
    profile = w_m.T @ w_c + CORRELATED * noise / WAHBA_PRIOR**2 * np.eye(3)
    left, _, right = np.linalg.svd(profile)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left) * np.linalg.det(right)]) @ right)


def coarse_delay(main: Reference, c: Unit, good: BoolArray) -> float:
    """Delay (s) of unit c against main to about 10 ms: lag of the least Wahba residual, 0 unless clearly better."""
    rows = np.flatnonzero(good)[:: max(1, int(good.sum()) // 20000)]
    lags = np.arange(-LAG_RANGE, LAG_RANGE + LAG_STEP / 2, LAG_STEP)
    rows = rows[main.covered(c.begin[rows] - LAG_RANGE, c.end[rows] + LAG_RANGE)]
    if len(rows) < 100:
        return 0.0
    loss = np.array([_residual(main.mean(c.begin[rows] - lag, c.end[rows] - lag), c.rate[rows]) for lag in lags])
    best = int(np.clip(np.argmin(loss), 1, len(lags) - 2))
    if loss[best] > LAG_GAIN * loss[len(lags) // 2]:
        return 0.0
    bend = loss[best - 1] - 2.0 * loss[best] + loss[best + 1]
    return float(lags[best] + LAG_STEP * 0.5 * (loss[best - 1] - loss[best + 1]) / bend)


def _residual(w_m: FloatArray, w_c: FloatArray) -> float:
    a, b = w_m - w_m.mean(axis=0), w_c - w_c.mean(axis=0)
    return float(np.sum((a - b @ wahba(a, b).T) ** 2))


def aligned(main: Reference, c: Unit) -> tuple[FloatArray, float, BoolArray]:
    """Starting values R_m_c (3, 3) and delay (s) of unit c, and its usable samples (n,): covered and no outliers."""
    good = main.covered(c.begin, c.end) & ~hampel(c.rate).any(axis=1)
    if good.sum() < 100:
        raise DataError("fewer than 100 samples overlap with the main IMU")
    delay = coarse_delay(main, c, good)
    good &= main.covered(c.begin - delay, c.end - delay)
    a, b = main.mean(c.begin[good] - delay, c.end[good] - delay), c.rate[good]
    return wahba(a - a.mean(axis=0), b - b.mean(axis=0)), delay, good
