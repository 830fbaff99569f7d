"""The iterated estimate: linearise, filter, smooth, identify the flexure again, until nothing moves.

The first rounds run on a piece of a long record, to find noise levels and lever arm at little cost; the last ones on all of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from physics.kalman import Filtered, Smoothed, SparseModel, run_filter, run_smoother
from physics.rotations import skew
from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.estimate import model as m
from stages.estimate import tuning
from stages.flexure_fit import fit_flexure
from stages.paired import Linearisation, Observations, Paired, observe, pair

PILOT_S = 1200.0  # s of record on which noise levels are found first
PILOT_ROUNDS = 5
FINAL_ROUNDS = 2
LONG_S = 900.0  # s: shorter records cannot show quasi-static bending
QUASI_STATIC = np.array([1e-5, 1e-4, 1e-3]) * np.pi / 10800.0  # rad/s^1.5, candidates
QUASI_STATIC_NATS = 4.0  # by how much the likelihood must gain
DISAGREEMENT = 16.3  # chi-square with 3 degrees of freedom, 0.1 %
WEAKER = 3.0  # factor on the velocity noise when the accelerometers disagree
RESOLVED = 1e-4  # smoothed over filtered variance below which P - P Lambda P has lost its digits

OUT = np.array([m.D, m.D + 1, m.D + 2, m.DELAY, m.DRIFT, m.PHI, m.PHI + 1, m.PHI + 2])


@dataclass(frozen=True)
class Solution:
    """One round: what was linearised about what, and what came out. d: (N, 3) and so on are views of ``smoothed``."""

    at: Linearisation
    noise: m.Noise
    obs: Observations
    model: SparseModel
    filtered: Filtered
    smoothed: Smoothed
    flexure: FlexureModel

    @property
    def total(self) -> Rotation:
        """(n,) smoothed R_m_s at full rate."""
        return total_rotation(self.obs, self.smoothed.x)


def total_rotation(obs: Observations, x: FloatArray) -> Rotation:
    """R_m_s at full rate from means (N, len(OUT)) of d, delay and drift at the steps: Exp(-A_m^T d + omega_s delay) Y."""
    steps = obs.t[obs.index]
    d = np.stack([np.interp(obs.t, steps, x[:, i]) for i in range(3)], axis=1)
    centred = obs.t - 0.5 * (obs.t[0] + obs.t[-1])
    delay = np.interp(obs.t, steps, x[:, 3]) + np.interp(obs.t, steps, x[:, 4]) * centred
    return Rotation.from_rotvec(obs.rate_s_m * delay[:, None] - obs.A_m.inv().apply(d)) * obs.Y


def solve(trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Solution:
    """The smoothed solution of a trial. Raises DataError when the units hardly overlap."""
    paired = pair(trial)
    at = Linearisation.at(alignment, trial.rig.lever_arm)
    noise = tuning.initial(alignment, flexure, trial.rig)
    solution = None
    pilot = _piece(paired)
    for _ in range(PILOT_ROUNDS):
        solution = _round(pilot, trial, alignment, at, noise, flexure)
        at, noise, flexure = _next(trial, solution)
    for _ in range(FINAL_ROUNDS):
        solution = _round(paired, trial, alignment, at, noise, flexure)
        at, noise, flexure = _next(trial, solution)
        noise = _choose_quasi_static(solution, noise, alignment, trial)
    return _settle(paired, trial, alignment, at, noise, flexure)


def _piece(paired: Paired) -> Paired:
    """The middle of a long record."""
    t = paired.main.t
    if t[-1] - t[0] <= 1.5 * PILOT_S:
        return paired
    middle = 0.5 * (t[0] + t[-1])
    return paired.between(middle - 0.5 * PILOT_S, middle + 0.5 * PILOT_S)


def prior_mean(trial: Trial, alignment: Alignment, at: Linearisation) -> FloatArray:
    """(SIZE,) prior mean of the corrections: the alignment, the rig and zero errors, seen from the linearisation."""
    x0 = np.zeros(m.SIZE)
    x0[m.PHI : m.PHI + 3] = _log(alignment.rotation @ at.R_ref.T)
    x0[m.D : m.D + 3] = _log(at.R_0 @ alignment.rotation.T)
    x0[m.EPS : m.EPS + 3] = -at.R_ref @ at.gyro_bias
    x0[m.DELAY] = float(alignment.time_delay.value) - at.delay
    x0[m.DRIFT] = -at.drift
    stated = np.zeros(3) if trial.rig.lever_arm is None else trial.rig.lever_arm
    x0[m.R : m.R + 3] = stated - at.lever_arm
    x0[m.M : m.M + 9] = -(at.R_ref @ at.scale @ at.R_ref.T).ravel()
    return x0


def build(trial: Trial, alignment: Alignment, at: Linearisation, noise: m.Noise, obs: Observations) -> SparseModel:
    """The model about a linearisation, its prior centred on the alignment."""
    x0 = prior_mean(trial, alignment, at)
    return m.build(obs, noise, at.coupling, m.zeta_map(obs) @ x0)


def _round(
    paired: Paired, trial: Trial, alignment: Alignment, at: Linearisation, noise: m.Noise, flexure: FlexureModel
) -> Solution:
    obs = observe(paired, at)
    size = max(float(np.linalg.norm(at.lever_arm)), 1.0)
    noise = replace(noise, coupling_prior=tuning.COUPLING_SHARE * size)
    model = build(trial, alignment, at, noise, obs)
    filtered = run_filter(model, OUT)
    smoothed = _resolved(filtered, run_smoother(model, filtered))
    solution = Solution(at, noise, obs, model, filtered, smoothed, flexure)
    return replace(solution, flexure=fit_flexure(obs.t, solution.total, obs.good, trial.rig, flexure))


def _resolved(filtered: Filtered, smoothed: Smoothed) -> Smoothed:
    """Hold the covariance at the start where the filter knew so little that the smoothed one has lost its digits."""
    own = np.stack([filtered.P_out[:, a, state] for a, state in enumerate(OUT)], axis=1)
    share = np.diagonal(smoothed.P, axis1=1, axis2=2) / np.maximum(own, 1e-300)
    poor = (share < RESOLVED).any(axis=1) & (own > 0).all(axis=1)
    first = int(np.argmin(poor)) if not poor.all() else 0
    P = smoothed.P.copy()
    P[:first] = P[first]
    return Smoothed(smoothed.x, P)


def _next(trial: Trial, solution: Solution) -> tuple[Linearisation, m.Noise, FlexureModel]:
    """The next linearisation, tuned noise and flexure after one round."""
    x, P = solution.filtered.x[-1], np.diag(solution.filtered.P_last)
    innovation = solution.filtered.innovation[:, 3:]
    noise = tuning.with_velocity(solution.noise, innovation, solution.filtered.innovation_variance[:, 3:])
    R_m_s = solution.at.R_ref
    eps = R_m_s @ solution.at.gyro_bias + x[m.EPS : m.EPS + 3]
    noise = tuning.with_biases(
        noise,
        trial.rig,
        (eps, np.sqrt(P[m.EPS : m.EPS + 3])),
        (x[m.NABLA : m.NABLA + 3], np.sqrt(P[m.NABLA : m.NABLA + 3])),
    )
    return _relinearise(solution, x), tuning.with_flexure(noise, solution.flexure), solution.flexure


def _relinearise(solution: Solution, x: FloatArray) -> Linearisation:
    at, s = solution.at, solution.smoothed.x
    middle = len(s) // 2
    lever = at.lever_arm + x[m.R : m.R + 3]
    turn = at.R_ref.T
    return Linearisation(
        R_0=_exp(-s[0, :3]) @ at.R_0,
        R_ref=_exp(s[middle, 5:8]) @ at.R_ref,
        delay=at.delay + float(s[middle, 3]),
        drift=at.drift + float(s[middle, 4]),
        lever_arm=lever,
        coupling=-skew(lever),
        gyro_bias=at.gyro_bias + turn @ x[m.EPS : m.EPS + 3],
        scale=at.scale + turn @ x[m.M : m.M + 9].reshape(3, 3) @ at.R_ref,
    )


def _choose_quasi_static(solution: Solution, noise: m.Noise, alignment: Alignment, trial: Trial) -> m.Noise:
    """The density of slow bending that the record makes most likely, none if it does not ask for any."""
    if solution.obs.t[-1] - solution.obs.t[0] < LONG_S:
        return noise
    likelihood = {}
    for candidate in (0.0, *QUASI_STATIC):
        trying = replace(noise, quasi_static=float(candidate))
        model = build(trial, alignment, solution.at, trying, solution.obs)
        likelihood[float(candidate)] = run_filter(model, OUT, keep=False).log_likelihood
    best = max(likelihood, key=lambda q: likelihood[q] - (QUASI_STATIC_NATS if q > 0.0 else 0.0))
    return replace(noise, quasi_static=best)


def _settle(
    paired: Paired, trial: Trial, alignment: Alignment, at: Linearisation, noise: m.Noise, flexure: FlexureModel
) -> Solution:
    """The last round; the accelerometers keep their weight only while they agree with the gyros."""
    gyros = _round(paired, trial, alignment, at, replace(noise, use_velocity=False), flexure)
    while True:
        solution = _round(paired, trial, alignment, at, noise, flexure)
        if disagreement(solution, gyros) < DISAGREEMENT:
            return solution
        if np.max(noise.velocity) > 1.0:
            return gyros
        noise = replace(noise, velocity=WEAKER * noise.velocity)


def disagreement(solution: Solution, gyros: Solution) -> float:
    """Hausman's statistic of d with against without accelerometers at mid-record, chi-square with 3 degrees of freedom."""
    middle = len(solution.smoothed.x) // 2
    difference = solution.smoothed.x[middle, :3] - gyros.smoothed.x[middle, :3]
    P = gyros.smoothed.P[middle, :3, :3] - solution.smoothed.P[middle, :3, :3]
    values, vectors = np.linalg.eigh(P)
    values = np.maximum(values, 0.05 * np.diag(gyros.smoothed.P[middle, :3, :3]).min())
    return float(np.sum((vectors.T @ difference) ** 2 / values))


def _exp(vector: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _log(matrix: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())
