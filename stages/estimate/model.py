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
    S               scale factors of the accelerometers   constant: V' = A_m S f_m
                    of the difference, per axis
    G               gyro bias of the main unit            constant; kept where it matters, see below
    lag             mean of V over the step less its end  restarted at each step
    step of d       change of d within the step           restarted at each step: zeta's change holds it,
                                                          theta's does not

The attitudes show ``zeta = theta + Phi + A_m^T d - omega_s delay``, free of noise but for rounding. It takes theta's
place as a state, so that this measurement is of one state and not a small difference of uncertain ones; theta's
dynamics are written in it. The second measurement is the mean relative velocity u. With zeta in hand u needs neither
theta' nor any derivative: ``u - B dz/dt - omega x B z = A_m^T V + omega x r - f delay + ...``. Slow
bending moves the lever arm as fast bending does, so Phi stays in z there; its constant part is absorbed by r. What
flexure moves the lever arm by beyond that model is the noise of u.

A bias common to both gyros cancels in the attitudes as far as the units' axes agree; flexure turns it,
``d' = A_m z x G``. In u it does not: with rates that are wrong by G the integrals hold ``V' = -A_m G x (omega x r)``
and u itself ``-G x r``. Fine gyros do without these states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from physics.kalman import Course, SparseModel, selected
from physics.rotations import skew
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.estimate.dynamics import process_entries, transition_entries
from stages.estimate.states import (
    DELAY,
    DRIFT,
    EPS,
    GYRO_STATES,
    JITTER,
    JITTER_BEFORE,
    KAPPA,
    LAG,
    M_MAIN,
    NABLA,
    PHI,
    PHI_DOT,
    SIZE,
    STEP_D,
    THETA_DOT,
    ZETA,
    B,
    D,
    G,
    M,
    Noise,
    R,
    S,
    V,
)  # fmt: skip
from stages.paired import Observations

__all__ = [
    "DELAY",
    "DRIFT",
    "EPS",
    "GYRO_STATES",
    "JITTER",
    "JITTER_BEFORE",
    "KAPPA",
    "LAG",
    "M_MAIN",
    "NABLA",
    "PHI",
    "PHI_DOT",
    "SIZE",
    "STEP_D",
    "THETA_DOT",
    "ZETA",
    "B",
    "D",
    "G",
    "M",
    "Noise",
    "R",
    "S",
    "V",
    "build",
    "pieces",
    "prior_map",
    "states",
    "with_all_states",
    "zeta_map",
]  # fmt: skip

ROW = 45  # entries of a row of H, at most
PIECE = 20_000  # steps whose model is held in memory at a time: a quarter of a gigabyte
LEAD = 2  # steps: the first ones of a model do not know what was before them, and take no velocity
PER_STEP = (
    "index", "dt", "jump_s", "gap_end", "z", "u", "A_start", "A_end", "A_mid", "omega", "rate_m", "force_i", "force_m",
    "centred",
)  # fmt: skip
Z_NOISE = 1e-7  # rad (0.0004 arcmin): rounding, interpolation and linearisation of z


def build(obs: Observations, noise: Noise, coupling: FloatArray, x0: FloatArray) -> SparseModel:
    """The sparse model for :mod:`physics.kalman`; coupling: (3, 3) B linearised about, x0: (SIZE,) prior mean."""
    transition = transition_entries(obs, noise, coupling)
    process = process_entries(obs, noise)
    columns, rows, z, variance = _measurements(obs, noise, coupling)
    rows_e, cols_e, E = transition
    rows_q, cols_q, Q = process
    prior = _prior(obs, noise, coupling)
    return SparseModel(rows_e, cols_e, E, rows_q, cols_q, Q, columns, rows, z, variance, x0, prior)


