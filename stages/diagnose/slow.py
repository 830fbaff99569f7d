"""Slow bending against flexure that is itself slow: likelihood with the flexure's parameters free under both.

A deck whose flexure takes half a minute to die away bends slowly by itself. Held-out innovations tell it from bending
that follows the sun or the heel only as well as its parameters are known, and those rest on what is fast. So the angle
that the gyros show is fitted twice, with the columns in question and without, each time about the flexure that suits
it best: second-order Markov noise per axis, sampled exactly, beside the gyros' drift. What is gained between the two is
the logarithm of a likelihood ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from physics.flexure import noise_covariance, stationary_covariance, transition
from physics.innovations import innovations
from physics.normal import solve_normal
from physics.units import ARCMIN, DEG
from schemas.products import FlexureModel
from schemas.rig import FloatArray
from stages.paired import Observations
from twin.config import Flexure

EFFECTS = ("thermal_bending", "heel_bending")
INTERVAL_S = 0.5  # s, between the samples that are looked at, or more:
MOST_SAMPLES = 4000
SEEN = 1e-6  # rad, of the angle at a sample
SILENT = 1.0 * DEG  # rad, one sigma, by which the angle may have changed while the gyros were silent
HARMONICS = (1, 2, 3)  # half waves over the record that are slow
SLOWEST_HZ = 0.02  # up to which a column counts as slow
REACH = np.log(20.0)  # how far the flexure's parameters may go from where they start
SHARE = 0.3  # of natural logarithms: how well a twin knows its flexure, one sigma


@dataclass(frozen=True)
class Angle:
    """theta: (n, 3) rad, NaN in gaps. t: (n,) s. free: (n, 3, k), what the gyros' drift may add to each axis.

    walk: (n,) rad^2, what a random walk beside the angle grows by before each sample: the gyros' noise, and more where
    they were silent. start, believed: (3, 3) natural logarithms of damping, stiffness and std, one axis a row: where to
    start, and what the twin says.
    """

    t: FloatArray
    theta: FloatArray
    free: FloatArray
    walk: FloatArray
    start: FloatArray
    believed: FloatArray


@dataclass(frozen=True)
class Fitted:
    """x: (3, 3) as ``start`` of the angle. nats: (3,) log-likelihood of each axis."""

    x: FloatArray
    nats: FloatArray


def angle(obs: Observations, flexure: FlexureModel, belief: Flexure, walk: float) -> Angle:
    """What the gyros show of the angle between the units, thinned out; flexure: to start from; belief: the twin's."""
    t = obs.t[obs.index]
    interval = max(INTERVAL_S, (t[-1] - t[0]) / MOST_SAMPLES)
    every = max(1, round(interval / float(np.median(np.diff(t)))))
    chosen = slice(0, None, every)
    turned = np.swapaxes(obs.A_end, 1, 2)
    drift = turned @ np.cumsum(obs.A_integral, axis=0)
    free = np.concatenate([turned, drift], axis=2)
    grown = walk * np.diff(t[chosen], prepend=t[0])
    after = -(-np.flatnonzero(obs.jump_s > 0.0) // every)  # the first sample that is looked at from there on
    grown[after[after < len(grown)]] += SILENT**2
    mu = np.array(belief.damping)
    believed = np.log([mu, mu**2 + np.array(belief.frequency) ** 2, np.array(belief.std_arcmin) * ARCMIN]).T
    return Angle(t[chosen], obs.z[chosen], free[chosen], grown, _logarithms(flexure), believed)


def _logarithms(flexure: FlexureModel) -> FloatArray:
    return np.log(np.stack([flexure.damping, flexure.stiffness, flexure.std], axis=1))


def waves(t: FloatArray, harmonics: Sequence[int]) -> FloatArray:
    """(n, 2 k) sine and cosine of so many half waves over instants (n,), one harmonic after the other."""
    phase = np.pi * (t - t[0]) / (t[-1] - t[0])
    once = np.cos(phase) + 1j * np.sin(phase)
    out = np.empty((2 * len(harmonics), len(t)))
    for row, k in enumerate(harmonics):
        turned = once**k
        out[2 * row], out[2 * row + 1] = turned.imag, turned.real
    return out.T


def at(seen: Angle, t: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns (m, k) known at instants (m,) at those of the angle, (n, k)."""
    return np.stack([np.interp(seen.t, t, column) for column in columns.T], axis=1).reshape(len(seen.t), -1)


def sober(flexure: FlexureModel, seen: Angle, more: FloatArray) -> FlexureModel:
    """The flexure beside anything slow, harmonics of the record and ``more`` (n, k)."""
    damping, stiffness, std = np.exp(fit(seen, np.hstack([waves(seen.t, HARMONICS), more])).x).T
    return replace(flexure, damping=damping, stiffness=stiffness, std=std)


def price(columns: int, seen: Angle) -> float:
    """Nats that so many free numbers a log gain by chance, beside what the search for a period finds."""
    return 0.5 * columns * float(np.log(len(seen.t) * float(np.median(np.diff(seen.t))) * SLOWEST_HZ))


def fit(seen: Angle, columns: FloatArray) -> Fitted:
    """The flexure beside bending (n, k) whose size about each axis is free."""
    found = [_fit_axis(seen, axis, columns) for axis in range(3)]
    return Fitted(np.stack([x for x, _ in found]), np.array([nats for _, nats in found]))


def _fit_axis(seen: Angle, axis: int, columns: FloatArray) -> tuple[FloatArray, float]:
    Y = np.column_stack([seen.theta[:, axis], seen.free[:, axis], columns])
    size = np.sqrt(np.nanmean(Y**2, axis=0))
    Y[:, 1:] /= np.where(size[1:] > 0.0, size[1:], 1.0)
    steps = np.full(len(Y), float(np.median(np.diff(seen.t))))
    steps[0] = 0.0
    which = np.minimum(np.arange(len(Y)), 1)
    start, noise = seen.start[axis], np.full(len(Y), SEEN**2)

    def cost(x: FloatArray) -> float:
        if np.any(np.abs(x - start) > REACH):
            return 1e12
        mu, b2, std = np.exp(x)
        F, Q = transition(mu, b2, steps[:2]), noise_covariance(mu, b2, std, steps[:2])
        white = Y.copy()
        log_det = innovations(F[which], Q[which], stationary_covariance(b2, std), 0.0, seen.walk, 0, noise, white)
        G = white.T @ white
        value = solve_normal(G[1:, 1:], G[1:, 0])
        prior = float(np.sum((x - seen.believed[axis]) ** 2)) / SHARE**2
        return 0.5 * (float(G[0, 0] - value @ G[1:, 0]) + log_det + prior)

    best = start
    for _ in range(2):
        found = minimize(cost, best, method="Nelder-Mead", options={"xatol": 2e-3, "fatol": 2e-3, "maxiter": 300})
        best = found.x
    return best, -float(found.fun)
