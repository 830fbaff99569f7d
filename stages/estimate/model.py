"""The linear model that ties the observations of both units to flexure, drift, alignment and lever arm.

States (rad, m, s; m-axes unless said)::

    zeta            what the attitudes show, see below    measured free of noise
    theta'          rate of the flexure                   second-order Gauss-Markov per axis
    Phi, Phi'       correction of the static angle        integrated random walk (quasi-static bending)
    d               drift of the attitude match, i-axes   d' = A_m (eps + M omega) + white noise
    eps             gyro bias of the difference           random walk
    delay, drift    correction of the time delay          constants
    V               velocity error, i-axes                V' = -f_i x d + A_m nabla + white noise
    nabla           accelerometer bias of the difference  random walk
    r               correction of the lever arm           constant
    B               correction of its coupling to theta'  constant, (3, 3) row-major
    kappa           likewise to theta itself, per axis    constant; apart from B, because flexure moves the lever arm
                                                          only below some frequency: what holds for fast bending
                                                          must not bias what slow bending does
    n, n before     displacement, now and a step ago, by  white, m: flexure moves the lever arm only below some
                    which the lever arm lags flexure      frequency, and what is missing is displacement, not velocity
    M               errors of the gyro difference's scale constant, (3, 3) row-major
    M main          those of the main gyro alone          constant: they reach u through omega x r
    bias main       bias of the main gyro alone           constant; it reaches u, and V by turning the lever arm's
                                                          velocity: V' = -A_m (bias x (omega x r))
    step of d       change of d within the step, less     restarted at each step: zeta's change holds it, theta's
                    the main gyro's noise                 does not. The main gyro's noise is in omega too, and u
                                                          takes both: it cancels
    step of V       by how much V's end exceeds its mean  restarted at each step: u is a mean, and V's noise a walk
                    over the step, of its noise alone

The attitudes show ``zeta = theta + Phi + A_m^T d - omega_s delay``, free of noise but for rounding. It takes theta's
place as a state, so that this measurement is of one state and not a small difference of uncertain ones; theta's
dynamics are written in it. The second measurement is the mean relative velocity u. With zeta in hand u needs neither
theta' nor any derivative: ``u - B dz/dt - omega x B z = A_m^T V + omega x r - f delay + ...``. Slow
bending moves the lever arm as fast bending does, so Phi stays in z there; its constant part is absorbed by r. What
flexure moves the lever arm by beyond that model is the noise of u.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from physics import flexure
from physics.kalman import Course, SparseModel, selected
from physics.rotations import skew
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.paired import CARRIED_GAP_S, Observations

# In the order that leaves least to do: what moves, then what moves it, then what is only measured.
V, STEP_V, JITTER, JITTER_BEFORE, STEP_D, ZETA, THETA_DOT, PHI, D = 0, 3, 6, 9, 12, 15, 18, 21, 24
EPS, PHI_DOT, DELAY, DRIFT, M, NABLA = 27, 30, 33, 34, 35, 44
BIAS_MAIN, R, B, KAPPA, M_MAIN = 47, 50, 53, 62, 65
SIZE = 74
ROW = 44  # entries of a row of H, at most
GYRO_STATES = np.arange(ZETA, NABLA)  # what the attitudes alone can see
PIECE = 20_000  # steps whose model is held in memory at a time: a quarter of a gigabyte
LEAD = 2  # steps: the first ones of a model do not know what was before them, and take no velocity
PER_STEP = (
    "index", "dt", "jump_s", "gap_end", "z", "u", "A_start", "A_end", "A_mid", "omega", "motion", "A_motion", "bending",
    "rate_m", "rate_motion", "force_i", "force_m", "centred",
)  # fmt: skip
KNOWN_SHARE = 1.0 / 12.0  # variance of a share, from none to all, of which nothing is known
GAP_ANGLE = 5e-3  # rad, one sigma of a gap of 1 s and more
GAP_JERK = 0.02  # rad/s^3: what a straight line misses of a lively ship's rate in a short gap
Z_NOISE = 1e-7  # rad (0.0004 arcmin): rounding, interpolation and linearisation of z


@dataclass(frozen=True)
class Noise:
    """Parameters of the model; see the module for the states.

    damping, stiffness, std: (3,) flexure. gyro: (3,) rad/sqrt(s) and gyro_walk rad/s/sqrt(s). quasi_static: rad/s^1.5,
    of Phi'. velocity: (3,) m/s, of u per step; jitter: (3,) m, of n. accel: (m/s)/sqrt(s), accel_walk m/s^2/sqrt(s).
    The rest are prior sigmas (scale_prior (3, 3)). angle_open: (3, 3) rad^2, m-axes, what the alignment leaves open of
    the angle beyond phi_prior and drift_prior.
    use_velocity: False leaves the accelerometers out.
    """

    damping: FloatArray
    stiffness: FloatArray
    std: FloatArray
    gyro: FloatArray
    gyro_walk: float
    quasi_static: float
    velocity: FloatArray
    jitter: FloatArray
    accel: float
    accel_walk: float
    phi_prior: float
    drift_prior: float
    gyro_bias_prior: float
    delay_prior: float
    clock_prior: float
    accel_bias_prior: float
    lever_prior: float
    coupling_prior: float
    kappa_prior: float
    scale_prior: FloatArray
    use_velocity: bool = True
    angle_open: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


def build(obs: Observations, noise: Noise, coupling: FloatArray, x0: FloatArray) -> SparseModel:
    """The sparse model for :mod:`physics.kalman`; coupling: (3, 3) B linearised about, x0: (SIZE,) prior mean."""
    transition = _transition(obs, noise, coupling)
    process = _process(obs, noise)
    columns, rows, z, variance = _measurements(obs, noise, coupling)
    rows_e, cols_e, E = transition
    rows_q, cols_q, Q = process
    prior = _prior(obs, noise)
    return SparseModel(rows_e, cols_e, E, rows_q, cols_q, Q, columns, rows, z, variance, x0, prior)


def pieces(obs: Observations, noise: Noise, coupling: FloatArray, x0: FloatArray) -> list[Callable[[], SparseModel]]:
    """The model of :func:`build` in pieces of at most PIECE steps, each made when called; gyro states alone where
    the accelerometers are left out."""
    count = -(-len(obs.dt) // PIECE)
    edges = np.linspace(0, len(obs.dt), count + 1).astype(int).tolist()
    return [partial(_piece, obs, noise, coupling, x0, first, last) for first, last in pairwise(edges)]


def states(noise: Noise) -> IntArray:
    """Numbers of the states in the models of :func:`pieces`."""
    return np.arange(SIZE) if noise.use_velocity else GYRO_STATES


def with_all_states(course: Course, kept: IntArray, noise: Noise) -> Course:
    """The last state of a run over the states ``kept`` among all: the others, unseen, keep correction zero."""
    x, P = np.zeros(SIZE), np.diag(_sigma(noise) ** 2)
    x[kept] = course.x_last
    P[np.ix_(kept, kept)] = course.P_last
    return replace(course, x_last=x, P_last=P)


def _piece(obs: Observations, noise: Noise, coupling: FloatArray, x0: FloatArray, first: int, last: int) -> SparseModel:
    lead = min(first, LEAD)
    part = replace(obs, **{name: getattr(obs, name)[first - lead : last] for name in PER_STEP})
    whole = build(part, noise, coupling, x0)
    model = whole if noise.use_velocity else selected(whole, GYRO_STATES)
    if not lead:
        return model
    per_step = ("transition", "noise", "measurement", "z", "variance")
    return replace(model, **{name: getattr(model, name)[lead:] for name in per_step})


def _sigma(noise: Noise) -> FloatArray:
    """(SIZE,) prior sigmas, theta's in the place of zeta's."""
    sigma, scale = np.zeros(SIZE), noise.scale_prior.ravel()
    for first, value in (
        (ZETA, noise.std), (THETA_DOT, np.sqrt(noise.stiffness) * noise.std), (PHI, noise.phi_prior),
        (PHI_DOT, noise.quasi_static * np.sqrt(1800.0)), (D, noise.drift_prior), (EPS, noise.gyro_bias_prior),
        (V, 10.0), (NABLA, noise.accel_bias_prior), (R, noise.lever_prior), (JITTER, noise.jitter),
        (JITTER_BEFORE, noise.jitter), (KAPPA, noise.kappa_prior),
    ):  # fmt: skip
        sigma[first : first + 3] = value
    for first, value in ((B, noise.coupling_prior), (M, scale), (M_MAIN, scale)):
        sigma[first : first + 9] = value
    sigma[DELAY], sigma[DRIFT] = noise.delay_prior, noise.clock_prior
    return sigma


def _prior(obs: Observations, noise: Noise) -> FloatArray:
    P = np.diag(_sigma(noise) ** 2)
    for first in (PHI, D):  # m- and i-axes are the same at the start
        P[first : first + 3, first : first + 3] += noise.angle_open
    # eps holds the main gyro's bias with the other sign; the coarser unit has the larger one.
    main = main_share(obs, noise) * noise.gyro_bias_prior**2 * np.eye(3)
    P[BIAS_MAIN : BIAS_MAIN + 3, BIAS_MAIN : BIAS_MAIN + 3] = main
    P[BIAS_MAIN : BIAS_MAIN + 3, EPS : EPS + 3] = P[EPS : EPS + 3, BIAS_MAIN : BIAS_MAIN + 3] = -main
    T = zeta_map(obs)  # from theta in the first place to zeta
    return np.asarray(T @ P @ T.T)


def zeta_map(obs: Observations) -> FloatArray:
    """(SIZE, SIZE) that turns a state with theta(t_0) in the first place into one with zeta(t_0)."""
    T = np.eye(SIZE)
    T[ZETA : ZETA + 3, PHI : PHI + 3] = np.eye(3)
    T[ZETA : ZETA + 3, D : D + 3] = obs.A_motion[0].T
    T[ZETA : ZETA + 3, DELAY] = -obs.rate_motion[0]
    T[ZETA : ZETA + 3, DRIFT] = -obs.rate_motion[0] * obs.centred[0]
    return T


class _Pattern:
    """Collects the entries of a sparse matrix that changes with time."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.rows: list[int] = []
        self.cols: list[int] = []
        self.values: list[FloatArray] = []

    def add(self, row: int, col: int, value: FloatArray | float) -> None:
        self.rows.append(row)
        self.cols.append(col)
        self.values.append(np.broadcast_to(np.asarray(value, dtype=float), (self.steps,)))

    def block(self, row: int, col: int, value: FloatArray) -> None:
        """(N, 3, 3) values."""
        for i in range(3):
            for j in range(3):
                self.add(row + i, col + j, value[:, i, j])

    def arrays(self) -> tuple[IntArray, IntArray, FloatArray]:
        return np.array(self.rows), np.array(self.cols), np.ascontiguousarray(np.stack(self.values, axis=1))