def pieces(obs: Observations, noise: Noise, coupling: FloatArray, x0: FloatArray) -> list[Callable[[], SparseModel]]:
    """The model of :func:`build` in pieces of at most PIECE steps, each made when called; gyro states alone where
    the accelerometers are left out."""
    count = -(-len(obs.dt) // PIECE)
    edges = np.linspace(0, len(obs.dt), count + 1).astype(int).tolist()
    return [partial(_piece, obs, noise, coupling, x0, first, last) for first, last in pairwise(edges)]


def states(noise: Noise) -> IntArray:
    """Numbers of the states in the models of :func:`pieces`."""
    return noise.states


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
    model = whole if len(noise.states) == SIZE else selected(whole, noise.states)
    if not lead:
        return model
    per_step = ("transition", "noise", "measurement", "z", "variance")
    return replace(model, **{name: getattr(model, name)[lead:] for name in per_step})


def _sigma(noise: Noise) -> FloatArray:
    """(SIZE,) prior sigmas, theta's in the place of zeta's."""
    ones = np.ones(3)
    rate = np.sqrt(noise.stiffness) * noise.std
    creep = noise.quasi_static * np.sqrt(1800.0) * ones
    main = noise.scale_prior_main * np.ones((3, 3))
    return np.concatenate([
        noise.std, rate, noise.phi_prior * ones, creep, noise.drift_prior * ones, noise.gyro_bias_prior * ones,
        [noise.delay_prior, noise.clock_prior], 10.0 * ones, noise.accel_bias_prior * ones, noise.lever_prior * ones,
        noise.coupling_prior * np.ones(9), np.hypot(noise.scale_prior, main).ravel(), noise.jitter, noise.jitter,
        noise.kappa_prior * ones, 0.0 * ones, main.ravel(), 0.0 * ones,
        noise.accel_scale_prior * ones, noise.main_bias_prior * ones,
    ])  # fmt: skip


def _prior(obs: Observations, noise: Noise, coupling: FloatArray) -> FloatArray:
    T = prior_map(obs, coupling)
    P = np.diag(_sigma(noise) ** 2)
    if noise.use_velocity:
        # M is what the sub-IMU does wrong less what the main one does.
        entry = np.arange(9)
        P[M + entry, M_MAIN + entry] = P[M_MAIN + entry, M + entry] = -P[M_MAIN + entry, M_MAIN + entry]
    return np.asarray(T @ P @ T.T)


def prior_map(obs: Observations, coupling: FloatArray) -> FloatArray:
    """(SIZE, SIZE) from the state as one knows it beforehand: theta(t_0) in the first place, r where theta = 0.

    The filter has r where zeta = 0, which is short of it by B Phi.
    """
    T = zeta_map(obs)
    T[R : R + 3, PHI : PHI + 3] = -coupling
    return T


def zeta_map(obs: Observations) -> FloatArray:
    """(SIZE, SIZE) that turns a state with theta(t_0) in the first place into one with zeta(t_0)."""
    T = np.eye(SIZE)
    T[ZETA : ZETA + 3, PHI : PHI + 3] = np.eye(3)
    T[ZETA : ZETA + 3, D : D + 3] = obs.A_end[0].T
    T[ZETA : ZETA + 3, DELAY] = -obs.rate_m[0]
    T[ZETA : ZETA + 3, DRIFT] = -obs.rate_m[0] * obs.centred[0]
    return T


def _measurements(
    obs: Observations, noise: Noise, coupling: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    N = len(obs.dt)
    columns = np.zeros((6, ROW), dtype=np.int64)
    rows = np.zeros((N, 6, ROW))
    for i in range(3):
        columns[i, 0] = ZETA + i
        rows[:, i, 0] = 1.0
    z = np.full((N, 6), np.nan)
    z[:, :3] = obs.z
    variance = np.full((N, 6), Z_NOISE**2)
    if noise.use_velocity:
        _velocity_rows(obs, coupling, columns, rows)
        z[:, 3:] = obs.u - _flexure_velocity(obs, coupling)
        variance[:, 3:] = noise.velocity**2 + _common_noise(obs, noise, coupling)
        z[:LEAD, 3:] = np.nan
    return columns, rows, z, variance


def _common_noise(obs: Observations, noise: Noise, coupling: FloatArray) -> FloatArray:
    """(N, 3) of u, by the part of the gyros' noise that their difference does not show: B of it over the step."""
    unseen = noise.sub_share * (1.0 - noise.sub_share) * noise.gyro**2 / np.maximum(obs.dt, 1e-9)[:, None]
    return np.asarray(unseen @ (coupling**2).T)


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
    turning = skew(obs.omega)
    on_step = -coupling @ np.swapaxes(obs.A_start, 1, 2) / dt
    A_change = np.swapaxes(obs.A_end - obs.A_start, 1, 2) / dt
    on_d = A_mid_T @ skew(obs.force_i) * (0.5 * dt) - coupling @ A_change - turning @ coupling @ A_mid_T
    # A delay shifts the sub's whole velocity; its share from turning and bending is what zeta's own shift predicts.
    on_delay = -obs.force_m
    theta_dot, theta = (np.nan_to_num(x) for x in _flexure_rate(obs))
    for i in range(3):
        columns[3 + i] = [
            *range(V, V + 3), *range(D, D + 3), NABLA + i, *range(R, R + 3), DELAY, DRIFT,
            *range(B, B + 9), JITTER + i, JITTER_BEFORE + i, *range(KAPPA, KAPPA + 3),
            *range(STEP_D, STEP_D + 3), *range(M_MAIN, M_MAIN + 9), *range(LAG, LAG + 3), S + i, *range(G, G + 3),
        ]  # fmt: skip
        row = rows[:, 3 + i]
        row[:, 0:3] = A_mid_T[:, i]
        row[:, 3:6] = on_d[:, i]
        row[:, 6] = -0.5 * obs.dt
        row[:, 7:10] = turning[:, i]
        row[:, 10] = on_delay[:, i]
        row[:, 11] = on_delay[:, i] * obs.centred
        row[:, 12 + 3 * i : 15 + 3 * i] = theta_dot
        row[:, 21] = 1.0 / dt[:, 0, 0]
        row[:, 22] = -1.0 / dt[:, 0, 0]
        row[:, 23:26] = (turning @ coupling)[:, i] * theta
        # theta' is what zeta shows less what the gyros' errors, noise included, add to it within the step.
        row[:, 26:29] = on_step[:, i]
        for a in range(3):
            row[:, 29 + 3 * a : 32 + 3 * a] = -coupling[i, a] * obs.omega
        row[:, 38:41] = A_mid_T[:, i]
        row[:, 41] = -0.5 * obs.dt * obs.force_m[:, i]
        row[:, 42:45] = -coupling[i]
