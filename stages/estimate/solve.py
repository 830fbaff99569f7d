"""The iterated estimate: linearise, filter, smooth, identify the flexure again, until nothing moves.

The first rounds run on a piece of a long record, to find noise levels and lever arm at little cost; the last ones on
all of it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from physics.kalman import Course, Smoothed, SparseModel, log_likelihood, run_pieces
from physics.rotations import skew
from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.drift import slow_part
from stages.estimate import levels, tuning
from stages.estimate import model as m
from stages.flexure_fit import fit_flexure
from stages.paired import CARRIED_GAP_S, Linearisation, Observations, Paired, mean_rate_difference, observe, pair

COVARIANCE_STRIDE = 5  # steps: a second
PILOT_S = 900.0  # s of record on which noise levels are found first
PILOT_ROUNDS = 4
LONG_S = 900.0  # s: shorter records cannot show how strong slow bending is
DENSITIES = tuple(factor * tuning.QUASI_STATIC for factor in (1.0, 0.0, 10.0, 100.0))  # of slow bending, candidates
CHOICE_NATS = 4.0  # by how much the likelihood must gain before a default is left
DISAGREEMENT = 16.3  # chi-square with 3 degrees of freedom, 0.1 %
HOPELESS = 1.0  # m/s: beyond it the accelerometers are left out
WEAKER = 3.0  # factor on the velocity noise when the accelerometers disagree
DRIFT_KNOT_S = 60.0  # s: what drifts faster is left to the fit of flexure, which knows the gyros' noise
PLAIN_SIGMA = 5.0  # by which a difference of the mean rates must exceed what flexure and misalignment make of it
OPEN_ANGLE = 0.1  # rad: an alignment left more open does not tell bias from turning; the match is then held as it is
RESOLVED = 1e-4  # smoothed over filtered variance below which P - P Lambda P has lost its digits

OUT = np.array([m.D, m.D + 1, m.D + 2, m.DELAY, m.DRIFT, m.PHI, m.PHI + 1, m.PHI + 2])


@dataclass(frozen=True)
class Solution:
    """One round: what was linearised about what, and what came out. d: (N, 3) and so on are views of ``smoothed``."""

    at: Linearisation
    noise: m.Noise
    obs: Observations
    filtered: Course
    smoothed: Smoothed
    flexure: FlexureModel

    @property
    def total(self) -> FloatArray:
        """(n, 4) smoothed R_m_s at full rate."""
        return total_rotation(self.obs, self.smoothed.x)


def total_rotation(obs: Observations, x: FloatArray) -> FloatArray:
    """(n, 4) R_m_s at full rate from means (N, len(OUT)) of d, delay and drift at the steps."""
    return obs.total(x[:, :3], x[:, 3] + x[:, 4] * obs.centred)


def solve(trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Solution:
    """The smoothed solution of a trial. Raises DataError when the units hardly overlap."""
    paired = pair(trial, alignment)
    pilot = _piece(paired)
    job = Job(trial, alignment)
    at = Linearisation.at(alignment, trial.rig.lever_arm)
    flexure = tuning.separable(flexure)
    at = replace(at, gyro_bias=_plain_bias(pilot, alignment, flexure))
    noise = tuning.with_gyro_bias(tuning.initial(alignment, flexure, trial.rig), trial.rig, at.gyro_bias)
    for _ in range(PILOT_ROUNDS):
        solution = job.round(observe(pilot, at), at, noise, flexure)
        at, noise, flexure = job.after(solution, job.fitted(solution))
    at, noise, flexure = job.whole(observe(paired, at), at, noise, flexure)
    return job.settle(observe(paired, at), at, noise, flexure)


def _piece(paired: Paired) -> Paired:
    """The middle of a long record."""
    t = paired.main.t
    if t[-1] - t[0] <= 1.5 * PILOT_S:
        return paired
    middle = 0.5 * (t[0] + t[-1])
    return paired.between(middle - 0.5 * PILOT_S, middle + 0.5 * PILOT_S)


def _plain_bias(paired: Paired, alignment: Alignment, flexure: FlexureModel) -> FloatArray:
    """(3,) rad/s, s-axes: bias of the sub that the mean rates show; zero where flexure or misalignment may be it.

    A bias of hundreds of degrees an hour turns the match by tens of degrees: too far to be linearised about none.
    """
    bias = mean_rate_difference(paired, alignment)
    length = paired.main.t[-1] - paired.main.t[0]
    turning = np.linalg.norm(paired.main.gyro.mean(axis=0))
    open_angle = float(np.sqrt(np.linalg.eigvalsh(alignment.covariance)[-1]))
    else_explained = 2.0 * float(np.max(flexure.std)) / length + min(open_angle, OPEN_ANGLE) * turning
    return bias if np.linalg.norm(bias) > PLAIN_SIGMA * else_explained else np.zeros(3)


@dataclass(frozen=True)
class Job:
    """What stays the same from round to round."""

    trial: Trial
    alignment: Alignment

    def prior_mean(self, at: Linearisation) -> FloatArray:
        """(SIZE,) prior mean of the corrections: alignment, rig and zero errors, seen from the linearisation."""
        x0 = np.zeros(m.SIZE)
        x0[m.PHI : m.PHI + 3] = _log(self.alignment.rotation @ at.R_ref.T)
        x0[m.D : m.D + 3] = _log(at.R_0 @ self.alignment.rotation.T)
        x0[m.EPS : m.EPS + 3] = -at.R_ref @ at.gyro_bias
        x0[m.DELAY] = float(self.alignment.time_delay.value) - at.delay
        x0[m.DRIFT] = -at.drift
        stated = self.trial.rig.lever_arm
        x0[m.R : m.R + 3] = (np.zeros(3) if stated is None else stated) - at.lever_arm
        x0[m.M : m.M + 9] = -(at.R_ref @ at.scale @ at.R_ref.T).ravel()
        return x0

    def model(self, obs: Observations, at: Linearisation, noise: m.Noise) -> list[Callable[[], SparseModel]]:
        """The model about a linearisation, in pieces, its prior centred on the alignment."""
        return m.pieces(obs, noise, at.coupling, m.zeta_map(obs) @ self.prior_mean(at))

    def round(
        self, obs: Observations, at: Linearisation, noise: m.Noise, flexure: FlexureModel, identify: bool = True
    ) -> Solution:
        """Filter and smooth about one linearisation; identify the flexure in what comes out.

        Where the flexure is identified another round follows, and covariances of the smoothed states are left out.
        """
        size = max(float(np.linalg.norm(at.lever_arm)), 1.0)
        noise = replace(noise, coupling_prior=tuning.COUPLING_SHARE * size)
        kept = m.states(noise)
        stride = 0 if identify else COVARIANCE_STRIDE
        course, smoothed = run_pieces(self.model(obs, at, noise), np.searchsorted(kept, OUT), stride)
        course = m.with_all_states(course, kept, noise)
        if not identify:
            return Solution(at, noise, obs, course, _resolved(course, smoothed), flexure)
        solution = Solution(at, noise, obs, course, smoothed, flexure)
        return replace(
            solution, flexure=fit_flexure(obs.t, _undrifted(solution), obs.good, self.trial.rig, flexure, obs.dulled)
        )

    def after(self, solution: Solution, noise: m.Noise) -> tuple[Linearisation, m.Noise, FlexureModel]:
        """The next linearisation, noise and flexure after one round; noise: with the levels that it shows."""
        x, P = solution.filtered.x_last, np.diag(solution.filtered.P_last)
        eps, nabla = slice(m.EPS, m.EPS + 3), slice(m.NABLA, m.NABLA + 3)
        gyro_bias = solution.at.R_ref @ solution.at.gyro_bias + x[eps]
        noise = tuning.with_biases(noise, self.trial.rig, (gyro_bias, np.sqrt(P[eps])), (x[nabla], np.sqrt(P[nabla])))
        return _relinearised(solution, x), tuning.with_flexure(noise, solution.flexure), solution.flexure

    def whole(
        self, obs: Observations, at: Linearisation, noise: m.Noise, flexure: FlexureModel
    ) -> tuple[Linearisation, m.Noise, FlexureModel]:
        """A round on the whole record: what :meth:`after` says, and how strong slow bending is."""
        with ThreadPoolExecutor(1) as pool:
            density = pool.submit(self.quasi_static, obs, at, noise)
            solution = self.round(obs, at, noise, flexure)
            at, noise, flexure = self.after(solution, rescaled(solution))
            return at, replace(noise, quasi_static=density.result()), flexure

    def quasi_static(self, obs: Observations, at: Linearisation, noise: m.Noise) -> float:
        """The density of slow bending that the gyros make most likely.

        To leave the usual one takes evidence, towards none too: bending that is not admitted turns up as a drift of
        the heading of which nothing warns, while bending that was not there costs nearly nothing.
        """
        if obs.t[-1] - obs.t[0] < LONG_S:
            return noise.quasi_static
        gyros = replace(noise, use_velocity=False)
        return DENSITIES[self._likeliest(obs, at, [replace(gyros, quasi_static=density) for density in DENSITIES])]

    def fitted(self, solution: Solution) -> m.Noise:
        """Noise with the levels of the velocity match as its spectrum on a piece shows them."""
        noise = solution.noise
        if not noise.use_velocity:
            return noise
        least = tuning.least_accel_noise(self.trial.rig, noise)
        coupling, x_last = solution.at.coupling, solution.filtered.x_last
        return levels.fitted(solution.obs, noise, coupling, solution.smoothed.x, x_last, least)

    def _likeliest(self, obs: Observations, at: Linearisation, tried: list[m.Noise]) -> int:
        """Which set is most likely; the first one unless another gains enough."""
        gain = self.likelihoods(obs, at, tried)
        return int(np.argmax(gain - CHOICE_NATS * (np.arange(len(tried)) > 0)))

    def likelihoods(self, obs: Observations, at: Linearisation, tried: list[m.Noise]) -> FloatArray:
        """Log-likelihood of each set of noise parameters, two at a time."""
        run = lambda noise: log_likelihood(self.model(obs, at, noise))  # noqa: E731
        with ThreadPoolExecutor(2) as pool:
            return np.array(list(pool.map(run, tried)))

    def settle(self, obs: Observations, at: Linearisation, noise: m.Noise, flexure: FlexureModel) -> Solution:
        """The last round; the accelerometers keep their weight only while they agree with the gyros."""
        with ThreadPoolExecutor(2) as pool:
            alone = pool.submit(self.round, obs, at, replace(noise, use_velocity=False), flexure, False)
            solution = self.round(obs, at, noise, flexure, False)
            gyros = alone.result()
        while disagreement(solution, gyros) > DISAGREEMENT:
            if np.max(noise.velocity) > HOPELESS:
                return gyros
            noise = replace(noise, velocity=WEAKER * noise.velocity)
            solution = self.round(obs, at, noise, flexure, False)
        return solution


def _undrifted(solution: Solution) -> FloatArray:
    """(n, 4) R_m_s with the slow part of the drift alone taken out, for a fit of flexure that knows the gyros' noise.

    The smoothed drift holds, beside the gyros' noise, a share of the flexure. Were all of it taken out, the fit would
    miss both, the next round would take more, and so on until no flexure is left.
    """
    obs, x = solution.obs, solution.smoothed.x.copy()
    x[:, :3] = slow_part(obs.t[obs.index], x[:, :3], np.flatnonzero(obs.jump_s > CARRIED_GAP_S), DRIFT_KNOT_S)
    return total_rotation(obs, x)


def _resolved(filtered: Course, smoothed: Smoothed) -> Smoothed:
    """Hold the covariance at the start where the filter knew so little that the smoothed one has lost its digits."""
    own = np.diagonal(filtered.P, axis1=1, axis2=2)
    share = np.diagonal(smoothed.P, axis1=1, axis2=2) / np.maximum(own, 1e-300)
    poor = (share < RESOLVED).any(axis=1)
    first = int(np.argmin(poor)) if not poor.all() else 0
    P = smoothed.P.copy() if first else smoothed.P
    P[:first] = P[first]
    return Smoothed(smoothed.x, P)


def _relinearised(solution: Solution, x: FloatArray) -> Linearisation:
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


def rescaled(solution: Solution) -> m.Noise:
    """Noise with the levels of the velocity match scaled to their size on the whole."""
    noise, filtered = solution.noise, solution.filtered
    if not noise.use_velocity:
        return noise
    return tuning.rescaled(noise, filtered.innovation[:, 3:], filtered.innovation_variance[:, 3:])


def disagreement(solution: Solution, gyros: Solution) -> float:
    """Hausman's statistic of d with and without accelerometers, mid-record; chi-square, 3 degrees of freedom."""
    middle = len(solution.smoothed.x) // 2
    difference = solution.smoothed.x[middle, :3] - gyros.smoothed.x[middle, :3]
    P = gyros.smoothed.P[middle, :3, :3] - solution.smoothed.P[middle, :3, :3]
    values, vectors = np.linalg.eigh(P)
    values = np.maximum(values, 0.05 * np.diag(gyros.smoothed.P[middle, :3, :3]).min())
    # Where the flexure is not what the model says, the gyros alone know less than they claim.
    nis = gyros.filtered.innovation[:, :3] ** 2 / gyros.filtered.innovation_variance[:, :3]
    doubt = max(1.0, float(np.nanmean(nis, axis=0).max()))
    return float(np.sum((vectors.T @ difference) ** 2 / values)) / doubt


def _exp(vector: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def _log(matrix: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())
