"""States of the estimator's linear model by number, and the parameters of its noise (:mod:`stages.estimate.model`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics.units import DEG_PER_HOUR
from schemas.rig import FloatArray
from schemas.trial import IntArray

ZETA, THETA_DOT, PHI, PHI_DOT = 0, 3, 6, 9
D, EPS, DELAY, DRIFT = 12, 15, 18, 19
V, NABLA, R, B, M, JITTER, JITTER_BEFORE, KAPPA, STEP_D, M_MAIN = 20, 23, 26, 29, 38, 47, 50, 53, 56, 59
LAG, S, G = 68, 71, 74
SIZE = 77
GYRO_STATES = np.array([*range(V), *range(M, M + 9)])  # what the attitudes alone can see
COARSE_BIAS = 0.1 * DEG_PER_HOUR  # the main gyro's bias from which on it has states of its own


@dataclass(frozen=True)
class Noise:
    """Parameters of the model; see the module for the states.

    damping, stiffness, std: (3,) flexure. gyro: (3,) rad/sqrt(s) and gyro_walk rad/s/sqrt(s). quasi_static: rad/s^1.5,
    of Phi'. velocity: (3,) m/s, of u per step; jitter: (3,) m, of n. accel: (m/s)/sqrt(s), accel_walk m/s^2/sqrt(s).
    The rest are prior sigmas; scale_prior, scale_prior_main: (3, 3), of each unit's scale factors and axes.
    sub_share: the sub-IMU's part of the variance gyro^2. use_velocity: False leaves the accelerometers out.
    """

    damping: FloatArray
    stiffness: FloatArray
    std: FloatArray
    gyro: FloatArray
    gyro_walk: float
    quasi_static: float
    velocity: FloatArray
    jitter: FloatArray
    accel: float
    accel_walk: float
    phi_prior: float
    drift_prior: float
    gyro_bias_prior: float
    delay_prior: float
    clock_prior: float
    accel_bias_prior: float
    lever_prior: float
    coupling_prior: float
    kappa_prior: float
    scale_prior: FloatArray
    scale_prior_main: FloatArray
    main_bias_prior: float
    accel_scale_prior: float
    sub_share: float = 0.5
    use_velocity: bool = True

    @property
    def coarse(self) -> bool:
        """Whether the bias of the main gyro has states."""
        return self.main_bias_prior > COARSE_BIAS

    @property
    def states(self) -> IntArray:
        """Numbers of the states that are estimated."""
        if not self.use_velocity:
            return GYRO_STATES
        return np.arange(SIZE if self.coarse else G)
