"""Deckflex's own estimators: the fixed-interval smoother and its causal half.

Both gyros are integrated, so that the total angle is known at each instant but for one drifting 3-vector d; the filter
and smoother estimate d together with static angle, delay, lever arm and sensor errors, with specific force matched at
velocity level (:mod:`stages.estimate.model`). The covariance of the answer is that of d and the delay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from physics import quaternions
from physics.units import ARCMIN
from schemas import scratch
from schemas.products import Alignment, Deformation, Estimate, FlexureModel, Innovations, Status
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial
from stages.estimate import model as m
from stages.estimate.solve import Solution, solve
from stages.estimate.spread_covariance import UPPER, carried
from stages.slabs import slabs

CHANNELS = (
    "attitude x", "attitude y", "attitude z", "relative velocity x", "relative velocity y", "relative velocity z",
)  # fmt: skip
WEAK_DELAY_S = 1e-3  # s, one sigma
LOST_DELAY_S = 0.1  # s, one sigma from which it is not observable
WEAK_SHARE = 0.7  # of the prior sigma: a parameter that kept more than this was not really seen
LOST_ANGLE = np.radians(2.0)  # one sigma from which an angle is not observable, and
FAIR_ANGLE = 10.0 * ARCMIN  # up to which it is a plain estimate even where the deck hardly bends


class Smoother:
    """Fixed-interval smoother over gyros and velocity-matched specific force; every sample sees the whole record."""

    name: ClassVar[str] = "smoother"
    source: ClassVar[str] = "deckflex; attitude and velocity matching, modified Bryson-Frazier smoother"
    options: ClassVar[Mapping[str, str]] = {}

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Deformation of a trial; DataError when the units hardly overlap."""
        solution = solve(trial, alignment, flexure)
        return _deformation(self.name, trial, alignment, solution, solution.smoothed.x, solution.smoothed.P)


class CausalFilter:
    """The forward half of the smoother: each sample sees its past alone; noise levels are those of the whole record."""

    name: ClassVar[str] = "filter"
    source: ClassVar[str] = "deckflex; attitude and velocity matching, Kalman filter"
    options: ClassVar[Mapping[str, str]] = {}

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Deformation of a trial; DataError when the units hardly overlap."""
        solution = solve(trial, alignment, flexure)
        return _deformation(self.name, trial, alignment, solution, solution.filtered.x, solution.filtered.P)


def _deformation(
    name: str, trial: Trial, alignment: Alignment, solution: Solution, x: FloatArray, P: FloatArray
) -> Deformation:
    obs = solution.obs
    rows = np.flatnonzero(obs.good)
    total, static, dynamic = (scratch.empty((len(rows), 3)) for _ in range(3))
    covariance, open_angle = scratch.empty((len(rows), 3, 3)), unseen(solution, alignment)
    for part in slabs(len(rows)):
        total[part], static[part], dynamic[part] = _angles(solution, x, rows[part])
        covariance[part] = _covariance(solution, P, rows[part]) + open_angle
        scratch.release(total, static, dynamic, covariance, obs.main.attitude, obs.sub.attitude)
    parameters = _parameters(trial, alignment, solution)
    return Deformation(
        estimator=name,
        stamp=scratch.shelved(trial.epoch + np.rint(obs.t[rows] * 1e9).astype(np.int64)),
        total=total,
        static_part=static,
        dynamic_part=dynamic,
        covariance=covariance,
        alignment=_alignment(alignment, solution, parameters["time_delay"]),
        flexure=solution.flexure,
        innovations=_innovations(solution),
        parameters=parameters,
        used=_used(solution),
    )


def _angles(solution: Solution, x: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log R_m_s, Phi and theta (k, 3) at the samples ``rows``."""
    obs = solution.obs
    total = obs.total_at(rows, x[:, :3], x[:, 3] + x[:, 4] * obs.centred)
    reference = Rotation.from_matrix(solution.at.R_ref).as_quat()
    static = quaternions.multiply(quaternions.exp(obs.spread(x[:, 5:8], obs.t[rows])), reference[None, :])
    # theta = Log(R Exp(-Phi)): the dynamic part acts after the static one.
    dynamic = quaternions.multiply(total, quaternions.conjugate(static))
    return quaternions.log(total), quaternions.log(static), quaternions.log(dynamic)


def _covariance(solution: Solution, P: FloatArray, rows: IntArray) -> FloatArray:
    """(k, 3, 3) rad^2 of the total at samples ``rows``: J P J^T with J = [-A_m^T, omega_s, omega_s centred]."""
    obs = solution.obs
    t = obs.t[rows]
    upper = obs.spread(P[:, UPPER[0], UPPER[1]], t)
    centred = t - 0.5 * (obs.t[0] + obs.t[-1])
    return carried(obs.main.attitude[rows], obs.spread(obs.rate_m, t), centred, upper) * _inflation(solution)


def unseen(solution: Solution, alignment: Alignment) -> FloatArray:
    """(3, 3) rad^2 of the angle that the filter takes for known because the main gyro's noise passes for motion.

    A turn of the angle by e shows as ``e x omega`` for true rates alone. Along an axis where the noise's share of the
    information ``sum |omega|^2 I - omega omega^T`` is w, that share of what the alignment left open is taken to stay,
    as far as the mean rate (the Earth's, for a good gyro) and the bias it may hold do not tell.
    """
    obs = solution.obs
    mean = obs.omega[1:].mean(axis=0)
    rate = obs.omega[1:] - mean
    information = np.sum(rate**2) * np.eye(3) - rate.T @ rate
    told = (mean @ mean * np.eye(3) - np.outer(mean, mean)) / solution.noise.gyro_bias_prior**2
    noise = 2.0 * float(np.sum(_main_noise(solution) ** 2 / obs.dt[1:]))
    share, axes = np.linalg.eigh(noise * np.linalg.inv(information + 1e-9 * noise * np.eye(3)))
    root = (axes * np.sqrt(np.clip(share, 0.0, 1.0))) @ axes.T
    return np.asarray(root @ np.linalg.inv(np.linalg.inv(alignment.covariance) + told) @ root)


