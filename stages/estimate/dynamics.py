"""How the states of the estimator's model move: sparse entries of the transition and of the process noise, per step."""

from __future__ import annotations

import numpy as np

from physics import flexure
from physics.rotations import skew
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.estimate.states import (
    DELAY,
    DRIFT,
    EPS,
    JITTER,
    JITTER_BEFORE,
    LAG,
    M_MAIN,
    NABLA,
    PHI,
    PHI_DOT,
    STEP_D,
    THETA_DOT,
    ZETA,
    D,
    G,
    M,
    Noise,
    S,
    V,
)  # fmt: skip
from stages.paired import CARRIED_GAP_S, Observations

GAP_ANGLE = 5e-3  # rad, one sigma of a gap of 1 s and more
GAP_JERK = 0.02  # rad/s^3: what a straight line misses of a lively ship's rate in a short gap


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


def transition_entries(obs: Observations, noise: Noise, coupling: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, columns and values (N, a) of E; coupling: (3, 3) B of the lever arm linearised about."""
    E = _Pattern(len(obs.dt))
    _flexure_rows(E, obs, noise)
    if noise.quasi_static > 0.0:
        for axis in range(3):
            E.add(PHI + axis, PHI_DOT + axis, obs.dt)
    E.block(D, EPS, obs.A_integral)
    _scale_rows(E, D, obs.A_integral, obs.omega)
    if noise.use_velocity:
        _velocity_rows(E, obs)
        if noise.coarse:
            _main_bias_rows(E, obs, coupling)
    return E.arrays()


def _velocity_rows(E: _Pattern, obs: Observations) -> None:
    E.block(V, D, -skew(obs.force_i) * obs.dt[:, None, None])
    E.block(V, NABLA, obs.A_integral)
    E.block(V, S, obs.A_integral * obs.force_m[:, None, :])
    E.block(STEP_D, EPS, obs.A_integral)
    _scale_rows(E, STEP_D, obs.A_integral, obs.omega)
    for axis in range(3):
        for restarted in (STEP_D, JITTER, JITTER_BEFORE, LAG):
            E.add(restarted + axis, restarted + axis, -1.0)
        E.add(JITTER_BEFORE + axis, JITTER + axis, 1.0)


def _main_bias_rows(E: _Pattern, obs: Observations, coupling: FloatArray) -> None:
    """Errors of the main gyro where they turn what flexure shows and what the lever arm does."""
    z = np.nan_to_num(obs.z)
    shown = skew(0.5 * (z + np.concatenate([z[:1], z[:-1]])))
    E.block(D, G, obs.A_integral @ shown)
    E.block(STEP_D, G, obs.A_integral @ shown)
    E.block(ZETA, G, np.swapaxes(obs.A_end, 1, 2) @ obs.A_integral @ shown)
    moving = obs.A_integral @ skew(obs.omega @ coupling.T)  # coupling = -[r x], so this is omega x r
    E.block(V, G, moving)
    _scale_rows(E, V, moving, obs.omega, M_MAIN)


def _flexure_rows(E: _Pattern, obs: Observations, noise: Noise) -> None:
    """zeta and theta': theta = zeta - Phi - A_m^T d + omega_s delay stepped on, and put back."""
    A_T = np.swapaxes(obs.A_end, 1, 2)
    before = np.concatenate([A_T[:1], A_T[:-1]])
    rate = obs.rate_m
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
    _scale_rows(E, ZETA, on_eps, obs.omega)


def _scale_rows(E: _Pattern, first: int, on_eps: FloatArray, omega: FloatArray, errors: int = M) -> None:
    """A gyro error M omega acts as a bias does."""
    for row in range(3):
        for i in range(3):
            for j in range(3):
                E.add(first + row, errors + 3 * i + j, on_eps[:, row, i] * omega[:, j])


def process_entries(obs: Observations, noise: Noise) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, columns and values (N, b) of the upper triangle of Q."""
    Q = _Pattern(len(obs.dt))
    _attitude_noise(Q, obs, noise)
    for axis in range(3):
        _, q = _flexure_steps(obs, noise, axis)
        Q.add(ZETA + axis, ZETA + axis, q[:, 0, 0])
        Q.add(ZETA + axis, THETA_DOT + axis, q[:, 0, 1])
        Q.add(THETA_DOT + axis, THETA_DOT + axis, q[:, 1, 1])
        if noise.quasi_static > 0.0:
            Q.add(PHI_DOT + axis, PHI_DOT + axis, noise.quasi_static**2 * obs.dt)
        Q.add(EPS + axis, EPS + axis, noise.gyro_walk**2 * obs.dt)
        Q.add(NABLA + axis, NABLA + axis, noise.accel_walk**2 * obs.dt)
        Q.add(V + axis, V + axis, noise.accel**2 * obs.dt + (2.0 * obs.jump_s) ** 2)
        if noise.use_velocity:
            Q.add(JITTER + axis, JITTER + axis, noise.jitter[axis] ** 2)
            # The mean over a step of a random walk of density q, less its end: variance q dt/3, with the end's -q dt/2.
            Q.add(LAG + axis, LAG + axis, noise.accel**2 * obs.dt / 3.0)
            Q.add(V + axis, LAG + axis, -(noise.accel**2) * obs.dt / 2.0)
    return Q.arrays()


def _attitude_noise(Q: _Pattern, obs: Observations, noise: Noise) -> None:
    """The gyros' noise in d, zeta and the step of d, where the sub-IMU's share of it is all that u feels."""
    A_T = np.swapaxes(obs.A_end, 1, 2)
    white = np.einsum("kij,j,klj->kil", obs.A_mid, noise.gyro**2, obs.A_mid) * obs.dt[:, None, None]
    drift = white + _gap_variance(obs.jump_s, noise)[:, None, None] * np.eye(3)
    seen = A_T @ drift
    for axis in range(3):
        for other in range(3):
            Q.add(ZETA + axis, D + other, seen[:, axis, other])
        for other in range(axis, 3):
            Q.add(ZETA + axis, ZETA + other, (seen @ obs.A_end)[:, axis, other])
            Q.add(D + axis, D + other, drift[:, axis, other])
    if noise.use_velocity:
        share = noise.sub_share
        for axis in range(3):
            for other in range(3):
                Q.add(ZETA + axis, STEP_D + other, share * seen[:, axis, other])
                Q.add(D + axis, STEP_D + other, share * drift[:, axis, other])
            for other in range(axis, 3):
                Q.add(STEP_D + axis, STEP_D + other, share**2 * drift[:, axis, other])


def _gap_variance(jump: FloatArray, noise: Noise) -> FloatArray:
    """Variance of what the bridging of a gap can have missed of the relative rotation.

    The flexure that happened unseen, at most its stationary spread, and what the other unit, turned by the coarse
    alignment, carried across wrongly or, in a short gap, what a straight line misses.
    """
    q = np.max(4 * noise.damping * noise.stiffness * noise.std**2)
    unseen = np.minimum(q * jump**3, 4.0 * np.max(noise.std) ** 2)
    missed = np.where(jump > CARRIED_GAP_S, GAP_ANGLE * np.minimum(jump, 1.0), GAP_JERK * jump**3)
    return np.asarray(unseen + missed**2) * (jump > 0)