def _flexure_steps(obs: Observations, noise: Noise, axis: int) -> tuple[FloatArray, FloatArray]:
    dt, which = np.unique(np.round(obs.dt, 7), return_inverse=True)
    parameters = noise.damping[axis], noise.stiffness[axis]
    F = flexure.transition(*parameters, dt)
    Q = flexure.noise_covariance(*parameters, noise.std[axis], dt)
    return F[which], Q[which]


def _transition(obs: Observations, noise: Noise, coupling: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    E = _Pattern(len(obs.dt))
    _flexure_rows(E, obs, noise)
    if noise.quasi_static > 0.0:
        for axis in range(3):
            E.add(PHI + axis, PHI_DOT + axis, obs.dt)
    E.block(D, EPS, obs.A_integral)
    _scale_rows(E, D, obs.A_integral, obs.motion)
    if noise.use_velocity:
        E.block(V, D, -skew(obs.force_i) * obs.dt[:, None, None])
        E.block(V, NABLA, obs.A_integral)
        E.block(V, BIAS_MAIN, obs.A_integral @ _lever_velocity(obs, coupling))
        E.block(STEP_D, EPS, obs.A_integral)
        _scale_rows(E, STEP_D, obs.A_integral, obs.motion)
        for axis in range(3):
            E.add(STEP_D + axis, STEP_D + axis, -1.0)
            E.add(STEP_V + axis, STEP_V + axis, -1.0)
        for axis in range(3):
            E.add(JITTER + axis, JITTER + axis, -1.0)
            E.add(JITTER_BEFORE + axis, JITTER_BEFORE + axis, -1.0)
            E.add(JITTER_BEFORE + axis, JITTER + axis, 1.0)
    return E.arrays()


def _lever_velocity(obs: Observations, coupling: FloatArray) -> FloatArray:
    """(N, 3, 3) m/s, cross-product matrix of the velocity omega x r of a lever arm whose coupling is -[r x]."""
    return skew(obs.motion @ coupling.T)


def main_share(obs: Observations, noise: Noise) -> float:
    """The main unit's part of the variance of both gyros' noise; a half as far as the record does not tell."""
    part, std = np.array(obs.main_noise) / np.mean(noise.gyro**2)
    weight = KNOWN_SHARE / (KNOWN_SHARE + std**2)
    return float(np.clip(weight * part + (1.0 - weight) * 0.5, 0.0, 1.0))


def _flexure_rows(E: _Pattern, obs: Observations, noise: Noise) -> None:
    """zeta and theta': theta = zeta - Phi - A_m^T d + omega_s delay stepped on, and put back."""
    A_T = np.swapaxes(obs.A_motion, 1, 2)
    before = np.concatenate([A_T[:1], A_T[:-1]])
    rate = obs.rate_motion
    rate_before = np.concatenate([rate[:1], rate[:-1]])
    centred_before = np.concatenate([obs.centred[:1], obs.centred[:-1]])
    on_eps = A_T @ obs.A_integral
    for axis in range(3):
        F, _ = _flexure_steps(obs, noise, axis)
        for row, f, kept in ((ZETA, F[:, 0], 1.0), (THETA_DOT, F[:, 1], 0.0)):
            E.add(row + axis, ZETA + axis, f[:, 0] - kept)
            E.add(row + axis, THETA_DOT + axis, f[:, 1] - (1.0 - kept))
            E.add(row + axis, PHI + axis, kept - f[:, 0])
            for j in range(3):
                E.add(row + axis, D + j, kept * A_T[:, axis, j] - f[:, 0] * before[:, axis, j])
            now, then = rate[:, axis], rate_before[:, axis]
            E.add(row + axis, DELAY, f[:, 0] * then - kept * now)
            E.add(row + axis, DRIFT, f[:, 0] * then * centred_before - kept * now * obs.centred)
        if noise.quasi_static > 0.0:
            E.add(ZETA + axis, PHI_DOT + axis, obs.dt)
    E.block(ZETA, EPS, on_eps)
    _scale_rows(E, ZETA, on_eps, obs.motion)


def _scale_rows(E: _Pattern, first: int, on_eps: FloatArray, omega: FloatArray) -> None:
    """A gyro error M omega acts as a bias does."""
    for row in range(3):
        for i in range(3):
            for j in range(3):
                E.add(first + row, M + 3 * i + j, on_eps[:, row, i] * omega[:, j])


def _process(obs: Observations, noise: Noise) -> tuple[IntArray, IntArray, FloatArray]:
    Q = _Pattern(len(obs.dt))
    extra = _gap_variance(obs.jump_s, noise)
    A_T = np.swapaxes(obs.A_motion, 1, 2)
    gyros = np.einsum("kij,j,klj->kil", obs.A_mid, noise.gyro**2, obs.A_mid) * obs.dt[:, None, None]
    gap = extra[:, None, None] * np.eye(3)
    drift, sub = gyros + gap, (1.0 - main_share(obs, noise)) * gyros + gap
    seen, sub_seen = A_T @ drift, A_T @ sub
    shown = seen @ obs.A_motion
    for axis in range(3):
        _, q = _flexure_steps(obs, noise, axis)
        Q.add(ZETA + axis, ZETA + axis, q[:, 0, 0])
        Q.add(ZETA + axis, THETA_DOT + axis, q[:, 0, 1])
        Q.add(THETA_DOT + axis, THETA_DOT + axis, q[:, 1, 1])
        if noise.quasi_static > 0.0:
            Q.add(PHI_DOT + axis, PHI_DOT + axis, noise.quasi_static**2 * obs.dt)
        Q.add(EPS + axis, EPS + axis, noise.gyro_walk**2 * obs.dt)
        Q.add(NABLA + axis, NABLA + axis, noise.accel_walk**2 * obs.dt)
        walk = noise.accel**2 * obs.dt
        Q.add(V + axis, V + axis, walk + (2.0 * obs.jump_s) ** 2)
        if noise.use_velocity:
            # A walk from zero: its end less its mean has a third of the end's variance and half of it in common.
            Q.add(V + axis, STEP_V + axis, walk / 2.0)
            Q.add(STEP_V + axis, STEP_V + axis, walk / 3.0)
            Q.add(JITTER + axis, JITTER + axis, noise.jitter[axis] ** 2)
        for other in range(3):
            Q.add(ZETA + axis, D + other, seen[:, axis, other])
            if other >= axis:
                Q.add(ZETA + axis, ZETA + other, shown[:, axis, other])
                Q.add(D + axis, D + other, drift[:, axis, other])
            if noise.use_velocity:
                Q.add(STEP_D + other, ZETA + axis, sub_seen[:, axis, other])
                Q.add(STEP_D + other, D + axis, sub[:, axis, other])
                if other >= axis:
                    Q.add(STEP_D + axis, STEP_D + other, sub[:, axis, other])
    return Q.arrays()


def _gap_variance(jump: FloatArray, noise: Noise) -> FloatArray:
    """Variance of what the bridging of a gap can have missed of the relative rotation.

    The flexure that happened unseen, at most its stationary spread, and what the other unit, turned by the coarse
    alignment, carried across wrongly or, in a short gap, what a straight line misses.
    """
    q = np.max(4 * noise.damping * noise.stiffness * noise.std**2)
    unseen = np.minimum(q * jump**3, 4.0 * np.max(noise.std) ** 2)
    missed = np.where(jump > CARRIED_GAP_S, GAP_ANGLE * np.minimum(jump, 1.0), GAP_JERK * jump**3)
    return np.asarray(unseen + missed**2) * (jump > 0)


def _measurements(
    obs: Observations, noise: Noise, coupling: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    N = len(obs.dt)
    width = ROW if noise.use_velocity else 1
    columns = np.zeros((6, width), dtype=np.int64)
    rows = np.zeros((N, 6, width))
    for i in range(3):
        columns[i, 0] = ZETA + i
        rows[:, i, 0] = 1.0
    z = np.full((N, 6), np.nan)
    z[:, :3] = obs.z
    variance = np.full((N, 6), Z_NOISE**2)
    if noise.use_velocity:
        _velocity_rows(obs, coupling, columns, rows)
        z[:, 3:] = obs.u - _flexure_velocity(obs, coupling)
        variance[:, 3:] = noise.velocity**2
        z[:LEAD, 3:] = np.nan
    return columns, rows, z, variance


def velocity_residual(obs: Observations, noise: Noise, coupling: FloatArray, x: FloatArray) -> FloatArray:
    """(N, 3) m/s: what states x (N, SIZE) leave of the velocity match; NaN where there is none."""
    columns, rows, z, _ = _measurements(obs, noise, coupling)
    return np.asarray(z[:, 3:] - np.einsum("nic,nic->ni", rows[:, 3:], x[:, columns[3:]]))


def _flexure_rate(obs: Observations) -> tuple[FloatArray, FloatArray]:
    """Mean of theta' and of theta over each step, as far as z tells."""
    rate = np.full_like(obs.z, np.nan)
    mean = np.full_like(obs.z, np.nan)
    rate[1:] = np.diff(obs.z, axis=0) / obs.dt[1:, None]
    mean[1:] = 0.5 * (obs.z[1:] + obs.z[:-1])
    return rate, mean


def _flexure_velocity(obs: Observations, coupling: FloatArray) -> FloatArray:
    rate, mean = _flexure_rate(obs)
    return rate @ coupling.T + np.cross(obs.omega, mean @ coupling.T)


def _velocity_rows(obs: Observations, coupling: FloatArray, columns: IntArray, rows: FloatArray) -> None:
    A_mid_T = np.swapaxes(obs.A_mid, 1, 2)
    dt = np.maximum(obs.dt, 1e-9)[:, None, None]
    motion = skew(obs.motion)
    on_main_bias = -coupling - 0.5 * dt * _lever_velocity(obs, coupling)
    on_step = -coupling @ np.swapaxes(obs.A_start, 1, 2) / dt
    A_change = np.swapaxes(obs.A_motion[1:] - obs.A_motion[:-1], 1, 2) / dt[1:]
    on_d = A_mid_T @ skew(obs.force_i) * (0.5 * dt) - motion @ coupling @ A_mid_T
    on_d[1:] -= coupling @ A_change
    # A delay shifts the sub's whole velocity; its share from turning and bending is what zeta's own shift predicts.
    on_delay = -obs.force_m
    theta = np.nan_to_num(_flexure_rate(obs)[1])
    for i in range(3):
        columns[3 + i] = [
            *range(V, V + 3), *range(D, D + 3), NABLA + i, *range(R, R + 3), DELAY, DRIFT,
            *range(B, B + 9), JITTER + i, JITTER_BEFORE + i, *range(KAPPA, KAPPA + 3),
            *range(STEP_D, STEP_D + 3), *range(M_MAIN, M_MAIN + 9), *range(STEP_V, STEP_V + 3),
            *range(BIAS_MAIN, BIAS_MAIN + 3),
        ]  # fmt: skip
        row = rows[:, 3 + i]
        row[:, 0:3] = A_mid_T[:, i]
        row[:, 3:6] = on_d[:, i]
        row[:, 6] = -0.5 * obs.dt
        row[:, 7:10] = motion[:, i]
        row[:, 10] = on_delay[:, i]
        row[:, 11] = on_delay[:, i] * obs.centred
        row[:, 12 + 3 * i : 15 + 3 * i] = obs.bending
        row[:, 21] = 1.0 / dt[:, 0, 0]
        row[:, 22] = -1.0 / dt[:, 0, 0]
        row[:, 23:26] = (motion @ coupling)[:, i] * theta
        # theta' is what zeta shows less what the gyros' errors, noise included, add to it within the step.
        row[:, 26:29] = on_step[:, i]
        for a in range(3):
            row[:, 29 + 3 * a : 32 + 3 * a] = -coupling[i, a] * obs.motion
        row[:, 38:41] = -A_mid_T[:, i]
        row[:, 41:44] = on_main_bias[:, i]
