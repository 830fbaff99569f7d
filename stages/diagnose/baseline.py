"""The twin's prediction of a log and what is left of it: nuisances re-fitted, innovations whitened.

Nuisances (biases, static angle, how flexure moves the lever arm, PHINS installation) are regressors with the prior
that a twin deserves; flexure, displacement and accelerometer noise and the PHINS' noise are fitted by likelihood. What
is left is white where the twin is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from physics.rotations import exp
from physics.units import MICRO_G
from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from stages import identify
from stages.diagnose import slow, whitening
from stages.diagnose.columns import Response, lever_velocity
from stages.diagnose.levels import ANEW, FACTORS, Tuner, residual
from stages.diagnose.nuisances import (
    Nuisance,
    believed_nuisances,
    full_rate,
    gyro_lag,
    impulses,
    settling,
    slow_bending,
    steps,
    structure,
    tolerances,
)
from stages.diagnose.view import Believed, arw_of, level
from stages.diagnose.whitening import AccelColour, Levels, PhinsMatch, Whitened
from stages.estimate import tuning
from stages.paired import Linearisation, Observations, Paired, observe, pair
from twin.bending import quasi_static
from twin.effects.heel_bending import LAG, lag

COLOUR = 20.0 * MICRO_G  # where the search for the accelerometers' coloured noise begins
COLOUR_TAU = 3.0  # s
JITTER, VELOCITY = 2e-5, 1e-5  # m, m/s, where the search begins; the floors are those of rounding
JUMP_SIGMA, MOST_JUMPS = 6.0, 8
SOFT = 1.5  # factor by which std is larger and stiffness smaller than spectra show, where slow bending passes for them


@dataclass(frozen=True)
class Baseline:
    """One linearisation of a log, whitened; columns: (N, 9, K) of the nuisances, whitened."""

    source: Believed
    at: Linearisation
    paired: Paired
    obs: Observations
    match: PhinsMatch | None
    flexure: FlexureModel
    levels: Levels
    whitened: Whitened
    nuisances: tuple[Nuisance, ...]
    columns: FloatArray
    response: Response
    jumps: tuple[float, ...]

    @property
    def t(self) -> FloatArray:
        """(N,) s, ends of the steps."""
        return self.obs.t[self.obs.index]

    @property
    def precision(self) -> FloatArray:
        """(K,) of the nuisances' priors."""
        return np.array([1.0 / n.sigma**2 for n in self.nuisances])

    def residual(self) -> FloatArray:
        """(N, 9) innovations less the nuisances' fit, NaN where masked."""
        return residual(self.whitened, self.columns, self.precision)


def baseline(source: Believed, coarse: Alignment, start: Levels | None = None) -> Baseline:
    """Whiten a log about what its twin says; coarse: what the log's alignment says, to carry units across gaps.

    start: noise of a baseline of nearly the same log, from which the search goes on. Raises DataError where the units
    hardly overlap.
    """
    believed = _aligned(source, coarse)
    recorded = source.trial
    if not source.forces:
        source = level(source)
    paired = pair(source.trial, believed, despike=False)  # a step of the mounting is a spike of its gyro
    flexure = tuning.separable(identify.get("whittle")().identify(recorded, believed))
    at = _centred(paired, Linearisation.at(believed, source.lever_arm), source)
    obs = _without_slow_bending(observe(paired, at), source, at.coupling)
    if not source.forces:
        obs = replace(obs, u=np.full_like(obs.u, np.nan))
    flexure = _sober(flexure, source, obs)
    response = Response(obs, at.R_ref, at.coupling)
    own = (
        *slow_bending(source, response),
        *settling(response),
        *structure(flexure, obs, at.R_ref, response),
        *tolerances(source, flexure, obs, at.R_ref, response),
        *gyro_lag(source, obs, at.R_ref, response),
    )
    match = whitening.phins_match(source.trial, obs)
    levels = _first_levels(source, believed, flexure)
    tuner = Tuner(obs, at, match, (*believed_nuisances(obs, at, response), *own), levels.phins)
    jumps = step_times(tuner, tuner.whitened(levels)[0])
    if jumps:
        smooth = believed_nuisances(obs, at, response, jumps)
        tuner = replace(tuner, nuisances=(*smooth, *own, *impulses(jumps, response)))
    # A step must neither make the noise larger nor be masked as wild: it is for the regression to find.
    free = replace(tuner, nuisances=(*tuner.nuisances, *steps(jumps, response)))
    levels = free.tuned(levels, FACTORS) if start is None else free.tuned(_resumed(levels, start), ANEW)
    whitened, columns = free.whitened(levels)
    columns = columns[:, :, : len(tuner.nuisances)]
    return Baseline(
        source, at, paired, obs, match, flexure, levels, whitened, tuner.nuisances, columns, response, jumps
    )


