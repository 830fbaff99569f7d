"""A bias of the sub-IMU's gyros that wanders, as a Gaussian process in the regression.

b(t) = sum c_k sqrt(2/T) cos(pi k t / T) per axis, k from 1 on, c_k normal with the density of a first-order
Gauss-Markov process at k / 2T: 2 sigma^2 tau / (1 + (2 pi f tau)^2). Its mean is a bias, and free. The columns are
whitened once; evidence is the marginal likelihood of the best (sigma, tau) over that of no wandering, less the price of
two parameters. No wandering means noise as it was fitted, or more of it about any axis, white: what interpolation
over lost samples or a coarse lattice adds about the liveliest axis is no process that keeps its value for seconds.

A process that is named is taken out of the log as far as it was found, so that everything is linear about what is left;
its columns, times what was taken, are put back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, product

import numpy as np
from scipy.linalg import solve_triangular

from physics.normal import solve_normal
from physics.units import DEG_PER_HOUR
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.diagnose import whitening
from stages.diagnose.baseline import Baseline, extended
from stages.diagnose.evidence import PROCESS
from stages.diagnose.nuisances import Nuisance
from twin.effects._prediction import Signals, on_axis

NAME = "gyro_bias_instability"
FASTEST_S = 8.0  # shortest half period of the basis
MOST_TERMS = 80
SAMPLE_S = 0.05  # s between the instants at which the basis is propagated: the ship turns little in it
PIECE = 2000  # steps of the record whose columns are multiplied at a time
TAUS_S = (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
SIGMAS = tuple(0.02 * 1.5**k for k in range(22))  # deg/h
WHITE_SHARES = (
    0.3,
    0.5,
    0.75,
    1.0,
    1.5,
    2.0,
    3.0,
)  # of the fitted noise: white noise beside it
POINTS = 1000  # instants at which paths are compared
PRICE = 6.0  # nats
ANY_BIAS = 1e-4  # (deg/h)^-2, precision of the mean


@dataclass(frozen=True)
class Wander:
    """std: deg/h and its standard error, tau: s and its standard error, evidence: nats. by_axis: (3,) nats. path: what
    was taken out of the log."""

    std: float
    std_error: float
    tau: float
    tau_error: float
    evidence: float
    by_axis: FloatArray
    path: Path | None = None

    def taken_from(self, trial: Trial) -> Trial:
        """A log without its path, as far as there is one."""
        return trial if self.path is None else self.path.taken_from(trial)


@dataclass(frozen=True)
class Path:
    """A bias as it wandered from start to end (s): coefficients (3 terms,) of the cosines, rad/s^0.5, and means (3,),
    rad/s."""

    start: float
    end: float
    frequency: FloatArray
    value: FloatArray
    mean: FloatArray

    def at(self, t: FloatArray) -> FloatArray:
        """(n, 3) rad/s; before and after, it stands still."""
        into, length = np.clip(t, self.start, self.end) - self.start, self.end - self.start
        out = np.repeat(self.mean[None, :], len(t), axis=0)
        for f, value in zip(self.frequency, self.value.reshape(3, -1).T, strict=True):
            out += np.outer(np.cos(2.0 * np.pi * f * into) * np.sqrt(2.0 / length), value)
        return out

    def turns_from(self, other: Path) -> float:
        """Largest angle (rad) that lies between what both have turned a unit."""
        t = np.linspace(self.start, self.end, POINTS)
        return float(np.abs(np.cumsum(self.at(t) - other.at(t), axis=0)).max() * (t[1] - t[0]))

    def taken_from(self, trial: Trial) -> Trial:
        """A log without it."""
        sub = trial.sub
        return replace(trial, sub=replace(sub, gyro=sub.gyro - self.at(trial.seconds(sub.stamp))))


@dataclass(frozen=True)
class Basis:
    """columns: (N, m, 3 terms) whitened, axis by axis; frequency: (terms,) Hz."""

    columns: FloatArray
    frequency: FloatArray

    @classmethod
    def of(cls, base: Baseline, columns: FloatArray) -> Basis:
        """Columns of :func:`as_nuisances` that are whitened already."""
        return cls(columns, _frequencies(base))


def basis(base: Baseline) -> Basis:
    """The cosines on a baseline."""
    frequency = _frequencies(base)
    columns = np.empty((*base.whitened.values.shape, 3 * len(frequency)))
    first, response = 0, base.response.of_slow(SAMPLE_S)
    cosines = _cosines(response.t, frequency)
    while some := list(islice(cosines, whitening.LANES)):
        part = whitening.whiten_columns(base.whitened, response.many(some))
        columns[:, :, first : first + len(some)] = part
        first += len(some)
    return Basis(columns, frequency)


def _frequencies(base: Baseline) -> FloatArray:
    length = float(base.obs.t[-1] - base.obs.t[0])
    return np.arange(1, int(np.clip(length / FASTEST_S, 4, MOST_TERMS)) + 1) / (2.0 * length)


def _cosines(t: FloatArray, frequency: FloatArray) -> Iterator[Signals]:
    """Each frequency about each axis, axis by axis, one at a time: together they would be larger than the log."""
    t = t - t[0]
    for axis in range(3):
        for f in frequency:
            yield Signals(gyro=on_axis(axis, np.cos(2.0 * np.pi * f * t) * np.sqrt(2.0 / t[-1])))


def variances(frequency: FloatArray, std: float, tau: float) -> FloatArray:
    """(3 terms,) of the coefficients, (rad/s)^2 s; std in deg/h."""
    density = 2.0 * (std * DEG_PER_HOUR) ** 2 * tau / (1.0 + (2.0 * np.pi * frequency * tau) ** 2)
    return np.tile(density, 3)


def wander(base: Baseline, made: Basis, columns: FloatArray, precision: FloatArray) -> Wander:
    """The best process on top of whitened regressors (N, 9, K) with their priors and of any constant bias."""
    one = np.full(len(base.obs.t), DEG_PER_HOUR)
    constant = base.response.many(Signals(gyro=on_axis(axis, one)) for axis in range(3))
    columns = np.concatenate([columns, whitening.whiten_columns(base.whitened, constant)], axis=2)
    precision = np.concatenate([precision, np.full(3, ANY_BIAS)])
    terms, K = made.columns.shape[2], columns.shape[2]
    G = _moments(columns, made.columns, base.whitened.values)
    A, B, C = G[:K, :K] + np.diag(precision), G[:K, K:-1], G[K:-1, K:-1]
    solved = solve_normal(A, np.column_stack([B, G[:K, -1]]))
    information = C - B.T @ solved[:, :-1]
    moment = G[K:-1, -1] - B.T @ solved[:, -1]
    white, least = _white(information, moment, base.levels.noise.gyro)
    grid = list(product(SIGMAS, TAUS_S))
    tried = [variances(made.frequency, s, tau) for s, tau in grid]
    beside = (0.0, white) if white.any() else (0.0,)
    told = np.array([max(_marginal(information, moment, each + more) for more in beside) for each in tried]) - least
    best = int(np.argmax(told))
    std, tau = grid[best]
    weight = np.exp(told - told[best])
    weight /= weight.sum()
    log_std, log_tau = np.log([s for s, _ in grid]), np.log([tau for _, tau in grid])
    errors = [float(np.sqrt(np.sum(weight * (x - np.sum(weight * x)) ** 2))) for x in (log_std, log_tau)]
    mean_std, mean_tau = (float(np.exp(np.sum(weight * x))) for x in (log_std, log_tau))
    third = terms // 3
    parts = [slice(axis * third, (axis + 1) * third) for axis in range(3)]
    v = variances(made.frequency, std, tau)
    by_axis = np.array(
        [_marginal(information[p, p], moment[p], v[p] + white[p]) - _marginal(information[p, p], moment[p], white[p])
         for p in parts]
    )  # fmt: skip
    return Wander(mean_std, mean_std * errors[0], mean_tau, mean_tau * errors[1], float(told[best]) - PRICE, by_axis)


def _white(information: FloatArray, moment: FloatArray, fitted: FloatArray) -> tuple[FloatArray, float]:
    """(3 terms,) variances of white noise about each axis beside the fitted one (3,), rad/sqrt(s), the likeliest, and
    its nats; 0 where there is none."""
    third = len(moment) // 3
    out = np.zeros(len(moment))
    for axis in range(3):
        own = slice(axis * third, (axis + 1) * third)
        levels = [(share * fitted[axis]) ** 2 for share in WHITE_SHARES]
        told = [_marginal(information[own, own], moment[own], np.full(third, level)) for level in levels]
        if max(told) > 0.0:
            out[own] = levels[int(np.argmax(told))]
    return out, max(0.0, _marginal(information, moment, out)) if out.any() else 0.0


def _moments(columns: FloatArray, more: FloatArray, y: FloatArray) -> FloatArray:
    """[columns more y]^T [columns more y], a piece of the record at a time; where y is masked, columns are zero."""
    K, size = columns.shape[2], columns.shape[2] + more.shape[2] + 1
    out = np.zeros((size, size))
    for first in range(0, len(y), PIECE):
        part = slice(first, first + PIECE)
        Z = np.empty((*y[part].shape, size))
        Z[..., :K], Z[..., K:-1], Z[..., -1] = columns[part], more[part], np.nan_to_num(y[part])
        Z = Z.reshape(-1, size)
        out += Z.T @ Z
    return out


def _marginal(information: FloatArray, moment: FloatArray, variance: FloatArray) -> float:
    """ln N(y; 0, I + X V X^T) - ln N(y; 0, I)."""
    root = np.sqrt(variance)
    M = np.eye(len(root)) + root[:, None] * information * root
    try:
        L = np.linalg.cholesky(M)
    except np.linalg.LinAlgError:  # rounding, where columns are nearly one another
        value = np.linalg.solve(M, root * moment)
        return float(0.5 * (root * moment) @ value - 0.5 * np.linalg.slogdet(M)[1])
    value = solve_triangular(L, root * moment, lower=True, check_finite=False)
    return float(0.5 * value @ value - np.log(np.diag(L)).sum())


def with_wander(base: Baseline, found: Wander) -> Baseline:
    """A baseline with the process as regressors, what was taken out of the log for it put back to first order."""
    own = [*as_nuisances(base, found.std, found.tau), *mean_nuisances(base, found.std, found.tau)]
    wide = extended(base, own)
    if found.path is None:
        return wide
    values = wide.whitened.values + wide.columns[:, :, -len(own) :] @ np.append(found.path.value, found.path.mean)
    return replace(wide, whitened=replace(wide.whitened, values=values))


def path_of(base: Baseline, value: FloatArray) -> Path:
    """The bias as it wandered, by the values (3 terms + 3,) of the process' regressors."""
    return Path(float(base.obs.t[0]), float(base.obs.t[-1]), _frequencies(base), value[:-3], value[-3:])


def as_nuisances(base: Baseline, std: float, tau: float) -> Sequence[Nuisance]:
    """The process as regressors with priors; its mean over the record is a bias like any other."""
    frequency = _frequencies(base)
    raw = base.response.many(_cosines(base.obs.t, frequency))
    sigma = np.sqrt(variances(frequency, std, tau))
    return [Nuisance(f"{PROCESS} {k}", raw[:, :, k], float(s)) for k, s in enumerate(sigma)]


def mean_nuisances(base: Baseline, std: float, tau: float) -> Sequence[Nuisance]:
    """The mean of a process over the record, per axis: its spread is that of the process, averaged."""
    length = float(base.obs.t[-1] - base.obs.t[0])
    x = length / tau
    spread = std * DEG_PER_HOUR * np.sqrt(2.0 * (x - 1.0 + np.exp(-x))) / x
    one = np.ones(len(base.obs.t))
    return [
        Nuisance(f"{PROCESS} mean {name}", base.response(Signals(gyro=on_axis(axis, one))), float(spread))
        for axis, name in enumerate("xyz")
    ]
