"""A log as a twin's parameters see it: believed sensor errors taken out, and the view that predictions start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from physics import quaternions
from physics.flexure import transition
from physics.rotations import log
from physics.units import ARCMIN, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G, STANDARD_GRAVITY
from schemas.products import FlexureModel
from schemas.rig import FloatArray, ImuGrade, Rig
from schemas.trial import ImuSeries, Trial
from stages.paired import Observations
from twin.config import Imu, Twin
from twin.effects._prediction import LogView
from twin.sensors import gyro_matrix, installation

QUASI_STATIC_LEAST = 1e-6  # arcmin


@dataclass(frozen=True)
class Believed:
    """A log with what the twin says of its sensors taken out; the noise it says stays, stated in the rig.

    lagging: the gyros were found to lag by a low-pass that is taken out, how far exactly is for the regression.
    flexure: (3, 3) damping, stiffness and std of the axes, one a row, as spectra without slow motion show it; or None.
    forces: both units have accelerometers that show gravity.
    """

    trial: Trial
    twin: Twin
    lagging: bool = False
    flexure: FloatArray | None = None
    forces: bool = True

    @property
    def static(self) -> FloatArray:
        """(3,) rad, the static angle that the twin says."""
        return np.array(self.twin.mount.static_arcmin) * ARCMIN

    @property
    def lever_arm(self) -> FloatArray:
        """(3,) m."""
        return np.array(self.twin.mount.lever_arm)


def believed(trial: Trial, twin: Twin, lagging: bool = False, flexure: FloatArray | None = None) -> Believed:
    """Gyros and accelerometers of both units without the biases, scale factors and skew of the twin."""
    main, sub = _corrected(trial.main, twin.imu.main), _corrected(trial.sub, twin.imu.sub)
    phins_main = _turned(trial.phins_main, twin.phins.installation_main_deg)
    phins_sub = _turned(trial.phins_sub, twin.phins.installation_sub_deg)
    rig = replace(trial.rig, main=_grade(trial.rig.main, twin.imu.main), sub=_grade(trial.rig.sub, twin.imu.sub))
    rig = _with_lever(rig, twin)
    trial = replace(trial, main=main, sub=sub, phins_main=phins_main, phins_sub=phins_sub, rig=rig)
    return Believed(trial, twin, lagging, flexure, has_forces(trial))


def arw_of(source: Believed) -> float:
    """Angle random walk of both gyros together, rad/sqrt(s), as the twin says."""
    imu = source.twin.imu
    return float(np.hypot(imu.main.gyro_arw, imu.sub.gyro_arw)) * DEG_PER_SQRT_HOUR


def has_forces(trial: Trial) -> bool:
    """Whether the accelerometers of both units show something of the size of gravity."""
    return all(_shows_gravity(series) for series in (trial.main, trial.sub))


def _shows_gravity(series: ImuSeries) -> bool:
    size = np.linalg.norm(series.accel, axis=1)
    seen = np.isfinite(size)
    return bool(seen.mean() > 0.5) and 0.5 < float(np.median(size[seen])) / STANDARD_GRAVITY < 2.0


def without_dead_forces(trial: Trial) -> Trial:
    """NaN for accelerometers of which there is nothing: zeros would pass for clipped samples."""
    if has_forces(trial):
        return trial
    main, sub = (replace(series, accel=np.full_like(series.accel, np.nan)) for series in (trial.main, trial.sub))
    return replace(trial, main=main, sub=sub)


def level(source: Believed) -> Believed:
    """Gravity along z in place of missing forces: it makes the model finite, and nothing that is looked at moves."""
    one = np.array([0.0, 0.0, STANDARD_GRAVITY])
    trial = source.trial
    main, sub = (replace(series, accel=np.tile(one, (len(series), 1))) for series in (trial.main, trial.sub))
    return replace(source, trial=replace(trial, main=main, sub=sub))


def _corrected(series: ImuSeries, belief: Imu) -> ImuSeries:
    matrix = gyro_matrix(belief.gyro_scale_ppm, belief.gyro_nonorthogonality_arcsec)
    gyro = (series.gyro - np.array(belief.gyro_bias_dph) * DEG_PER_HOUR) @ np.linalg.inv(matrix).T
    return replace(series, gyro=gyro, accel=series.accel - np.array(belief.accel_bias_ug) * MICRO_G)


def _turned(series: ImuSeries | None, angles_deg: Sequence[float]) -> ImuSeries | None:
    """A PHINS in the axes of the IMU beside it: R_n_imu = R_n_phins R_imu_phins^T."""
    if series is None or series.attitude is None:
        return series
    back = quaternions.exp(-log(installation(angles_deg)))
    return replace(series, attitude=quaternions.multiply(series.attitude, back[None, :]))


def _grade(stated: ImuGrade, belief: Imu) -> ImuGrade:
    return replace(stated, gyro_arw=belief.gyro_arw * DEG_PER_SQRT_HOUR, accel_vrw=belief.accel_vrw_ug * MICRO_G)


def _with_lever(rig: Rig, twin: Twin) -> Rig:
    return replace(rig, lever_arm=np.array(twin.mount.lever_arm), lever_arm_std=0.05)


def log_view(
    source: Believed, obs: Observations, R_m_s: FloatArray, theta: FloatArray, flexure: FlexureModel
) -> LogView:
    """The view at the stamps of the observations; R_m_s (3, 3) static, theta (n, 3) rad, flexure as identified."""
    main, t = source.trial.main, obs.t
    stamp = source.trial.seconds(main.stamp)
    omega, force = (_held(stamp, values, t) for values in (main.gyro, main.accel))
    step = float(np.median(np.diff(t)))
    omega_dot = _slope(omega, step)
    r = source.lever_arm
    rigid = np.cross(omega_dot, r) + np.cross(omega, np.cross(omega, r))
    omega_s, force_s = omega @ R_m_s, (force + rigid) @ R_m_s
    return LogView(
        t=t, interval=step, R_m_s=R_m_s, lever_arm=r, omega_m=omega, omega_dot_m=omega_dot, force_m=force,
        omega_s=omega_s, omega_dot_s=_slope(omega_s, step), force_s=force_s, jerk_s=_slope(force_s, step),
        theta=theta, theta_dot=_slope(theta, step), damping=np.array(source.twin.flexure.damping),
        stiffness=np.array(source.twin.flexure.damping) ** 2 + np.array(source.twin.flexure.frequency) ** 2,
        answering=np.stack([flexure.damping, flexure.stiffness]),
        foretold=np.stack(foretold(theta, flexure, step, longest_step(obs))),
        roll=_roll(source.trial, t), temperature_sub=_temperature(source.trial, t),
    )  # fmt: skip


def longest_step(obs: Observations) -> int:
    """Samples in the longest step of the observations."""
    return int(np.diff(obs.index).max())


def foretold(theta: FloatArray, flexure: FlexureModel, step: float, within: int) -> tuple[FloatArray, FloatArray]:
    """Angle and rate (n, 3) of the flexure theta (n, 3) as what they were before each step foretells them.

    The rate at an instant holds the very noise that the innovation of its step is made of: regressed on it, white noise
    looks like damping that lacks, the whole of it, however short the steps (Stratonovich's integral in place of Ito's).
    step: s between samples; within: samples in the longest step.
    """
    before = within + 1  # the central difference looks a sample ahead
    now, out = np.stack([theta, _slope(theta, step)]), np.empty((2, *theta.shape))
    out[:, :before] = now[:, :before]
    for axis, (mu, b2) in enumerate(zip(flexure.damping, flexure.stiffness)):
        out[:, before:, axis] = transition(mu, b2, np.array(before * step)) @ now[:, :-before, axis]
    return out[0], out[1]


def _held(stamp: FloatArray, values: FloatArray, t: FloatArray) -> FloatArray:
    return np.stack([np.interp(t, stamp, column) for column in values.T], axis=1)


def _slope(values: FloatArray, step: float) -> FloatArray:
    """Derivative of interval means at the middle of their interval, central differences."""
    return np.asarray(np.gradient(values, step, axis=0))


def _roll(trial: Trial, t: FloatArray) -> FloatArray | None:
    """(n,) rad: from the PHINS at the main IMU where there is one, else levelled from the main IMU."""
    unit = trial.phins_main
    if unit is not None and unit.attitude is not None:
        R = quaternions.rotate(quaternions.conjugate(unit.attitude), np.array([[0.0, 0.0, 1.0]]))
        return np.interp(t, trial.seconds(unit.stamp), np.arctan2(-R[:, 0], R[:, 2]))
    return None


def _temperature(trial: Trial, t: FloatArray) -> FloatArray | None:
    series = trial.temperature_sub
    return None if series is None else np.interp(t, trial.seconds(series.stamp), series.value)
