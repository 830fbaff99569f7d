"""Noise levels of the baseline, by likelihood of the log less its nuisances: a factor at a time, ever finer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from physics.kalman import run_filter
from schemas.rig import FloatArray
from stages.diagnose import whitening
from stages.diagnose.columns import lever_velocity
from stages.diagnose.evidence import solve
from stages.diagnose.nuisances import Nuisance
from stages.diagnose.whitening import Core, Levels, PhinsMatch, PhinsNoise, Whitened
from stages.estimate.model import PER_STEP
from stages.paired import Linearisation, Observations

PILOT_S = 400.0  # of record on which noise is found
FACTORS = ((0.05, 20.0), (0.2, 5.0), (0.45, 2.2), (0.8, 1.25))  # tried on each noise level, round by round
ANEW = ((0.7, 1.4),)  # of a log that changed a little
DRIFT_FACTOR = 1.5  # one sigma, by which size and time constant of the PHINS' slow noise are off the twin's
PARABOLA = 2.5  # factor up to which a log-likelihood is one in the logarithm of a level
STATES = np.zeros(0, dtype=np.int64)

Factors = tuple[float, ...]
Change = Callable[[Levels, FloatArray], Levels]


@dataclass(frozen=True)
class Tuner:
    """A log about one linearisation with its nuisances: whitens it at given levels, and finds the levels.

    phins: what the twin says of the PHINS' noise.
    """

    obs: Observations
    at: Linearisation
    match: PhinsMatch | None
    nuisances: tuple[Nuisance, ...]
    phins: PhinsNoise

    @property
    def raw(self) -> FloatArray:
        """(N, 9, K), the nuisances' columns."""
        return np.stack([n.column for n in self.nuisances], axis=2)

    @property
    def precision(self) -> FloatArray:
        """(K,) of their priors."""
        return np.array([1.0 / n.sigma**2 for n in self.nuisances])

    def whitened(self, levels: Levels) -> tuple[Whitened, FloatArray]:
        """Innovations and nuisances, both scaled so that what the nuisances leave has unit variance per channel."""
        found = whitening.whiten(whitening.build(self.obs, levels, self.at.coupling, self.match), self.obs)
        columns = whitening.whiten_columns(found, self.raw)
        found = whitening.rescaled(found, residual(found, columns, self.precision))
        columns /= found.scale[:, None]
        columns[~np.isfinite(found.values)] = 0.0
        return found, columns

    def tuned(self, levels: Levels, rounds: Sequence[Factors]) -> Levels:
        """All noise by likelihood of the middle of the log less its nuisances."""
        pilot = self._pilot()
        for factors in rounds:
            found, columns = pilot.whitened(levels)
            levels = pilot._less(_fit(found, columns, self.precision)).climbed(levels, factors)
        return levels

    def _pilot(self) -> Tuner:
        """The middle of a long record."""
        t = self.obs.t[self.obs.index]
        if t[-1] - t[0] <= 1.5 * PILOT_S:
            return self
        middle = 0.5 * (t[0] + t[-1])
        part = slice(*np.searchsorted(t, [middle - 0.5 * PILOT_S, middle + 0.5 * PILOT_S]))
        cut = {name: getattr(self.obs, name)[part] for name in PER_STEP}
        match = self.match and PhinsMatch(*(value[part] for value in vars(self.match).values()))
        nuisances = tuple(replace(n, column=n.column[part]) for n in self.nuisances)
        return replace(self, obs=replace(self.obs, **cut), match=match, nuisances=nuisances)

    def _less(self, value: FloatArray) -> Tuner:
        """The same with the nuisances' fit taken off the observations."""
        off = self.raw @ value
        z, coupling = off[:, :3], self.at.coupling
        # The model takes the lever's motion off u for the z it is given; the columns of u are without it.
        obs = replace(self.obs, z=self.obs.z - z, u=self.obs.u - off[:, 3:6] - lever_velocity(self.obs, coupling, z))
        match = None if self.match is None else replace(self.match, q=self.match.q - off[:, 6:9])
        return replace(self, obs=obs, match=match)

    def climbed(self, levels: Levels, factors: Factors) -> Levels:
        """One round over all levels, a factor at a time; axes apart where they have levels of their own."""
        changes: list[Change] = [_jitter, _velocity, _colour, _accel, _colour_tau]
        if self.match is not None:
            changes += [_white, _drift, _tau]
        tried = np.log([factors[0], 1.0, factors[1]])
        made = whitening.core(self.obs, levels.noise, self.at.coupling)
        now = self.channels(levels, made)
        for change in changes:
            less, more = (self.channels(change(levels, np.full(3, f)), made) for f in factors)
            told = np.stack([less, now, more])
            told = told[:, 3:6] if change in PER_AXIS else np.repeat(told.sum(axis=1)[:, None], 3, axis=1)
            if change in OF_DRIFT:
                told += np.array([self._likely(change(levels, np.full(3, f))) for f in (factors[0], 1.0, factors[1])])[
                    :, None
                ]
            chosen = np.exp(_highest(tried, told))
            if np.any(chosen != 1.0):
                levels = change(levels, chosen)
                now = self.channels(levels, made)
        return levels

    def _likely(self, levels: Levels) -> float:
        """Log-density of the PHINS' slow noise, given what the twin says: a few of its time constants of record tell
        the speed at which it wanders, and hardly how far."""
        found, said = levels.phins, self.phins
        off = np.log([found.drift[0] / said.drift[0], found.tau / said.tau]) / np.log(DRIFT_FACTOR)
        return -0.5 * float(off @ off)

    def channels(self, levels: Levels, made: Core) -> FloatArray:
        """(9,) log-likelihood of the innovations of each channel. made: at levels of the same flexure and gyros."""
        model = whitening.build(self.obs, levels, self.at.coupling, self.match, made)
        found = run_filter(model, STATES, keep=False)
        S = found.innovation_variance
        return np.asarray(-0.5 * np.nansum(np.log(S) + found.innovation**2 / S, axis=0))