def _centred(paired: Paired, at: Linearisation, source: Believed) -> Linearisation:
    """With the sub's start turned so that z is zero on the average: what is left of its error is small to second order,
    which over half an hour would else show as metres per second."""
    obs = _without_slow_bending(observe(paired, at), source, at.coupling)
    lasting = np.nanmean(np.einsum("kij,kj->ki", obs.A_end, obs.z), axis=0)
    return replace(at, R_0=exp(-lasting) @ at.R_0)


def _sober(found: FlexureModel, source: Believed, obs: Observations) -> FlexureModel:
    """Slow bending passes for soft and wide flexure: where an axis seems softer and wider than spectra without slow
    motion show it, all axes as they are beside whatever is slow."""
    if source.flexure is None:
        return found
    _, stiffness, std = source.flexure
    if not np.any((found.std > SOFT * std) & (found.stiffness < stiffness / SOFT)):
        return found
    seen = slow.angle(obs, found, source.twin.flexure, arw_of(source) ** 2)
    heel = _with_heel(source, obs, seen)
    return slow.sober(found, seen, heel)


def _with_heel(source: Believed, obs: Observations, seen: slow.Angle) -> FloatArray:
    """(n, 1) lagged lateral force, (n, 0) without accelerometers."""
    if not source.forces:
        return np.zeros((len(seen.t), 0))
    t = obs.t[obs.index]
    lagged = lag(np.nan_to_num(obs.force_m[:, 0]), float(np.median(np.diff(t))), LAG)
    return np.interp(seen.t, t, lagged)[:, None]


def _without_slow_bending(obs: Observations, source: Believed, coupling: FloatArray) -> Observations:
    """The observations less the quasi-static bending that the twin says, which moves the lever arm as any bending."""
    belief = source.twin.flexure
    if not any(belief.quasi_static_amplitude_arcmin):
        return obs
    z = quasi_static(belief, obs.t)[obs.index]
    return replace(obs, z=obs.z - z, u=obs.u - lever_velocity(obs, coupling, z))


def extended(base: Baseline, more: Sequence[Nuisance]) -> Baseline:
    """The baseline with further regressors that have priors."""
    if not more:
        return base
    rows, first = base.columns.shape[1:]
    columns = np.concatenate([base.columns, np.empty((len(base.t), rows, len(more)))], axis=2)
    for k, nuisance in enumerate(more):
        columns[:, :, first + k] = nuisance.column[:, :rows]
    whitening.whitened_in_place(base.whitened, columns, first)
    return replace(base, nuisances=(*base.nuisances, *more), columns=columns)


def _first_levels(source: Believed, believed: Alignment, flexure: FlexureModel) -> Levels:
    noise = tuning.with_flexure(tuning.initial(believed, flexure, source.trial.rig), flexure)
    noise = replace(noise, jitter=np.full(3, JITTER), velocity=np.full(3, VELOCITY))
    return Levels(noise, AccelColour(np.full(3, COLOUR), COLOUR_TAU), whitening.phins_noise(source.twin.phins))


def _resumed(fresh: Levels, start: Levels) -> Levels:
    """The earlier levels with the flexure found now."""
    old = start.noise
    noise = replace(fresh.noise, jitter=old.jitter, velocity=old.velocity, accel=old.accel)
    return Levels(noise, start.colour, start.phins)


def step_times(tuner: Tuner, whitened: Whitened) -> tuple[float, ...]:
    """Instants (s since the epoch), to the sample, at which the attitude jumps by far more than flexure can."""
    found = whitened.filtered
    size = np.abs(found.innovation[:, :3] / np.sqrt(found.innovation_variance[:, :3])) / whitened.scale[:3]
    size = np.where(np.isfinite(size), size, 0.0).max(axis=1)
    size[whitening.masked(tuner.obs, 1)[:, 0]] = 0.0
    theta = full_rate(tuner.obs, tuner.at.R_ref)
    high = [int(k) for k in np.argsort(size)[::-1][:MOST_JUMPS] if size[k] > JUMP_SIGMA]
    return tuple(float(tuner.obs.t[_largest_jump(theta, tuner.obs.index[k - 1], tuner.obs.index[k])]) for k in high)


def _largest_jump(theta: FloatArray, first: int, last: int) -> int:
    """The sample up to which theta changes most."""
    return first + 1 + int(np.argmax(np.abs(np.diff(theta[first : last + 1], axis=0)).max(axis=1)))


def _aligned(source: Believed, coarse: Alignment) -> Alignment:
    """Static angle and delay as the twin says: what the log adds to them is for the regression to find."""
    mount = source.twin.mount
    delay = replace(coarse.time_delay, value=np.array(mount.time_delay))
    return replace(
        coarse, rotation=exp(source.static), static=replace(coarse.static, value=source.static), time_delay=delay
    )
