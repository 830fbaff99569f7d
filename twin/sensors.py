"""Errors of inertial units and of PHINS attitudes, and the other instruments. Inputs are ideal samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from physics import quaternions, rotations
from physics.units import ARCMIN, ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G, PPM
from schemas.trial import GnssSeries, ScalarSeries
from twin.config import Imu, Phins
from twin.scene import Scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def gyro_matrix(scale_ppm: Sequence[float], nonorthogonality_arcsec: Sequence[float]) -> FloatArray:
    """I + S + N (3, 3) with the order xy xz yx yz zx zy, xy being the y-rate seen on x."""
    xy, xz, yx, yz, zx, zy = (value * ARCSEC for value in nonorthogonality_arcsec)
    skewed = np.array([[0.0, xy, xz], [yx, 0.0, yz], [zx, zy, 0.0]])
    return np.eye(3) + np.diag(scale_ppm) * PPM + skewed


def spoil_gyro(gyro: FloatArray, belief: Imu, rate: float, rng: np.random.Generator) -> FloatArray:
    """(I + S + N) omega + b + n, n white with standard deviation ARW sqrt(rate); (n, 3) rad/s."""
    matrix = gyro_matrix(belief.gyro_scale_ppm, belief.gyro_nonorthogonality_arcsec)
    noise = belief.gyro_arw * DEG_PER_SQRT_HOUR * np.sqrt(rate) * rng.standard_normal(gyro.shape)
    return gyro @ matrix.T + np.array(belief.gyro_bias_dph) * DEG_PER_HOUR + noise


def spoil_accel(accel: FloatArray, belief: Imu, rate: float, rng: np.random.Generator) -> FloatArray:
    """f + b + n, n white with standard deviation VRW sqrt(rate); (n, 3) m/s^2."""
    noise = belief.accel_vrw_ug * MICRO_G * np.sqrt(rate) * rng.standard_normal(accel.shape)
    return accel + np.array(belief.accel_bias_ug) * MICRO_G + noise


def outliers(n: int, rate: float, per_minute: float, size_deg: float, rng: np.random.Generator) -> FloatArray:
    """Single-sample outliers (n, 3) rad/s of half to one and a half the size, either sign, each on one random axis."""
    out = np.zeros((n, 3))
    count = rng.poisson(per_minute / 60.0 * n / rate)
    size = size_deg * DEG * rng.uniform(0.5, 1.5, count) * rng.choice([-1.0, 1.0], count)
    out[rng.integers(0, n, count), rng.integers(0, 3, count)] = size
    return out


def markov(n: int, step: float, std: Sequence[float], tau: float, rng: np.random.Generator) -> FloatArray:
    """Stationary first-order Gauss-Markov x_k = a x_{k-1} + sqrt(1 - a^2) sigma n_k, a = exp(-step/tau); (n, k)."""
    a = np.exp(-step / tau)
    noise = rng.standard_normal((n, len(std)))
    noise[1:] *= np.sqrt(-np.expm1(-2.0 * step / tau))
    return lfilter([1.0], [1.0, -a], noise, axis=0) * np.asarray(std)


def installation(angles_deg: Sequence[float]) -> FloatArray:
    """``R_imu_phins = Rz(heading) Rx(pitch) Ry(roll)`` (3, 3) from pitch, roll, heading in degrees."""
    pitch, roll, heading = np.array(angles_deg, dtype=float)[:, None] * DEG
    return rotations.from_euler(heading, pitch, roll)[0]


def phins_attitude(
    q_n_imu: FloatArray, angles_deg: Sequence[float], belief: Phins, rate: float, rng: np.random.Generator
) -> FloatArray:
    """Exp(drift) R_n_imu R_imu_phins Exp(noise), quaternions (n, 4).

    The drift is a rotation vector in ENU (pitch's about east, roll's about north, heading's about up), first-order
    Gauss-Markov; the noise is white and in the axes of the unit.
    """
    drift_std = [value * ARCMIN for value in belief.attitude_drift_arcmin]
    drift = markov(len(q_n_imu), 1.0 / rate, drift_std, belief.attitude_drift_tau, rng)
    noise = belief.attitude_noise_arcmin * ARCMIN * rng.standard_normal((len(q_n_imu), 3))
    vector = rotations.log(installation(angles_deg))
    body = quaternions.multiply(quaternions.multiply(q_n_imu, quaternions.exp(vector)), quaternions.exp(noise))
    return quaternions.multiply(quaternions.exp(drift), body)


def gnss(scene: Scene, epoch: int, rng: np.random.Generator) -> GnssSeries:
    """Fixes at the main IMU with white noise."""
    belief, run = scene.twin.gnss, scene.twin.run
    t = np.arange(int(np.ceil(run.duration * belief.rate - 1e-9))) / belief.rate
    motion = scene.motion(t)
    std = np.array([belief.horizontal_std, belief.horizontal_std, belief.vertical_std])
    east, north, up = (std * rng.standard_normal((len(t), 3))).T
    latitude = motion.latitude + north / 6.371e6
    longitude = motion.longitude + east / (6.371e6 * np.cos(motion.latitude))
    longitude = (longitude + np.pi) % (2.0 * np.pi) - np.pi
    covariance = np.broadcast_to(np.diag(std**2), (len(t), 3, 3)).copy()
    return GnssSeries(stamps(t, epoch), latitude, longitude, motion.height + up, covariance)


def temperature(scene: Scene, unit: str, epoch: int, rng: np.random.Generator) -> ScalarSeries:
    """Thermometer of ``main`` or ``sub`` with white noise."""
    belief, run = scene.twin.temperature, scene.twin.run
    t = np.arange(int(np.ceil(run.duration * belief.rate - 1e-9))) / belief.rate
    return ScalarSeries(stamps(t, epoch), scene.temperature(unit, t) + belief.noise * rng.standard_normal(len(t)))


def stamps(t: FloatArray, epoch: int) -> IntArray:
    """Seconds since the epoch as stamps in ns."""
    return epoch + np.rint(t * 1e9).astype(np.int64)


def phins_noise(belief: Phins) -> Imu:
    """The errors of a PHINS's own rates and specific force: noise alone."""
    zero = (0.0, 0.0, 0.0)
    return Imu(
        gyro_bias_dph=zero,
        gyro_arw=belief.gyro_arw,
        gyro_scale_ppm=zero,
        gyro_nonorthogonality_arcsec=(0.0,) * 6,
        accel_bias_ug=zero,
        accel_vrw_ug=belief.accel_vrw_ug,
    )
