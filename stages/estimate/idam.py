"""The published inertial-frame estimators: `idam`, and `svram` and `woam` with a plain Kalman update.

All three run the 24-state Rodrigues model (:mod:`stages.estimate.rodrigues`); they differ in the identifier that goes
with them (``identifier``, which the pipeline runs beforehand) and in the update.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from physics import quaternions
from physics.rotations import skew
from schemas.products import Alignment, Deformation, Estimate, FlexureModel, Innovations, Status
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.estimate.rodrigues import kernel
from stages.estimate.rodrigues.filtering import Filtered, Tuning, run, setup
from stages.estimate.rodrigues.inputs import Matching, matching

CHANNELS = ("velocity x", "velocity y", "velocity z", "rate x", "rate y", "rate z")
WEAK_SHARE = 3.0  # static angle known worse than this many sigma of the flexure is called weak


@dataclass(frozen=True)
class Idam:
    """24-state Rodrigues model in inertial frames with model prediction and a maximum-correntropy update (IDAM).

    mpf, mce: switch model prediction and correntropy. mpf_weight: A of (40) in units of Q^-1, ill advised below 100
    because the update uses the same measurement again. kernel_width: sigma_k. velocity_noise: m/s, of the velocity
    match at a perfectly known lever arm. as_printed: A = Q^-1, model prediction blind to outliers, kernel and
    covariance (51)-(53) as printed, which break down with a DataError.
    """

    name: ClassVar[str] = "idam"
    source: ClassVar[str] = "Zhao, Xia, Wang, Gao, Electronics 2024, 13, 3555, eqs. 34-78, corrected"
    identifier: ClassVar[str] = "rvm"
    options: ClassVar[Mapping[str, str]] = {
        "mpf": "model prediction (40), (41)",
        "mce": "maximum-correntropy update (50)-(53)",
        "mpf_weight": "weight A of the model error, in units of the inverse process noise",
        "kernel_width": "sigma_k of the correntropy, in standard deviations",
        "velocity_noise": "m/s, of the velocity match at a perfectly known lever arm",
        "as_printed": "equations (39)-(41), (51) and (53) as printed, which cost accuracy",
    }
    mpf: bool = True
    mce: bool = True
    mpf_weight: float = 100.0
    kernel_width: float = 3.0
    velocity_noise: float = 5e-4
    as_printed: bool = False

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Deformation of a trial; DataError when the units hardly overlap."""
        return _estimate(self, trial, alignment, flexure, self.tuning)

    @property
    def tuning(self) -> Tuning:
        """What the options amount to."""
        weight = 1.0 if self.as_printed else self.mpf_weight
        return Tuning(
            mpf_weight=weight if self.mpf else 0.0, kernel_width=self.kernel_width if self.mce else 0.0,
            velocity_noise=self.velocity_noise, printed=self.as_printed,
        )  # fmt: skip


@dataclass(frozen=True)
class Svram:
    """The same 24-state model with a plain Kalman update and the flexure identified by SVR (SVRAM).

    velocity_noise: m/s, of the velocity match at a perfectly known lever arm.
    """

    name: ClassVar[str] = "svram"
    source: ClassVar[str] = "IDAM sec. 5 (SVRAM), corrected"
    identifier: ClassVar[str] = "svr"
    options: ClassVar[Mapping[str, str]] = {"velocity_noise": "m/s, at a perfectly known lever arm"}
    velocity_noise: float = 5e-4

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Deformation of a trial; DataError when the units hardly overlap."""
        return _estimate(self, trial, alignment, flexure, Tuning(velocity_noise=self.velocity_noise))


@dataclass(frozen=True)
class Woam:
    """The same 24-state model with a plain Kalman update and the flexure identified by whale optimisation (WOAM).

    velocity_noise: m/s, of the velocity match at a perfectly known lever arm.
    """

    name: ClassVar[str] = "woam"
    source: ClassVar[str] = "IDAM sec. 5 (WOAM), corrected"
    identifier: ClassVar[str] = "woa"
    options: ClassVar[Mapping[str, str]] = {"velocity_noise": "m/s, at a perfectly known lever arm"}
    velocity_noise: float = 5e-4

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Deformation of a trial; DataError when the units hardly overlap."""
        return _estimate(self, trial, alignment, flexure, Tuning(velocity_noise=self.velocity_noise))


