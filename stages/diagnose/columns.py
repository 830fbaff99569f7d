"""What signals on the sensors, the deck or the PHINS add to the observations z, u and q."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice

import numpy as np
from numba import njit

from physics import quaternions
from physics.kalman import FAST
from physics.rotations import log, skew
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.diagnose.whitening import step_means
from stages.paired import Observations
from twin.effects._prediction import Signals

TOGETHER = 8  # signals propagated at once: a vector register or two


@njit(cache=True, nogil=True)
def _matrix(q, out):  # type: ignore[no-untyped-def]
    """out (9,) row by row := the rotation of a unit quaternion (4,)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    out[0], out[1], out[2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)
    out[3], out[4], out[5] = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)
    out[6], out[7], out[8] = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)


@njit(cache=True, nogil=True, fastmath=FAST)
def _propagate(middle, end, force, dt, gyro, accel, index, B, step_dt, omega, out):  # type: ignore[no-untyped-def]
    """alpha' = A gyro, V' = alpha x f + A accel, for K signals at once, as what they add to (N, 9, K) observations.

    middle: (n, 4) attitude of the sub-IMU's axes half a sample before the samples; end: of the main IMU at them. gyro:
    (K, n, 3), accel: (K, n or 0, 3), s-axes. With angle = A^T alpha and speed = A^T V: z is the angle at the ends of
    the steps, u the trapezoid mean of the speed less what the model takes off for the moving lever, q less the mean
    angle. B: (3, 3) coupling; step_dt: (N,), omega: (N, 3) of the steps.
    """
    K = len(gyro)
    M, A = np.empty(9), np.empty(9)
    a, v, before = np.zeros((3, K)), np.zeros((3, K)), np.zeros((3, K))
    angle, speed = np.zeros((3, K)), np.zeros((3, K))
    angles, speeds = np.zeros((3, K)), np.zeros((3, K))  # sums over the step; half the speed at its start is in
    step, first = 0, 0
    for k in range(index[-1] + 1):
        if k > 0:
            h = dt[k]
            _matrix(middle[k], M)
            f0, f1, f2 = h * force[k, 0], h * force[k, 1], h * force[k, 2]
            for q in range(K):
                g0, g1, g2 = h * gyro[q, k, 0], h * gyro[q, k, 1], h * gyro[q, k, 2]
                d0 = M[0] * g0 + M[1] * g1 + M[2] * g2
                d1 = M[3] * g0 + M[4] * g1 + M[5] * g2
                d2 = M[6] * g0 + M[7] * g1 + M[8] * g2
                b0, b1, b2 = a[0, q] + 0.5 * d0, a[1, q] + 0.5 * d1, a[2, q] + 0.5 * d2
                a[0, q] += d0
                a[1, q] += d1
                a[2, q] += d2
                v[0, q] += b1 * f2 - b2 * f1
                v[1, q] += b2 * f0 - b0 * f2
                v[2, q] += b0 * f1 - b1 * f0
            if accel.shape[1] > 0:
                for q in range(K):
                    g0, g1, g2 = h * accel[q, k, 0], h * accel[q, k, 1], h * accel[q, k, 2]
                    v[0, q] += M[0] * g0 + M[1] * g1 + M[2] * g2
                    v[1, q] += M[3] * g0 + M[4] * g1 + M[5] * g2
                    v[2, q] += M[6] * g0 + M[7] * g1 + M[8] * g2
            _matrix(end[k], A)
            for i in range(3):
                for q in range(K):
                    angle[i, q] = A[i] * a[0, q] + A[3 + i] * a[1, q] + A[6 + i] * a[2, q]
                    speed[i, q] = A[i] * v[0, q] + A[3 + i] * v[1, q] + A[6 + i] * v[2, q]
                    angles[i, q] += angle[i, q]
                    speeds[i, q] += speed[i, q]
        if k != index[step]:
            continue
        count = k + 1 if step == 0 else k - first
        w0, w1, w2 = omega[step, 0], omega[step, 1], omega[step, 2]
        for q in range(K):
            for i in range(3):
                out[step, i, q] = angle[i, q]
                out[step, 6 + i, q] = -angles[i, q] / count
                out[step, 3 + i, q] = speed[i, q] if step == 0 else (speeds[i, q] - 0.5 * speed[i, q]) / count
            if step > 0:
                x0, x1, x2 = angle[0, q] - before[0, q], angle[1, q] - before[1, q], angle[2, q] - before[2, q]
                y0, y1, y2 = angle[0, q] + before[0, q], angle[1, q] + before[1, q], angle[2, q] + before[2, q]
                m0 = 0.5 * (B[0, 0] * y0 + B[0, 1] * y1 + B[0, 2] * y2)
                m1 = 0.5 * (B[1, 0] * y0 + B[1, 1] * y1 + B[1, 2] * y2)
                m2 = 0.5 * (B[2, 0] * y0 + B[2, 1] * y1 + B[2, 2] * y2)
                h = step_dt[step]
                out[step, 3, q] -= (B[0, 0] * x0 + B[0, 1] * x1 + B[0, 2] * x2) / h + w1 * m2 - w2 * m1
                out[step, 4, q] -= (B[1, 0] * x0 + B[1, 1] * x1 + B[1, 2] * x2) / h + w2 * m0 - w0 * m2
                out[step, 5, q] -= (B[2, 0] * x0 + B[2, 1] * x1 + B[2, 2] * x2) / h + w0 * m1 - w1 * m0
            for i in range(3):
                before[i, q] = angle[i, q]
                angles[i, q] = 0.0
                speeds[i, q] = 0.5 * speed[i, q]
        step, first = step + 1, k


