"""The lever arm from the units' relative velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics.rotations import skew
from schemas.rig import FloatArray, Rig
from stages.drift import drift_of_pieces
from stages.paired import Observations

CORRELATION_S = 2.0  # s over which the residual resembles itself
STD_FLOOR = 1e-3  # m
LEAST_STEPS = 50  # with a relative velocity: fewer tell nothing
UNKNOWN = 100.0  # m


@dataclass(frozen=True)
class LeverArm:
    """value, std: (3,) m, main to sub in m-axes."""

    value: FloatArray
    std: FloatArray


def lever_arm(obs: Observations, rig: Rig) -> LeverArm:
    """What the log says, joined with what the rig states, each by its variance. obs: observed with lever arm 0."""
    found = fitted(obs)
    if rig.lever_arm is None:
        return found
    own, stated = 1.0 / found.std**2, 1.0 / rig.lever_arm_std**2
    return LeverArm((own * found.value + stated * rig.lever_arm) / (own + stated), 1.0 / np.sqrt(own + stated))


def fitted(obs: Observations) -> LeverArm:
    """Least squares of the relative velocity, at the steps::

    A_m^T V = omega x r + theta' x r + omega x (theta x r)
              + A_m^T (v_0 - int f dt x d_0 - int (f x int A_m) eps + int A_m nabla)

    theta is what the attitudes show; its constant share is absorbed by r.
    """
    theta, rate = _flexure(obs)
    turning = skew(obs.omega)
    moved = turning + skew(rate) + turning @ skew(theta)
    A_T = np.swapaxes(np.where(np.isfinite(obs.A_mid), obs.A_mid, 0.0), 1, 2)
    turned = np.cumsum(obs.A_mid * obs.dt[:, None, None], axis=0)
    force = skew(obs.force_i) * obs.dt[:, None, None]
    grown = [np.cumsum(force, axis=0), np.cumsum(force @ turned, axis=0), turned]
    columns = np.concatenate([moved, A_T, *(A_T @ g for g in grown)], axis=2)
    seen = np.isfinite(obs.u[:, 0])
    seen &= np.isfinite(rate[:, 0]) & np.isfinite(theta[:, 0])
    seen[:2] = False
    if np.count_nonzero(seen) < LEAST_STEPS:
        return LeverArm(np.zeros(3), np.full(3, UNKNOWN))
    matrix, u = columns[seen].reshape(-1, 15), obs.u[seen].reshape(-1)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    solution, _, _, _ = np.linalg.lstsq(matrix / scale, u, rcond=1e-9)
    residual = u - matrix / scale @ solution
    share = max(CORRELATION_S / float(np.median(obs.dt[1:])), 1.0)
    information = (matrix / scale).T @ (matrix / scale)
    spread = np.sqrt(np.diag(np.linalg.pinv(information))[:3] * np.mean(residual**2) * share) / scale[:3]
    return LeverArm(solution[:3] / scale[:3], np.maximum(spread, STD_FLOOR))


def _flexure(obs: Observations) -> tuple[FloatArray, FloatArray]:
    """Means of theta, but for a constant, and of theta' over each step, (N, 3)."""
    theta = obs.z - drift_of_pieces(obs)
    rate, mean = np.full_like(theta, np.nan), np.full_like(theta, np.nan)
    rate[1:] = np.diff(theta, axis=0) / obs.dt[1:, None]
    mean[1:] = 0.5 * (theta[1:] + theta[:-1])
    return mean, rate
