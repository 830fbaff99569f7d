"""The linear matching model and its causal filter.

    z = phi + A_m^T d - omega_m delay + v          d' = A_m eps          eps' = w_eps          delay' = 0

z is the paper's Z seen in m-axes, ``Z = A_m z`` (TD-MA 26, MF 9). Of theta_1, theta_2 and phi_0 only
``d = theta_1 - C theta_2 - phi_0`` is observable, of the two gyros' biases only the difference eps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics.kalman import Filtered, IndexArray, SparseModel, run_filter
from physics.units import ARCMIN, DEG_PER_HOUR
from schemas.products import FlexureModel
from schemas.rig import FloatArray, Rig
from stages.estimate.quaternion_matching.deforming import Deforming
from stages.estimate.quaternion_matching.gaps import drift_variance
from stages.estimate.tuning import grade, stated
from stages.paired import Observations

PHI, PHI_DOT, STATIC, D, EPS, DELAY, SIZE = 0, 3, 6, 9, 12, 15, 16
OUT = np.array([D, D + 1, D + 2, DELAY, STATIC, STATIC + 1, STATIC + 2])

Z_NOISE = 0.004 * ARCMIN  # rad per step: rounding, interpolation, linearisation
BIAS_PRIOR = 0.1 * DEG_PER_HOUR  # of a fibre or laser gyro's bias, where the rig states none
BIAS_WALK = 0.1 / 60.0  # 1/sqrt(s): in-run instability, a tenth of the prior in an hour

Entry = tuple[int, int, FloatArray]  # row, column, value per step
Sparse = tuple[IndexArray, IndexArray, FloatArray]


@dataclass(frozen=True)
class Noise:
    """gyro: rad/sqrt(s) of the difference of both gyros. bias_prior: rad/s. d_prior: (3,) rad.

    delay_prior: s; 0: there is no delay.
    """

    gyro: float
    bias_prior: float
    d_prior: FloatArray
    delay_prior: float


def noise_of(rig: Rig, flexure: FlexureModel, d_prior: FloatArray, delay_prior: float) -> Noise:
    """Gyro noise as identified or stated; the bias prior as stated, else for the grade the noise shows."""
    bias = stated(rig, "gyro_bias_std") or BIAS_PRIOR * grade(flexure.gyro_noise)
    return Noise(float(np.median(flexure.gyro_noise)), bias, d_prior, delay_prior)


def turning_integral(obs: Observations) -> FloatArray:
    """(N, 3, 3) s, integral of A_m over each step."""
    return np.asarray(obs.A_mid * obs.dt[:, None, None])


def drift_walk(obs: Observations, noise: Noise) -> FloatArray:
    """(N, 3) rad^2 that each step adds to d: angle random walk, and what gaps leave open."""
    return noise.gyro**2 * obs.dt[:, None] + drift_variance(obs.jump_s, noise.d_prior)


def build(obs: Observations, z: FloatArray, deforming: Deforming, noise: Noise) -> SparseModel:
    """Sparse model for :mod:`physics.kalman`. z: (N, 3) rad, m-axes, NaN where there is none."""
    columns, rows = _measurement(obs)
    row, col, change = _transition(obs, deforming)
    noise_row, noise_col, added = _process(obs, deforming, noise)
    variance, x0, P0 = np.full((len(obs.dt), 3), Z_NOISE**2), np.zeros(SIZE), np.diag(_prior(deforming, noise) ** 2)
    return SparseModel(row, col, change, noise_row, noise_col, added, columns, rows, z, variance, x0, P0)


def run(obs: Observations, z: FloatArray, deforming: Deforming, noise: Noise) -> Filtered:
    """Causal filter over all steps; covariance rows of OUT are kept."""
    return run_filter(build(obs, z, deforming, noise), OUT)


def _prior(deforming: Deforming, noise: Noise) -> FloatArray:
    ones = np.ones(3)
    return np.concatenate([
        deforming.prior[:, 0], deforming.prior[:, 1], deforming.static_prior, noise.d_prior,
        noise.bias_prior * ones, [noise.delay_prior],
    ])  # fmt: skip


def _transition(obs: Observations, deforming: Deforming) -> Sparse:
    entries: list[Entry] = []
    turning = turning_integral(obs)
    for axis in range(3):
        places = (PHI + axis, PHI_DOT + axis)
        for i, row in enumerate(places):
            entries += [(row, col, deforming.F[axis, :, i, j] - (row == col)) for j, col in enumerate(places)]
        entries += [(D + axis, EPS + j, turning[:, axis, j]) for j in range(3)]
    return _sparse(entries)


def _process(obs: Observations, deforming: Deforming, noise: Noise) -> Sparse:
    entries: list[Entry] = []
    drift = drift_walk(obs, noise)
    for axis, Q in enumerate(deforming.Q):
        phi, rate, static = PHI + axis, PHI_DOT + axis, STATIC + axis
        entries += [(phi, phi, Q[:, 0, 0]), (phi, rate, Q[:, 0, 1]), (rate, rate, Q[:, 1, 1])]
        entries += [(static, static, deforming.static_walk**2 * obs.dt), (D + axis, D + axis, drift[:, axis])]
        entries += [(EPS + axis, EPS + axis, (BIAS_WALK * noise.bias_prior) ** 2 * obs.dt)]
    return _sparse(entries)


def _sparse(entries: list[Entry]) -> Sparse:
    rows, cols, values = zip(*entries)
    return np.array(rows), np.array(cols), np.ascontiguousarray(np.stack(values, axis=1))


def _measurement(obs: Observations) -> tuple[IndexArray, FloatArray]:
    columns = np.array([[PHI + i, STATIC + i, D, D + 1, D + 2, DELAY] for i in range(3)])
    rows = np.ones((len(obs.dt), 3, 6))
    rows[:, :, 2:5] = np.swapaxes(obs.A_end, 1, 2)
    rows[:, :, 5] = -obs.rate_m
    return columns, rows