def _unseen_delay(solution: Solution, alignment: Alignment) -> float:
    """s^2, likewise of the delay, which shows in the changes of the rate from step to step."""
    obs = solution.obs
    noise = 3.0 * _main_noise(solution) ** 2 / np.median(np.diff(obs.t))
    share = noise / max(float(np.mean(np.sum(np.diff(obs.rate_m, axis=0) ** 2, axis=1))), 1e-300)
    return float(min(share, 1.0) * float(alignment.time_delay.std) ** 2)


def _main_noise(solution: Solution) -> float:
    """rad/sqrt(s), of the main gyro."""
    share = m.main_share(solution.obs, solution.noise)
    return float(np.sqrt(share) * np.median(solution.noise.gyro))


def _inflation(solution: Solution) -> float:
    """Mean square of the standardised attitude innovations where it exceeds one: what the model fails to explain."""
    nis = solution.filtered.innovation[:, :3] ** 2 / solution.filtered.innovation_variance[:, :3]
    return max(1.0, float(np.nanmean(nis)))


def _parameters(trial: Trial, alignment: Alignment, solution: Solution) -> dict[str, Estimate]:
    at, noise = solution.at, solution.noise
    x, P = solution.filtered.x_last, np.diag(solution.filtered.P_last)

    def estimate(base: FloatArray, first: int, count: int, prior: float) -> Estimate:
        std = np.sqrt(np.maximum(P[first : first + count], 0.0))
        weak = bool(np.any(std > WEAK_SHARE * prior))
        status = Status.WEAK if weak else Status.ESTIMATED
        return Estimate(
            base + x[first : first + count], std, status, "the record says little beyond the prior" if weak else ""
        )

    delay = estimate(np.array([at.delay]), m.DELAY, 1, noise.delay_prior)
    spread = np.sqrt(delay.std[0] ** 2 + _unseen_delay(solution, alignment))
    delay = replace(delay, value=delay.value[0], std=spread)
    if delay.std > LOST_DELAY_S:
        reason = "the motion does not show the delay: there is too little of it"
        delay = replace(delay, status=Status.NOT_OBSERVABLE, reason=reason)
    elif delay.std > WEAK_DELAY_S:
        delay = replace(delay, status=Status.WEAK, reason=f"too little motion: {1e3 * delay.std:.1f} ms are left open")
    found = {
        "time_delay": delay,
        "clock_drift": estimate(np.array([at.drift]), m.DRIFT, 1, noise.clock_prior),
        "gyro_bias": estimate(at.R_ref @ at.gyro_bias, m.EPS, 3, noise.gyro_bias_prior),
        "gyro_noise": Estimate(noise.gyro, 0.0 * noise.gyro),
    }
    if noise.use_velocity:
        found["lever_arm"] = estimate(at.lever_arm, m.R, 3, noise.lever_prior)
        found["accel_bias"] = estimate(np.zeros(3), m.NABLA, 3, noise.accel_bias_prior)
        found["lever_jitter"] = Estimate(noise.jitter, np.zeros(3))
    return found


def _alignment(alignment: Alignment, solution: Solution, delay: Estimate) -> Alignment:
    """The alignment as refined: static angle at mid-record, its covariance, and the delay."""
    middle = len(solution.smoothed.x) // 2
    phi = solution.smoothed.x[middle, 5:8]
    P = solution.smoothed.P[middle, 5:, 5:] + unseen(solution, alignment)
    rotation = Rotation.from_rotvec(phi) * Rotation.from_matrix(solution.at.R_ref)
    std = np.sqrt(np.maximum(np.diag(P), 0.0))
    static = Estimate(rotation.as_rotvec(), std, *_static_status(solution, std))
    return replace(alignment, rotation=rotation.as_matrix(), static=static, covariance=P, time_delay=delay)


def _static_status(solution: Solution, std: FloatArray) -> tuple[Status, str]:
    noise = solution.noise
    prior = np.sqrt(noise.phi_prior**2 + np.diag(noise.angle_open))
    if np.any(std > WEAK_SHARE * prior) or np.any(std > LOST_ANGLE):
        return Status.NOT_OBSERVABLE, "the ship hardly turned: the static angle stays as uncertain as it was"
    if np.any(std > np.maximum(3.0 * solution.flexure.std, FAIR_ANGLE)):
        return Status.WEAK, "the motion was weak: the static angle is known worse than the flexure is large"
    return Status.ESTIMATED, ""


def _innovations(solution: Solution) -> Innovations:
    filtered, obs = solution.filtered, solution.obs
    values = filtered.innovation / np.sqrt(filtered.innovation_variance)
    return Innovations(obs.t[obs.index], values, CHANNELS)


def _used(solution: Solution) -> tuple[str, ...]:
    noise = solution.noise
    if not noise.use_velocity:
        return ("gyros of both units", "specific force: not used, it disagreed with the gyros")
    jitter = " ".join(f"{1e3 * v:.2g}" for v in noise.jitter)
    bending = (
        f"quasi-static bending {np.degrees(noise.quasi_static) * 60:.0e} arcmin/s^1.5" if noise.quasi_static else ""
    )
    said = (
        "gyros of both units",
        f"specific force of both units; the lever arm moves by {jitter} mm (x y z) beyond its model",
        bending,
    )
    return tuple(sentence for sentence in said if sentence)
