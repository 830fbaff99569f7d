"""From the drift d and the delay at the steps to the deformation at every sample.

``R_m_s = Exp(omega_m delay - A_m^T d) Y``: the total needs no deformation state, so what is interpolated between the
steps is slow, and nothing is taken as small.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from physics import quaternions
from physics.kalman import Filtered
from schemas.products import Alignment, Deformation, Estimate, FlexureModel, Innovations
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.estimate.quaternion_matching import linear
from stages.estimate.quaternion_matching.linear import Z_NOISE
from stages.estimate.quaternion_matching.unscented import Trained
from stages.paired import Observations


@dataclass(frozen=True)
class Matched:
    """What a filter found at the steps. d: (N, 3) rad, i-axes. delay: (N,) s, beyond the shift already applied.

    P: (N, 4, 4) of (d, delay). static: (N, 3) rad, static angle on top of ``R_ref`` (3, 3). innovation: (N, 3),
    normalised.
    """

    obs: Observations
    d: FloatArray
    delay: FloatArray
    P: FloatArray
    static: FloatArray
    R_ref: FloatArray
    innovation: FloatArray


def from_linear(
    obs: Observations, filtered: Filtered, R_ref: FloatArray, before: FloatArray
) -> tuple[Matched, Estimate]:
    """What the linear filter found, and the gyro bias, rad/s in m-axes, on top of what was taken out ``before``."""
    x, P = filtered.x, filtered.P_out[:, :4][:, :, linear.OUT[:4]]
    d, eps = slice(linear.D, linear.D + 3), slice(linear.EPS, linear.EPS + 3)
    innovation = filtered.innovation / np.sqrt(filtered.innovation_variance)
    static = x[:, linear.STATIC : linear.STATIC + 3]
    matched = Matched(obs, x[:, d], x[:, linear.DELAY], P, static, R_ref, innovation)
    return matched, _bias(before + x[-1, eps], np.diag(filtered.P_last)[eps])


def from_network(
    obs: Observations, trained: Trained, R_ref: FloatArray, before: FloatArray
) -> tuple[Matched, Estimate]:
    """What the unscented filter found, and the gyro bias, rad/s in m-axes, on top of what was taken out ``before``."""
    x, P = trained.x[:, -7:], trained.P
    kept = np.array([0, 1, 2, 6])
    static = np.zeros((len(x), 3))
    matched = Matched(obs, x[:, :3], x[:, 6], P[:, kept][:, :, kept], static, R_ref, trained.innovation)
    return matched, _bias(before + x[-1, 3:6], np.diag(P[-1])[3:6])


def _bias(value: FloatArray, variance: FloatArray) -> Estimate:
    return Estimate(value, np.sqrt(np.maximum(variance, 0.0)))


def deformation(
    name: str,
    trial: Trial,
    matched: Matched,
    alignment: Alignment,
    flexure: FlexureModel,
    parameters: Mapping[str, Estimate],
    used: tuple[str, ...],
    notes: tuple[str, ...] = (),
) -> Deformation:
    """The answer at every good sample of the main IMU."""
    obs = matched.obs
    total = obs.total(matched.d, matched.delay)[obs.good]
    onto = quaternions.exp(obs.spread(matched.static)[obs.good])
    static = quaternions.multiply(onto, Rotation.from_matrix(matched.R_ref).as_quat())
    return Deformation(
        estimator=name,
        stamp=trial.epoch + np.rint(obs.t[obs.good] * 1e9).astype(np.int64),
        total=quaternions.log(total),
        static_part=quaternions.log(static),
        dynamic_part=quaternions.log(quaternions.multiply(total, quaternions.conjugate(static))),
        covariance=covariance(matched),
        alignment=alignment,
        flexure=flexure,
        innovations=Innovations(obs.t[obs.index], matched.innovation, ("attitude x", "attitude y", "attitude z")),
        parameters=parameters,
        used=used,
        notes=notes,
    )


def covariance(matched: Matched) -> FloatArray:
    """(n, 3, 3) rad^2 of the total at the good samples: J P J^T + R, J = [-A_m^T, omega_m]."""
    obs = matched.obs
    P = obs.spread(matched.P.reshape(-1, 16))[obs.good].reshape(-1, 4, 4)
    J = np.empty((len(P), 3, 4))
    J[:, :, :3] = -np.swapaxes(Rotation.from_quat(obs.main.attitude[obs.good]).as_matrix(), 1, 2)
    J[:, :, 3] = obs.rates()[obs.good]
    full = J @ P @ np.swapaxes(J, 1, 2) + Z_NOISE**2 * np.eye(3)
    return np.asarray(0.5 * (full + np.swapaxes(full, 1, 2)))