def _highest(x: FloatArray, y: FloatArray) -> FloatArray:
    """(k,) where the likelihoods y (3, k) of three x (3,) are highest: by parabola where x are close, else one of x."""
    best = np.argmax(y, axis=0)
    if x[2] > np.log(PARABOLA):
        return np.asarray(x[best])
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    bend = (right - left) / (x[2] - x[0])
    low, high = x[np.maximum(best - 1, 0)], x[np.minimum(best + 1, 2)]
    with np.errstate(divide="ignore", invalid="ignore"):
        top = 0.5 * (x[0] + x[1]) - 0.5 * left / bend
    return np.where(bend < 0.0, np.clip(top, 0.5 * (low + x[best]), 0.5 * (high + x[best])), x[best])


def _jitter(levels: Levels, factor: FloatArray) -> Levels:
    jitter = np.maximum(factor * levels.noise.jitter, 1e-8)
    return replace(levels, noise=replace(levels.noise, jitter=jitter))


def _velocity(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, noise=replace(levels.noise, velocity=np.maximum(factor * levels.noise.velocity, 1e-8)))


def _accel(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, noise=replace(levels.noise, accel=float(factor[0]) * levels.noise.accel))


def _colour(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, colour=replace(levels.colour, std=np.maximum(factor * levels.colour.std, 1e-7)))


def _colour_tau(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, colour=replace(levels.colour, tau=float(np.clip(factor[0] * levels.colour.tau, 0.3, 100.0))))


def _white(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, phins=replace(levels.phins, white=float(factor[0]) * levels.phins.white))


def _drift(levels: Levels, factor: FloatArray) -> Levels:
    return replace(levels, phins=replace(levels.phins, drift=factor[0] * levels.phins.drift))


def _tau(levels: Levels, factor: FloatArray) -> Levels:
    phins, f = levels.phins, float(factor[0])
    return replace(levels, phins=replace(phins, tau=f * phins.tau, drift=np.sqrt(f) * phins.drift))


PER_AXIS = (_jitter, _velocity, _colour)
OF_DRIFT = (_drift, _tau)


def _fit(whitened: Whitened, columns: FloatArray, precision: FloatArray) -> FloatArray:
    K = columns.shape[2]
    X, y = columns.reshape(-1, K), np.nan_to_num(whitened.values).reshape(-1)  # masked columns are zero
    G = np.empty((K, K + 1))
    G[:, :K], G[:, K] = X.T @ X, X.T @ y
    return solve(G, precision, range(K)).value


def residual(whitened: Whitened, columns: FloatArray, precision: FloatArray) -> FloatArray:
    """(N, m) innovations less the nuisances' fit, NaN where masked."""
    return np.asarray(whitened.values - columns @ _fit(whitened, columns, precision))
