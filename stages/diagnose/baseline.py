"""The twin's prediction of a log and what is left of it: nuisances re-fitted, innovations whitened.

Nuisances (biases, static angle, how flexure moves the lever arm, PHINS installation) are regressors with the prior that
a twin deserves; flexure, displacement noise and the PHINS' noise are fitted by likelihood. What is left is white where
the twin is right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from physics.units import ARCMIN, DEG, DEG_PER_HOUR, MICRO_G
from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from stages import identify
from stages.diagnose import whitening
from stages.diagnose.columns import Response
from stages.diagnose.evidence import solve
from stages.diagnose.view import Believed, with_mean
from stages.diagnose.whitening import PhinsMatch, PhinsNoise, Whitened
from stages.estimate import model as m
from stages.estimate import tuning
from stages.paired import Linearisation, Observations, observe, pair
from twin.effects._prediction import Signals, on_axis

ROUNDS = 4
GYRO_BIAS = 0.05 * DEG_PER_HOUR  # how far a twin's figure may be off without being a gap, one sigma
ACCEL_BIAS = 50.0 * MICRO_G
STATIC = 5.0 * ARCMIN
INSTALLATION = 2.0 * ARCMIN
COUPLING_SHARE = 0.1  # of the lever arm
KAPPA = 0.1
PHINS_FACTORS = (0.5, 0.7, 1.0, 1.4, 2.0)


@dataclass(frozen=True)
class Nuisance:
    """A regressor (N, 9) with the standard deviation of its prior."""

    name: str
    column: FloatArray
    sigma: float


@dataclass(frozen=True)
class Baseline:
    """One linearisation of a log, whitened. residual: (N, 9), innovations without the nuisances' fit."""

    source: Believed
    alignment: Alignment
    at: Linearisation
    obs: Observations
    match: PhinsMatch | None
    flexure: FlexureModel
    noise: m.Noise
    phins: PhinsNoise
    whitened: Whitened
    nuisances: tuple[Nuisance, ...]
    columns: FloatArray
    response: Response

    @property
    def t(self) -> FloatArray:
        """(N,) s, ends of the steps."""
        return self.obs.t[self.obs.index]

    @property
    def precision(self) -> FloatArray:
        """(K,) of the nuisances' priors."""
        return np.array([1.0 / n.sigma**2 for n in self.nuisances])


def baseline(source: Believed, alignment: Alignment) -> Baseline:
    """Whiten a log about what its twin says. Raises DataError where the units hardly overlap."""
    alignment = with_mean(alignment, source.twin.mount.time_delay)
    flexure = tuning.separable(identify.get("whittle")().identify(source.trial, alignment))
    at = Linearisation.at(alignment, source.lever_arm)
    obs = observe(pair(source.trial, alignment), at)
    match = whitening.phins_match(source.trial, obs)
    noise = tuning.with_flexure(tuning.initial(alignment, flexure, source.trial.rig), flexure)
    phins = whitening.phins_noise(source.twin.phins)
    response = Response(obs, at.R_ref, at.coupling)
    obs, match = _less_static(source, obs, match, response)
    nuisances = _nuisances(obs, at, response)
    stacked = np.stack([n.column for n in nuisances], axis=2)
    precision = np.array([1.0 / n.sigma**2 for n in nuisances])
    for _ in range(ROUNDS):
        model = whitening.build(obs, noise, at.coupling, match, phins)
        whitened = whitening.whiten(model, obs)
        columns = whitening.whiten_columns(whitened, stacked)
        noise, phins = _tuned(noise, phins, whitened, columns, precision)
    return Baseline(source, alignment, at, obs, match, flexure, noise, phins, whitened, nuisances, columns, response)


def _less_static(source, obs, match, response):  # type: ignore[no-untyped-def]
    return obs, match


def _nuisances(obs: Observations, at: Linearisation, response: Response) -> tuple[Nuisance, ...]:
    n = len(obs.t)
    ones = np.ones(n)
    out = []
    for axis, name in enumerate("xyz"):
        one = on_axis(axis, ones)
        out.append(Nuisance(f"gyro bias {name}", response(Signals(gyro=one)), GYRO_BIAS))
        out.append(Nuisance(f"accel bias {name}", response(Signals(accel=one)), ACCEL_BIAS))
        out.append(Nuisance(f"static {name}", response(Signals(mount=one)), STATIC))
        out.append(Nuisance(f"installation {name}", response(Signals(phins=one)), INSTALLATION))
        rolling = on_axis(axis, np.ones(len(obs.index)))
    rate, mean = np.zeros_like(obs.z), np.zeros_like(obs.z)
    z = np.nan_to_num(obs.z)
    rate[1:], mean[1:] = np.diff(z, axis=0) / obs.dt[1:, None], 0.5 * (z[1:] + z[:-1])
    size = COUPLING_SHARE * max(float(np.linalg.norm(at.lever_arm)), 1.0)
    for i in range(3):
        for j in range(3):
            column = np.zeros((len(obs.index), 9))
            column[:, 3 + i] = rate[:, j]
            column[:, 3:6] += np.cross(obs.omega, on_axis(i, mean[:, j]))
            out.append(Nuisance(f"coupling {'xyz'[i]}{'xyz'[j]}", column, size))
    for j in range(3):
        column = np.zeros((len(obs.index), 9))
        column[:, 3:6] = np.cross(obs.omega, mean[:, [j]] * at.coupling[:, j])
        out.append(Nuisance(f"slow coupling {'xyz'[j]}", column, KAPPA))
    return tuple(out)


def _tuned(
    noise: m.Noise, phins: PhinsNoise, whitened: Whitened, columns: FloatArray, precision: FloatArray
) -> tuple[m.Noise, PhinsNoise]:
    """Displacement noise that makes what the nuisances leave of u white with unit variance."""
    left = residual(whitened, columns, precision)
    root = np.sqrt(whitened.filtered.innovation_variance[:, 3:6]) * whitened.scale[3:6]
    noise = tuning.with_jitter(noise, left[:, 3:6] * root, whitened.filtered.innovation_variance[:, 3:6])
    return noise, phins


def residual(whitened: Whitened, columns: FloatArray, precision: FloatArray) -> FloatArray:
    """(N, m) innovations less the nuisances' fit, NaN where masked."""
    y = whitened.values
    ok = np.isfinite(y)
    X, v = columns[ok], y[ok]
    Z = np.column_stack([X, v])
    value = solve(Z.T @ Z, precision, range(X.shape[1])).value
    return np.asarray(y - columns @ value)
