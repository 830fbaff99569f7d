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

TOGETHER = 8  # signals side by side in memory, one cache line of them
PIECE = 8192  # samples of each at a time: what they add to the steps stays in the cache
NOTHING = np.zeros((0, 3))


@njit(cache=True, nogil=True)
def _matrix(q):  # type: ignore[no-untyped-def]
    """The rotation (9,), row by row, of a unit quaternion (4,)."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@njit(cache=True, nogil=True, fastmath=FAST)
def _propagate(first, last, middle, end, force, dt, gyro, accel, index, B, step_dt, omega, state, begun, out, at):  # type: ignore[no-untyped-def]
    """alpha' = A gyro, V' = alpha x f + A accel over the samples from ``first`` to before ``last``, as what a signal,
    the one ``at``, adds to (N, 9, K) observations.

    middle: (n, 4) attitude of the sub-IMU's axes half a sample before the samples; end: of the main IMU at them. gyro,
    accel: (n or 0, 3) s-axes. With angle = A^T alpha and speed = A^T V: z is the angle at the ends of the steps, u the
    trapezoid mean of the speed less what the model takes off for the moving lever, q less the mean angle. B: (3, 3)
    coupling; step_dt: (N,), omega: (N, 3) of the steps. state: (5, 3), and begun: (2,), the step and its first sample,
    are carried on. All in scalars, which stay in registers.
    """
    a0, a1, a2 = state[0]
    v0, v1, v2 = state[1]
    sa0, sa1, sa2 = state[2]  # sums over the step; half the speed at its start is in
    sv0, sv1, sv2 = state[3]
    z0, z1, z2 = state[4]  # the angle at the start of the step
    step, since = begun[0], begun[1]
    turns, pushes = len(gyro) > 0, len(accel) > 0
    for k in range(first, last):
        if k > 0:
            h = dt[k]
            m0, m1, m2, m3, m4, m5, m6, m7, m8 = _matrix(middle[k])
            f0, f1, f2 = h * force[k, 0], h * force[k, 1], h * force[k, 2]
            d0, d1, d2 = 0.0, 0.0, 0.0
            if turns:
                g0, g1, g2 = h * gyro[k, 0], h * gyro[k, 1], h * gyro[k, 2]
                d0 = m0 * g0 + m1 * g1 + m2 * g2
                d1 = m3 * g0 + m4 * g1 + m5 * g2
                d2 = m6 * g0 + m7 * g1 + m8 * g2
            b0, b1, b2 = a0 + 0.5 * d0, a1 + 0.5 * d1, a2 + 0.5 * d2
            a0, a1, a2 = a0 + d0, a1 + d1, a2 + d2
            v0, v1, v2 = v0 + b1 * f2 - b2 * f1, v1 + b2 * f0 - b0 * f2, v2 + b0 * f1 - b1 * f0
            if pushes:
                g0, g1, g2 = h * accel[k, 0], h * accel[k, 1], h * accel[k, 2]
                v0 += m0 * g0 + m1 * g1 + m2 * g2
                v1 += m3 * g0 + m4 * g1 + m5 * g2
                v2 += m6 * g0 + m7 * g1 + m8 * g2
        m0, m1, m2, m3, m4, m5, m6, m7, m8 = _matrix(end[k])
        x0, x1, x2 = m0 * a0 + m3 * a1 + m6 * a2, m1 * a0 + m4 * a1 + m7 * a2, m2 * a0 + m5 * a1 + m8 * a2
        s0, s1, s2 = m0 * v0 + m3 * v1 + m6 * v2, m1 * v0 + m4 * v1 + m7 * v2, m2 * v0 + m5 * v1 + m8 * v2
        sa0, sa1, sa2 = sa0 + x0, sa1 + x1, sa2 + x2
        sv0, sv1, sv2 = sv0 + s0, sv1 + s1, sv2 + s2
        if k != index[step]:
            continue
        count = k + 1 if step == 0 else k - since
        out[step, 0, at], out[step, 1, at], out[step, 2, at] = x0, x1, x2
        out[step, 6, at], out[step, 7, at], out[step, 8, at] = -sa0 / count, -sa1 / count, -sa2 / count
        if step == 0:
            out[step, 3, at], out[step, 4, at], out[step, 5, at] = s0, s1, s2
        else:
            h, w0, w1, w2 = step_dt[step], omega[step, 0], omega[step, 1], omega[step, 2]
            r0, r1, r2 = (x0 - z0) / h, (x1 - z1) / h, (x2 - z2) / h
            y0, y1, y2 = 0.5 * (x0 + z0), 0.5 * (x1 + z1), 0.5 * (x2 + z2)
            l0 = B[0, 0] * y0 + B[0, 1] * y1 + B[0, 2] * y2
            l1 = B[1, 0] * y0 + B[1, 1] * y1 + B[1, 2] * y2
            l2 = B[2, 0] * y0 + B[2, 1] * y1 + B[2, 2] * y2
            moved0 = B[0, 0] * r0 + B[0, 1] * r1 + B[0, 2] * r2 + w1 * l2 - w2 * l1
            moved1 = B[1, 0] * r0 + B[1, 1] * r1 + B[1, 2] * r2 + w2 * l0 - w0 * l2
            moved2 = B[2, 0] * r0 + B[2, 1] * r1 + B[2, 2] * r2 + w0 * l1 - w1 * l0
            out[step, 3, at] = (sv0 - 0.5 * s0) / count - moved0
            out[step, 4, at] = (sv1 - 0.5 * s1) / count - moved1
            out[step, 5, at] = (sv2 - 0.5 * s2) / count - moved2
        z0, z1, z2 = x0, x1, x2
        sa0, sa1, sa2 = 0.0, 0.0, 0.0
        sv0, sv1, sv2 = 0.5 * s0, 0.5 * s1, 0.5 * s2
        step, since = step + 1, k
    state[0, 0], state[0, 1], state[0, 2] = a0, a1, a2
    state[1, 0], state[1, 1], state[1, 2] = v0, v1, v2
    state[2, 0], state[2, 1], state[2, 2] = sa0, sa1, sa2
    state[3, 0], state[3, 1], state[3, 2] = sv0, sv1, sv2
    state[4, 0], state[4, 1], state[4, 2] = z0, z1, z2
    begun[0], begun[1] = step, since


class Response:
    """From signals at the samples to (N, 9) on z, u and q, about one set of observations.

    coupling: (3, 3) of flexure into the lever arm, as the model has it.
    """

    def __init__(
        self, obs: Observations, R_m_s: FloatArray, coupling: FloatArray, samples: IntArray | None = None
    ) -> None:
        """samples: (k,) those at which signals are given, ends of the steps among them; all by default."""
        kept = np.arange(len(obs.t)) if samples is None else samples
        self.obs, self.R_m_s, self.coupling = obs, R_m_s, np.ascontiguousarray(coupling)
        self.mounted = left_jacobian(log(R_m_s))
        self.t, self.index = obs.t[kept], np.searchsorted(kept, obs.index)
        self.attitude, velocity = obs.main.attitude[kept], obs.sub.velocity[kept]
        self.dt = np.diff(self.t, prepend=self.t[0])
        self.force = np.zeros_like(velocity)
        self.force[1:] = np.diff(velocity, axis=0) / self.dt[1:, None]
        half = quaternions.multiply(self.attitude[:-1], quaternions.exp(0.5 * self._turned()))
        middle = np.concatenate([self.attitude[:1], half])
        self.middle = quaternions.multiply(middle, quaternions.exp(log(R_m_s))[None, :])

    def _turned(self) -> FloatArray:
        q = self.attitude
        return quaternions.log(quaternions.multiply(quaternions.conjugate(q[:-1]), q[1:]))

    def of_slow(self, interval: float) -> Response:
        """The same for signals that hardly change within ``interval`` s, to be given at fewer instants, ``t``."""
        every = max(1, round(interval / float(np.median(self.dt))))
        kept = np.union1d(np.arange(0, len(self.t), every), self.index)
        return Response(self.obs, self.R_m_s, self.coupling, kept)

    def __call__(self, signals: Signals) -> FloatArray:
        """(N, 9) rad, m/s, rad."""
        return np.ascontiguousarray(self.many([signals])[:, :, 0])

    def many(self, signals: Iterable[Signals]) -> FloatArray:
        """(N, 9, K) of K signals, a few of which are held at a time."""
        left, parts = iter(signals), []
        while some := list(islice(left, TOGETHER)):
            part = np.zeros((len(self.index), 9, len(some)))
            self._sensors(some, part)
            for k, one in enumerate(some):
                self._deck(one, part[:, :, k])
            parts.append(part)
        return np.concatenate(parts, axis=2) if parts else np.zeros((len(self.index), 9, 0))

    def _deck(self, signals: Signals, out: FloatArray) -> None:
        if signals.bending is not None:  # it moves the lever arm as the model says, so that u is left as it is
            out[:, 0:3] += signals.bending[self.index]
        if signals.mount is not None:
            z = signals.mount[self.index] @ self.mounted.T
            out[:, 0:3] += z
            out[:, 3:6] -= lever_velocity(self.obs, self.coupling, z)
        if signals.phins is not None:
            out[:, 6:9] += step_means(signals.phins, self.index)[0]

    def _sensors(self, signals: Sequence[Signals], out: FloatArray) -> None:
        """What they add to gyros and accelerometers, into out (N, 9, k)."""
        obs, last = self.obs, int(self.index[-1]) + 1
        felt = [
            (
                NOTHING if one.gyro is None else np.require(one.gyro, float, ["C", "W"]),
                NOTHING if one.accel is None else np.require(one.accel, float, ["C", "W"]),
                np.zeros((5, 3)), np.zeros(2, dtype=np.int64), k,
            )
            for k, one in enumerate(signals) if one.gyro is not None or one.accel is not None
        ]  # fmt: skip
        for first in range(0, last, PIECE):
            for gyro, accel, state, begun, at in felt:
                _propagate(
                    first, min(first + PIECE, last), self.middle, self.attitude, self.force, self.dt, gyro, accel,
                    self.index, self.coupling, obs.dt, obs.omega, state, begun, out, at,
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