def _estimate(
    method: Idam | Svram | Woam, trial: Trial, alignment: Alignment, flexure: FlexureModel, tuned: Tuning
) -> Deformation:
    data = matching(trial, alignment)
    filtered = run(data, flexure, setup(data, alignment, flexure, trial.rig, tuned), tuned)
    return deformation(method, data, filtered, alignment, flexure)


def deformation(
    method: Idam | Svram | Woam, data: Matching, filtered: Filtered, alignment: Alignment, flexure: FlexureModel
) -> Deformation:
    """The answer at the samples both units measured; the static part is the total without theta."""
    good = data.good
    total = filtered.total[good]
    static = quaternions.multiply(quaternions.exp(-filtered.theta[good]), total)
    innovation = filtered.innovation[data.index] / np.sqrt(filtered.variance[data.index])
    return Deformation(
        estimator=method.name,
        stamp=data.stamp[good],
        total=quaternions.log(total),
        static_part=quaternions.log(static),
        dynamic_part=filtered.theta[good],
        covariance=filtered.covariance[good],
        alignment=_alignment(data, filtered, alignment, flexure),
        flexure=flexure,
        innovations=Innovations(data.t[data.index], innovation, CHANNELS),
        parameters=_parameters(data, filtered, alignment.rotation),
        used=_used(method, data, flexure),
    )


def _alignment(data: Matching, filtered: Filtered, alignment: Alignment, flexure: FlexureModel) -> Alignment:
    """The static angle as known at the end, and its covariance."""
    static = quaternions.multiply(quaternions.exp(-filtered.theta[-1:]), filtered.total[-1:])
    P = _static_covariance(data, filtered)
    std = np.sqrt(np.diag(P))
    weak = bool(np.any(std > WEAK_SHARE * flexure.std))
    status = Status.WEAK if weak else Status.ESTIMATED
    reason = "the motion was weak: the static angle is known worse than the flexure is large" if weak else ""
    found = Estimate(quaternions.log(static)[0], std, status, reason)
    return replace(alignment, rotation=Rotation.from_quat(static[0]).as_matrix(), static=found, covariance=P)


def _static_covariance(data: Matching, filtered: Filtered) -> FloatArray:
    """(3, 3) rad^2 of the total less theta at the end, the total's error by its derivatives in l and phi."""
    l_vector = filtered.x[:3]
    J = np.zeros((3, kernel.SIZE))
    A_m_T = Rotation.from_quat(data.q_m[-1]).as_matrix().T
    C_T = Rotation.from_quat(np.append(l_vector, 1.0)).as_matrix()
    J[:, :3] = A_m_T @ (np.eye(3) + skew(l_vector)) * (2.0 / (1.0 + l_vector @ l_vector))
    J[:, kernel.PHI : kernel.PHI + 3] = A_m_T @ C_T
    J[:, kernel.THETA : kernel.THETA + 3] = -np.eye(3)
    return np.asarray(J @ filtered.P @ J.T)


def _parameters(data: Matching, filtered: Filtered, R: FloatArray) -> dict[str, Estimate]:
    """Lever arm and biases in m-axes; the filter has them in s-axes, R (3, 3) turns them."""

    def of(first: int, before: FloatArray) -> Estimate:
        rows = slice(first, first + 3)
        P = R @ filtered.P[rows, rows] @ R.T
        return Estimate(before + R @ filtered.x[rows], np.sqrt(np.maximum(np.diag(P), 0.0)))

    return {
        "lever_arm": Estimate(data.lever.value, data.lever.std),
        "gyro_bias": of(kernel.EPS, data.bias),
        "accel_bias": of(kernel.NABLA, np.zeros(3)),
    }


def _used(method: Idam | Svram | Woam, data: Matching, flexure: FlexureModel) -> tuple[str, ...]:
    r = " ".join(f"{value:.3f}" for value in data.lever.value)
    return (
        "gyros and specific force of both units, at every sample",
        f"lever arm {r} m, known to {1e3 * float(np.max(data.lever.std)):.1f} mm, not estimated by the filter",
        f"flexure by {flexure.method}; the published method goes with {method.identifier}",
    )