class Response:
    """From signals at the samples to (N, 9) on z, u and q, about one set of observations.

    coupling: (3, 3) of flexure into the lever arm, as the model has it.
    """

    def __init__(self, obs: Observations, R_m_s: FloatArray, coupling: FloatArray) -> None:
        self.obs, self.coupling = obs, np.ascontiguousarray(coupling)
        self.mounted = left_jacobian(log(R_m_s))
        self.dt = np.diff(obs.t, prepend=obs.t[0])
        self.force = np.zeros_like(obs.sub.velocity)
        self.force[1:] = np.diff(obs.sub.velocity, axis=0) / self.dt[1:, None]
        half = quaternions.multiply(obs.main.attitude[:-1], quaternions.exp(0.5 * self._turned()))
        middle = np.concatenate([obs.main.attitude[:1], half])
        self.middle = quaternions.multiply(middle, quaternions.exp(log(R_m_s))[None, :])

    def _turned(self) -> FloatArray:
        q = self.obs.main.attitude
        return quaternions.log(quaternions.multiply(quaternions.conjugate(q[:-1]), q[1:]))

    def __call__(self, signals: Signals) -> FloatArray:
        """(N, 9) rad, m/s, rad."""
        return np.ascontiguousarray(self.many([signals])[:, :, 0])

    def many(self, signals: Iterable[Signals]) -> FloatArray:
        """(N, 9, K) of K signals, a few of which are held at a time."""
        left = iter(signals)
        parts = []
        while some := list(islice(left, TOGETHER)):
            part = np.zeros((len(self.obs.index), 9, len(some)))
            self._sensors(some, part)
            for k, one in enumerate(some):
                self._deck(one, part[:, :, k])
            parts.append(part)
        return np.concatenate(parts, axis=2) if parts else np.zeros((len(self.obs.index), 9, 0))

    def _deck(self, signals: Signals, out: FloatArray) -> None:
        if signals.bending is not None:  # it moves the lever arm as the model says, so that u is left as it is
            out[:, 0:3] += signals.bending[self.obs.index]
        if signals.mount is not None:
            z = signals.mount[self.obs.index] @ self.mounted.T
            out[:, 0:3] += z
            out[:, 3:6] -= lever_velocity(self.obs, self.coupling, z)
        if signals.phins is not None:
            out[:, 6:9] += step_means(signals.phins, self.obs.index)[0]

    def _sensors(self, signals: Sequence[Signals], out: FloatArray) -> None:
        if all(one.gyro is None and one.accel is None for one in signals):
            return
        obs, n = self.obs, len(self.dt)
        gyro = np.zeros((len(signals), n, 3))
        accel = np.zeros((len(signals), n if any(one.accel is not None for one in signals) else 0, 3))
        for k, one in enumerate(signals):
            if one.gyro is not None:
                gyro[k] = one.gyro
            if one.accel is not None:
                accel[k] = one.accel
        _propagate(
            self.middle, obs.main.attitude, self.force, self.dt, gyro, accel, obs.index, self.coupling, obs.dt,
            obs.omega, out,
        )  # fmt: skip


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
