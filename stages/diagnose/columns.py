"""What signals on the sensors, the deck or the PHINS add to the observations z, u and q."""

from __future__ import annotations

import numpy as np
from numba import njit

from physics import quaternions
from physics.matching import turned
from physics.rotations import log, skew
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.diagnose.whitening import step_means
from stages.paired import Observations
from twin.effects._prediction import Signals


@njit(cache=True, nogil=True)
def _propagate(middle, end, force, dt, gyro, accel, angle, speed):  # type: ignore[no-untyped-def]
    """alpha' = A gyro, V' = alpha x f + A accel; angle, speed: A^T alpha, A^T V at the samples; gyro, accel in m.

    middle, end: (n, 4) attitude half a sample before the samples, and at them.
    """
    ax = ay = az = vx = vy = vz = 0.0
    back = np.empty(4)
    for k in range(1, len(dt)):
        h = dt[k]
        gx, gy, gz = turned(middle[k], gyro[k, 0], gyro[k, 1], gyro[k, 2])
        bx, by, bz = ax + 0.5 * h * gx, ay + 0.5 * h * gy, az + 0.5 * h * gz
        ax, ay, az = ax + h * gx, ay + h * gy, az + h * gz
        fx, fy, fz = turned(middle[k], accel[k, 0], accel[k, 1], accel[k, 2])
        vx += h * (by * force[k, 2] - bz * force[k, 1] + fx)
        vy += h * (bz * force[k, 0] - bx * force[k, 2] + fy)
        vz += h * (bx * force[k, 1] - by * force[k, 0] + fz)
        back[:3] = -end[k, :3]
        back[3] = end[k, 3]
        angle[k, 0], angle[k, 1], angle[k, 2] = turned(back, ax, ay, az)
        speed[k, 0], speed[k, 1], speed[k, 2] = turned(back, vx, vy, vz)


class Response:
    """From signals at the samples to (N, 9) on z, u and q, about one set of observations.

    coupling: (3, 3) of flexure into the lever arm, as the model has it.
    """

    def __init__(self, obs: Observations, R_m_s: FloatArray, coupling: FloatArray) -> None:
        self.obs, self.R, self.coupling = obs, R_m_s, coupling
        self.mounted = left_jacobian(log(R_m_s))
        self.dt = np.diff(obs.t, prepend=obs.t[0])
        self.force = np.zeros_like(obs.sub.velocity)
        self.force[1:] = np.diff(obs.sub.velocity, axis=0) / self.dt[1:, None]
        half = quaternions.multiply(obs.main.attitude[:-1], quaternions.exp(0.5 * self._turned()))
        self.middle = np.concatenate([obs.main.attitude[:1], half])

    def _turned(self) -> FloatArray:
        q = self.obs.main.attitude
        return quaternions.log(quaternions.multiply(quaternions.conjugate(q[:-1]), q[1:]))

    def __call__(self, signals: Signals) -> FloatArray:
        """(N, 9) rad, m/s, rad."""
        out = np.zeros((len(self.obs.index), 9))
        if signals.gyro is not None or signals.accel is not None:
            self._sensors(signals, out)
        if signals.bending is not None:  # it moves the lever arm as the model says, so that u is left as it is
            out[:, 0:3] += signals.bending[self.obs.index]
        if signals.mount is not None:
            z = signals.mount[self.obs.index] @ self.mounted.T
            out[:, 0:3] += z
            out[:, 3:6] -= lever_velocity(self.obs, self.coupling, z)
        if signals.phins is not None:
            out[:, 6:9] += step_means(signals.phins, self.obs.index)[0]
        return out

    def _sensors(self, signals: Signals, out: FloatArray) -> None:
        nothing = np.zeros_like(self.force)
        gyro = nothing if signals.gyro is None else signals.gyro @ self.R.T
        accel = nothing if signals.accel is None else signals.accel @ self.R.T
        angle, speed = np.zeros_like(self.force), np.zeros_like(self.force)
        gyro, accel = np.ascontiguousarray(gyro), np.ascontiguousarray(accel)
        _propagate(self.middle, self.obs.main.attitude, self.force, self.dt, gyro, accel, angle, speed)
        z = angle[self.obs.index]
        out[:, 0:3] += z
        out[:, 3:6] += trapezoid_means(speed, self.obs.index) - lever_velocity(self.obs, self.coupling, z)
        out[:, 6:9] -= step_means(angle, self.obs.index)[0]


def lever_velocity(obs: Observations, coupling: FloatArray, z: FloatArray) -> FloatArray:
    """B dz/dt + omega x B z over the steps: what the model takes off u for an angle z (N, 3)."""
    rate, mean = np.zeros_like(z), np.zeros_like(z)
    rate[1:] = np.diff(z, axis=0) / obs.dt[1:, None]
    mean[1:] = 0.5 * (z[1:] + z[:-1])
    return np.asarray(rate @ coupling.T + np.cross(obs.omega, mean @ coupling.T))


def left_jacobian(vector: FloatArray) -> FloatArray:
    """J (3, 3) of a rotation vector (3,): Exp(v + e) ~ Exp(J e) Exp(v) for small e."""
    angle, K = float(np.linalg.norm(vector)), skew(vector)
    if angle < 1e-6:
        return np.asarray(np.eye(3) + 0.5 * K)
    return np.asarray(np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * K @ K)


def trapezoid_means(values: FloatArray, index: IntArray) -> FloatArray:
    """Means (N, c) over steps that end at samples ``index``; step 0 is the first sample."""
    total = np.cumsum(values, axis=0)
    out = values[index].copy()
    count = np.diff(index)[:, None]
    ends = 0.5 * (values[index[1:]] + values[index[:-1]])
    inner = total[index[1:]] - total[index[:-1]] - values[index[1:]]
    out[1:] = (inner + ends) / count
    return out
