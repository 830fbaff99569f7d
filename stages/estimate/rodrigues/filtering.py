"""The 24-state filter on a trial: noise, prior, run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics import quaternions
from physics.units import ARCMIN
from schemas.errors import DataError
from schemas.products import Alignment, BoolArray, FlexureModel
from schemas.rig import FloatArray, Rig
from stages.estimate import tuning
from stages.estimate.rodrigues import kernel
from stages.estimate.rodrigues.inputs import Matching

ANGLE_FLOOR = ARCMIN  # of the static angle's prior
START_VELOCITY = 1e-4  # m/s, prior sigma of V_r; what rounding leaves of the start
START_RATE = 1e-6  # rad/s, floor of the rates' noise
LEVER_RATE = 4.0  # 1/s: the velocity noise that makes an error of the lever arm, which recurs with each wave, harmless
FLOOR = 1e-6  # of the correntropy weights: a filter gone astray must be able to come back
FLOOR_PRINTED = 1e-30


@dataclass(frozen=True)
class Tuning:
    """How the filter treats its measurements.

    mpf_weight: A in units of Q^-1 (40), 0 without model prediction. kernel_width: sigma_k (45), 0 without correntropy.
    velocity_noise: m/s, of the velocity match at a perfectly known lever arm. printed: (51), (53) as printed.
    """

    mpf_weight: float = 0.0
    kernel_width: float = 0.0
    velocity_noise: float = 5e-4
    printed: bool = False


@dataclass(frozen=True)
class Filtered:
    """n samples. total: (n, 4) quaternion of R_m_s. theta: (n, 3) rad. covariance: (n, 3, 3) rad^2 of the total.
    innovation, variance: (n, 6), NaN where not measured. x, P: the state (24,) and its covariance at the end."""

    total: FloatArray
    theta: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    variance: FloatArray
    x: FloatArray
    P: FloatArray


@dataclass(frozen=True)
class Setup:
    """What the compiled filter is given beside the data: q (5,), R (6,), x0 (24,), P0 (24, 24)."""

    q: FloatArray
    R: FloatArray
    x0: FloatArray
    P0: FloatArray


def setup(data: Matching, alignment: Alignment, flexure: FlexureModel, rig: Rig, tuned: Tuning) -> Setup:
    """Noise and prior: from the rig where it states them, else by the grade of the gyros."""
    coarse = tuning.grade(flexure.gyro_noise)
    gyro = tuning.stated(rig, "gyro_arw") or max(float(np.median(flexure.gyro_noise)), tuning.FINE_GYRO)
    q = np.concatenate([[gyro**2, tuning.accel_noise(rig, coarse) ** 2], flexure.forcing])
    R = _measurement_noise(data, flexure, gyro, tuned.velocity_noise)
    return Setup(q, R, _start(alignment), _prior(alignment, flexure, rig, coarse))


def _measurement_noise(data: Matching, flexure: FlexureModel, gyro: float, velocity: float) -> FloatArray:
    """(6,) variances. Rates: of the mean of theta' over a sample against its end, ``q T / 3``, and of the gyros."""
    T = float(np.median(data.dt[1:]))
    rates = flexure.forcing * T / 3.0 + gyro**2 / T + START_RATE**2
    rates[:2] = np.max(rates[:2])  # x and y change places as the ship turns
    speed = np.hypot(velocity, LEVER_RATE * float(np.max(data.lever.std)))
    return np.concatenate([np.full(3, speed**2), rates])


def _start(alignment: Alignment) -> FloatArray:
    """(24,): the Rodrigues vector of the static angle, zeros."""
    x = np.zeros(kernel.SIZE)
    angle = float(np.linalg.norm(alignment.static.value))
    x[:3] = alignment.static.value * (np.tan(0.5 * angle) / angle if angle > 0.0 else 0.5)
    return x


def _prior(alignment: Alignment, flexure: FlexureModel, rig: Rig, coarse: float) -> FloatArray:
    """(24, 24). l holds the static angle and theta(0) together: ``l ~ (Phi + theta(0)) / 2``."""
    spread = flexure.std**2
    bias = tuning.stated(rig, "gyro_bias_std") or tuning.FINE_BIAS * coarse
    accel = tuning.stated(rig, "accel_bias_std") or tuning.FINE_ACCEL_BIAS * coarse**tuning.GRADE_EXPONENT
    nothing = np.zeros(3)
    P = np.diag(np.concatenate([
        nothing, nothing, nothing, np.full(3, bias**2), np.full(3, accel**2), np.full(3, START_VELOCITY**2), spread,
        flexure.stiffness * spread,
    ]))  # fmt: skip
    # scaled by (1 + l^2)/2 the Rodrigues vector moves as the angle does
    onto = 0.5 * (1.0 + float(np.sum(_start(alignment)[:3] ** 2)))
    P[:3, :3] = onto**2 * (alignment.covariance + np.diag(spread) + ANGLE_FLOOR**2 * np.eye(3))
    P[:3, kernel.THETA : kernel.THETA + 3] = P[kernel.THETA : kernel.THETA + 3, :3] = onto * np.diag(spread)
    return P


def run(data: Matching, flexure: FlexureModel, given: Setup, tuned: Tuning) -> Filtered:
    """Filter all samples. Raises DataError, with the time, when the filter breaks down, as (51) as printed does."""
    force = np.ascontiguousarray(data.force)  # it comes in several layouts; the filter would be compiled for each
    kept, covariance, innovation, variance, x, P = kernel.run(
        data.dt, data.q_m, data.q_s, data.omega, data.omega_dot, force, data.W_s, data.z, data.sums, data.good,
        data.jump, data.lever_block, flexure.damping, flexure.stiffness, given.q, given.R, given.x0, given.P0,
        tuned.mpf_weight, tuned.kernel_width, FLOOR_PRINTED if tuned.printed else FLOOR, tuned.printed,
    )  # fmt: skip
    lost = _lost(kept, covariance, variance)
    if lost.any():
        raise DataError(
            "the 24-state filter broke down: its covariance is no longer one", time_s=data.t[np.argmax(lost)]
        )
    return Filtered(total(data, kept), kept[:, 6:], covariance, innovation, variance, x, P)


def _lost(kept: FloatArray, covariance: FloatArray, variance: FloatArray) -> BoolArray:
    """(n,) samples with a state that is no number or a variance that is none; variance NaN: not measured."""
    own = np.diagonal(covariance, axis1=1, axis2=2)
    sound = np.isfinite(kept).all(axis=1) & np.isfinite(own).all(axis=1) & (own >= 0.0).all(axis=1)
    return np.asarray(~sound | (variance <= 0.0).any(axis=1))


def total(data: Matching, kept: FloatArray) -> FloatArray:
    """(n, 4) quaternions of ``A_m^T C(l)^T Exp(phi) A_s``; C(l)^T is the quaternion along (l, 1)."""
    l_one = np.concatenate([kept[:, :3], np.ones((len(kept), 1))], axis=1)
    C_T = l_one / np.linalg.norm(l_one, axis=1, keepdims=True)
    sub = quaternions.multiply(quaternions.exp(kept[:, 3:6]), data.q_s)
    return quaternions.multiply(quaternions.conjugate(data.q_m), quaternions.multiply(C_T, sub))
