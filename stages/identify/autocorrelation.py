"""Flexure parameters from the autocorrelation of angle-increment differences (IDAM 15-24, with the errata).

``R_dTheta(n) = 2 R(nT) - R((n-1)T) - R((n+1)T)`` for n >= 1, R the autocorrelation of theta (IDAM 17, its factor put
right). Lag 0 is left out: the white noise of the gyros stands there. The model is fitted in (ln mu, ln b^2, ln sigma),
since the printed way through the complex amplitude C (24) is singular on a critically damped axis. What the methods
differ in is how they get from the sample autocorrelation to the three parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import toeplitz
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from physics import flexure, matching
from schemas.errors import DataError
from schemas.products import Alignment, FlexureModel, Status
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.drift import BREAK_S, SHORTEST_PIECE_S, drift_of_pieces
from stages.flexure_fit import SHORT_RECORD, WEAK_SIGMA
from stages.paired import Linearisation, Observations, observe, pair

FIRST_RANGE_S = 25.0  # s of lag in the first round; afterwards RANGE correlation times
RANGE = 5.0
RANGE_LIMITS_S = (8.0, 120.0)
LARGEST_SHARE = 0.125  # of the record: beyond it a lag has too few pairs
RANGE_ROUNDS = 2
LEAST_LAGS = 20
NOISE_SHOWS = 4.0  # times the flexure alone, whose forcing a short record knows to a factor of two
DAMPING_LIMITS = (1e-3, 10.0)  # 1/s
FREQUENCY_LIMITS = (1e-2, 30.0)  # of b, rad/s; the lower one is raised to one period in the record
STD_LIMITS = (1e-8, 0.1)  # rad
START_DAMPING = np.geomspace(0.02, 1.5, 10)  # 1/s
START_RATIO = (0.5, 1.0, 2.0, 6.0, 20.0)  # b^2 / mu^2


@dataclass(frozen=True)
class AxisCorrelation:
    """Sample autocorrelation of one axis's increments. value: (L,) rad^2 at lags n T, n = 1..L. pairs: (L,) counted.

    zero: rad^2 at lag 0, noise included. T: s. length: s of record.
    """

    value: FloatArray
    pairs: FloatArray
    zero: float
    T: float
    length: float

    @property
    def lag(self) -> FloatArray:
        """(L,) s."""
        return np.asarray(self.T * np.arange(1, len(self.value) + 1))


Solve = Callable[[AxisCorrelation], FloatArray]
"""From an autocorrelation to (ln mu, ln b^2, ln sigma)."""


def increment_autocorrelation(damping: float, stiffness: float, std: float, T: float, lags: int) -> FloatArray:
    """``2 R(nT) - R((n-1)T) - R((n+1)T)`` (lags + 1,), rad^2, n = 0..lags, of increments over T s: IDAM 20."""
    R = flexure.autocorrelation(damping, stiffness, std, T * np.arange(-1.0, lags + 2.0))
    return np.asarray(2.0 * R[1:-1] - R[:-2] - R[2:])


def increments(trial: Trial, alignment: Alignment, as_printed: bool = False) -> tuple[FloatArray, float]:
    """Increments (k, 3) rad in m-axes over T s, NaN across gaps, and T. Raises DataError when the units hardly overlap.

    A sample lost here and there is bridged: what is missed then is white noise, at lag 0.
    They are those of the full attitude difference, its drift taken out, so that nothing of omega x theta is left.
    as_printed: IDAM 13-16, ``dTheta_m - dTheta_s + dTheta_m x Phi``, which leaves omega x theta in.
    """
    return _increments(observe(pair(trial, alignment), Linearisation.at(alignment)), alignment, as_printed)


def _increments(obs: Observations, alignment: Alignment, as_printed: bool) -> tuple[FloatArray, float]:
    values = _printed(obs, alignment) if as_printed else _compensated(obs)
    seen = np.isfinite(obs.z[:, 0])
    values[~(seen[1:] & seen[:-1] & (obs.jump_s[1:] <= BREAK_S))] = np.nan
    return values, float(np.median(np.diff(obs.t[obs.index])))


def _compensated(obs: Observations) -> FloatArray:
    drift = drift_of_pieces(obs)
    if np.isnan(drift).all():
        raise DataError(f"no piece of {SHORTEST_PIECE_S:.0f} s without a gap: no autocorrelation of the flexure")
    turned = Rotation.from_rotvec(-np.nan_to_num(drift)) * Rotation.from_rotvec(np.nan_to_num(obs.z))
    change = (turned[1:] * turned[:-1].inv()).as_rotvec()
    return np.where(np.isfinite(drift[1:]), change, np.nan)


def _printed(obs: Observations, alignment: Alignment) -> FloatArray:
    def turned(path: FloatArray) -> FloatArray:
        A = Rotation.from_quat(path[obs.index])
        return np.asarray((A[:-1].inv() * A[1:]).as_rotvec())

    main, sub = turned(obs.main.attitude), turned(obs.sub.attitude)
    return main - sub + np.cross(main, alignment.static.value)


def sample_autocorrelation(x: FloatArray, lags: int) -> tuple[FloatArray, FloatArray]:
    """Mean products (lags + 1,) at lags 0..lags over the pairs there are, and their number; x: (k,), NaN: not seen."""
    seen = np.isfinite(x)
    size = 1 << int(np.ceil(np.log2(len(x) + lags + 1)))
    correlate = lambda y: np.fft.irfft(np.abs(np.fft.rfft(y, size)) ** 2, size)[: lags + 1]  # noqa: E731
    pairs = np.rint(correlate(seen.astype(float)))
    return correlate(np.where(seen, x, 0.0)) / np.maximum(pairs, 1.0), pairs


def _axis(x: FloatArray, T: float, range_s: float) -> AxisCorrelation:
    length = float(np.isfinite(x).sum()) * T
    lags = int(min(max(range_s, RANGE_LIMITS_S[0]), RANGE_LIMITS_S[1], LARGEST_SHARE * length) / T)
    if lags < LEAST_LAGS:
        raise DataError(f"{length:.0f} s of data without a gap are too few for an autocorrelation of the flexure")
    R, pairs = sample_autocorrelation(x, lags)
    if not R[0] > 0.0:
        raise DataError("the two units turn exactly alike: there is no flexure to identify")
    return AxisCorrelation(R[1:], pairs[1:], float(R[0]), T, length)


def fit(correlation: AxisCorrelation) -> FloatArray:
    """(ln mu, ln b^2, ln sigma), (3,), by least squares over all lags, started from the best of a grid."""
    scale = float(np.max(np.abs(correlation.value)))
    lower, upper = limits(correlation.length)

    def residual(p: FloatArray) -> FloatArray:
        return (_model(p, correlation) - correlation.value) / scale

    start = np.clip(_start(correlation), lower + 1e-6, upper - 1e-6)
    return np.asarray(least_squares(residual, start, bounds=(lower, upper), xtol=1e-10, ftol=1e-10).x)


def limits(length: float) -> tuple[FloatArray, FloatArray]:
    """Bounds of (ln mu, ln b^2, ln sigma); no flexure slower than one period in the record of length s."""
    slowest = max(FREQUENCY_LIMITS[0], 2.0 * np.pi / length)
    lower = np.log([DAMPING_LIMITS[0], slowest**2, STD_LIMITS[0]])
    return lower, np.log([DAMPING_LIMITS[1], FREQUENCY_LIMITS[1] ** 2, STD_LIMITS[1]])


def _start(correlation: AxisCorrelation) -> FloatArray:
    """The best of a grid in (mu, b^2); sigma^2 is linear."""
    best, found = np.inf, np.zeros(3)
    for mu in START_DAMPING:
        for ratio in START_RATIO:
            shape = increment_autocorrelation(mu, ratio * mu**2, 1.0, correlation.T, len(correlation.value))[1:]
            variance = max(float(shape @ correlation.value / (shape @ shape)), STD_LIMITS[0] ** 2)
            misfit = float(np.sum((correlation.value - variance * shape) ** 2))
            if misfit < best:
                best, found = misfit, np.log([mu, ratio * mu**2, np.sqrt(variance)])
    return found


def _model(p: FloatArray, correlation: AxisCorrelation) -> FloatArray:
    mu, stiffness, std = np.exp(p)
    return increment_autocorrelation(mu, stiffness, std, correlation.T, len(correlation.value))[1:]


def covariance(p: FloatArray, correlation: AxisCorrelation) -> FloatArray:
    """(3, 3) of the fitted log parameters: ``(J^T J)^-1 J^T S J (J^T J)^-1``, S Bartlett's covariance of the lags.

    ``S_mn = (c(n-m) + c(n+m)) / pairs`` with c the autocorrelation of R_dTheta itself: neighbouring lags share most of
    their error.
    """
    step = 1e-4
    columns = [(_model(p + h, correlation) - _model(p - h, correlation)) / (2 * step) for h in step * np.eye(3)]
    J = np.stack(columns, axis=1)
    gain = np.linalg.pinv(J)
    found = gain @ _bartlett(p, correlation) @ gain.T
    return np.asarray(0.5 * (found + found.T))


def _bartlett(p: FloatArray, correlation: AxisCorrelation) -> FloatArray:
    lags = len(correlation.value)
    reach = int(min(max(4.0 * lags, 8.0 / (np.exp(p[0]) * correlation.T)), 20000))
    mu, stiffness, std = np.exp(p)
    one_side = increment_autocorrelation(mu, stiffness, std, correlation.T, reach)
    R = np.concatenate([one_side[:0:-1], one_side])
    c = sample_autocorrelation(R, 2 * lags)[0] * (len(R) - np.arange(2 * lags + 1))
    n = np.arange(1, lags + 1)
    return np.asarray(
        (toeplitz(c[:lags]) + c[n[:, None] + n]) / np.sqrt(np.outer(correlation.pairs, correlation.pairs))
    )


def identify_axes(name: str, trial: Trial, alignment: Alignment, solve: Solve, as_printed: bool) -> FlexureModel:
    """The flexure model of a trial: ranges of lag chosen per axis by the plain fit, parameters by ``solve``."""
    paired = pair(trial, alignment)
    obs = observe(paired, Linearisation.at(alignment))
    values, T = _increments(obs, alignment, as_printed)
    axes = [_with_range(values[:, axis], T) for axis in range(3)]
    found = [solve(axis) for axis in axes]
    spread = [covariance(p, axis) for p, axis in zip(found, axes)]
    judged = [_judge(p, P, axis.length) for p, P, axis in zip(found, spread, axes)]
    mu, stiffness, std = np.exp(np.stack(found, axis=1))
    coarsest = max(float(np.median(np.diff(unit.t))) for unit in (paired.main, paired.sub))
    return FlexureModel(
        method=name, damping=mu, stiffness=stiffness, std=std, log_covariance=np.stack(spread),
        gyro_noise=gyro_noise(obs, coarsest, np.exp(found)),
        status=(judged[0][0], judged[1][0], judged[2][0]), reason=(judged[0][1], judged[1][1], judged[2][1]),
    )  # fmt: skip


def gyro_noise(obs: Observations, coarsest: float, parameters: FloatArray) -> FloatArray:
    """(3,) rad/sqrt(s), angle random walk of both gyros together where it stands out of the flexure, else 0.

    From increments x over one sample of the slower unit (coarsest, s): ``E[x_k^2] - E[x_k x_{k+1}]`` is N^2 T and what
    the flexure of parameters (3, 3), rows mu, b^2, sigma, has there.
    """
    sample = float(np.median(np.diff(obs.t)))
    every = int(np.ceil(coarsest / sample - 1e-6)) * (2 if obs.dulled else 1)
    steps = np.zeros((len(obs.dt), 3))
    x = matching.increments(obs.total(steps, steps[:, 0])[::every])
    good = obs.good[::every]
    x[~(good[1:] & good[:-1])] = np.nan
    T, found = every * sample, np.zeros(3)
    for axis, (mu, stiffness, std) in enumerate(parameters):
        seen, own = (R[0] - R[1] for R in (sample_autocorrelation(x[:, axis], 1)[0],
                                           increment_autocorrelation(mu, stiffness, std, T, 1)))  # fmt: skip
        found[axis] = np.sqrt((seen - own) / T) if seen > NOISE_SHOWS * own else 0.0
    return found


def _with_range(x: FloatArray, T: float) -> AxisCorrelation:
    correlation = _axis(x, T, FIRST_RANGE_S)
    for _ in range(RANGE_ROUNDS):
        mu, stiffness, _ = np.exp(fit(correlation))
        correlation = _axis(x, T, RANGE / _slow_rate(mu, stiffness))
    return correlation


def _slow_rate(mu: float, stiffness: float) -> float:
    """1/s at which the autocorrelation dies away: the slow root of an overdamped axis."""
    return float(mu - np.sqrt(max(mu**2 - stiffness, 0.0)))


def _judge(p: FloatArray, P: FloatArray, length: float) -> tuple[Status, str]:
    mu, stiffness, _ = np.exp(p)
    lower, upper = limits(length)
    if np.any(p < lower + 1e-3) or np.any(p > upper - 1e-3):
        return Status.WEAK, "the fit ran into its bounds"
    if length * _slow_rate(mu, stiffness) < SHORT_RECORD:
        return Status.WEAK, f"the record of {length:.0f} s is shorter than {SHORT_RECORD:.0f} correlation times"
    if P[2, 2] > WEAK_SIGMA**2:
        return Status.WEAK, f"sigma is known to {100 * np.sqrt(P[2, 2]):.0f} % only"
    return Status.ESTIMATED, ""
