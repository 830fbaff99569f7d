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
from twin.effects._prediction import OnAxis, Signal, Signals

TOGETHER = 16  # signals side by side in memory: with fewer the compiler makes no vector code
PIECE = 256  # samples of each at a time, which stay in the cache
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


@njit(cache=True, nogil=True)
def _side_by_side(signals, axes, first, count, out):  # type: ignore[no-untyped-def]
    """Samples from ``first`` on of TOGETHER signals into out (PIECE * 3 * TOGETHER,), lane by lane. Signals are (n, 3),
    (n, 1) about the axis that ``axes`` says, or (0, 3) for nothing, which leaves zeros."""
    for q in range(TOGETHER):
        x, axis = signals[q], axes[q]
        if len(x) == 0:
            continue
        if x.shape[1] == 1:
            for k in range(count):
                out[(3 * k + axis) * TOGETHER + q] = x[first + k, 0]
        else:
            for k in range(count):
                for c in range(3):
                    out[(3 * k + c) * TOGETHER + q] = x[first + k, c]


@njit(cache=True, nogil=True, fastmath=FAST)
def _turn(h, m, f, gyro, state):  # type: ignore[no-untyped-def]
    """One sample of alpha' = A gyro and V' = alpha x f; m: (9,) A, f: (3,) times h."""
    m0, m1, m2, m3, m4, m5, m6, m7, m8 = m
    f0, f1, f2 = f
    L = TOGETHER
    for q in range(L):
        g0, g1, g2 = h * gyro[q], h * gyro[L + q], h * gyro[2 * L + q]
        d0 = m0 * g0 + m1 * g1 + m2 * g2
        d1 = m3 * g0 + m4 * g1 + m5 * g2
        d2 = m6 * g0 + m7 * g1 + m8 * g2
        b0, b1, b2 = state[q] + 0.5 * d0, state[L + q] + 0.5 * d1, state[2 * L + q] + 0.5 * d2
        state[q] += d0
        state[L + q] += d1
        state[2 * L + q] += d2
        state[3 * L + q] += b1 * f2 - b2 * f1
        state[4 * L + q] += b2 * f0 - b0 * f2
        state[5 * L + q] += b0 * f1 - b1 * f0


@njit(cache=True, nogil=True, fastmath=FAST)
def _push(h, m, accel, state):  # type: ignore[no-untyped-def]
    """One sample of V' = A accel."""
    m0, m1, m2, m3, m4, m5, m6, m7, m8 = m
    L = TOGETHER
    for q in range(L):
        g0, g1, g2 = h * accel[q], h * accel[L + q], h * accel[2 * L + q]
        state[3 * L + q] += m0 * g0 + m1 * g1 + m2 * g2
        state[4 * L + q] += m3 * g0 + m4 * g1 + m5 * g2
        state[5 * L + q] += m6 * g0 + m7 * g1 + m8 * g2


@njit(cache=True, nogil=True, fastmath=FAST)
def _sum(m, state, seen):  # type: ignore[no-untyped-def]
    """Angle and speed in m-axes, the first six rows of ``seen``, and added to its next six; m: (9,) attitude."""
    m0, m1, m2, m3, m4, m5, m6, m7, m8 = m
    L = TOGETHER
    for q in range(L):
        a0, a1, a2 = state[q], state[L + q], state[2 * L + q]
        v0, v1, v2 = state[3 * L + q], state[4 * L + q], state[5 * L + q]
        x0, x1, x2 = m0 * a0 + m3 * a1 + m6 * a2, m1 * a0 + m4 * a1 + m7 * a2, m2 * a0 + m5 * a1 + m8 * a2
        s0, s1, s2 = m0 * v0 + m3 * v1 + m6 * v2, m1 * v0 + m4 * v1 + m7 * v2, m2 * v0 + m5 * v1 + m8 * v2
        seen[q], seen[L + q], seen[2 * L + q] = x0, x1, x2
        seen[3 * L + q], seen[4 * L + q], seen[5 * L + q] = s0, s1, s2
        seen[6 * L + q] += x0
        seen[7 * L + q] += x1
        seen[8 * L + q] += x2
        seen[9 * L + q] += s0
        seen[10 * L + q] += s1
        seen[11 * L + q] += s2


@njit(cache=True, nogil=True, fastmath=FAST)
def _close(step, count, h, w, B, seen, before, out):  # type: ignore[no-untyped-def]
    """The end of a step of so many samples and h s: its observations (9, K), and the sums begun anew; before: (3 L,)
    angle at its start, w: (3,) rate of the ship, B: (3, 3) coupling."""
    L = TOGETHER
    w0, w1, w2 = w
    for q in range(out.shape[2]):
        x0, x1, x2 = seen[q], seen[L + q], seen[2 * L + q]
        s0, s1, s2 = seen[3 * L + q], seen[4 * L + q], seen[5 * L + q]
        out[step, 0, q], out[step, 1, q], out[step, 2, q] = x0, x1, x2
        for c in range(3):
            out[step, 6 + c, q] = -seen[(6 + c) * L + q] / count
        if step == 0:
            out[step, 3, q], out[step, 4, q], out[step, 5, q] = s0, s1, s2
        else:
            z0, z1, z2 = before[q], before[L + q], before[2 * L + q]
            r0, r1, r2 = (x0 - z0) / h, (x1 - z1) / h, (x2 - z2) / h
            y0, y1, y2 = 0.5 * (x0 + z0), 0.5 * (x1 + z1), 0.5 * (x2 + z2)
            l0 = B[0, 0] * y0 + B[0, 1] * y1 + B[0, 2] * y2
            l1 = B[1, 0] * y0 + B[1, 1] * y1 + B[1, 2] * y2
            l2 = B[2, 0] * y0 + B[2, 1] * y1 + B[2, 2] * y2
            moved0 = B[0, 0] * r0 + B[0, 1] * r1 + B[0, 2] * r2 + w1 * l2 - w2 * l1
            moved1 = B[1, 0] * r0 + B[1, 1] * r1 + B[1, 2] * r2 + w2 * l0 - w0 * l2
            moved2 = B[2, 0] * r0 + B[2, 1] * r1 + B[2, 2] * r2 + w0 * l1 - w1 * l0
            out[step, 3, q] = (seen[9 * L + q] - 0.5 * s0) / count - moved0
            out[step, 4, q] = (seen[10 * L + q] - 0.5 * s1) / count - moved1
            out[step, 5, q] = (seen[11 * L + q] - 0.5 * s2) / count - moved2
    before[:] = seen[: 3 * L]
    seen[6 * L : 9 * L] = 0.0
    seen[9 * L :] = 0.5 * seen[3 * L : 6 * L]


@njit(cache=True, nogil=True, fastmath=FAST)
def _propagate(middle, end, force, dt, gyro, gyro_axes, accel, accel_axes, index, B, step_dt, omega, out):  # type: ignore[no-untyped-def]
    """alpha' = A gyro, V' = alpha x f + A accel over the samples, as what up to TOGETHER signals add to observations
    (N, 9, K), which are set.

    middle: (n, 4) attitude of the sub-IMU's axes half a sample before the samples; end: of the main IMU at them. gyro,
    accel: TOGETHER signals in s-axes, as :func:`_side_by_side` takes them; none of accel: no tuple. With angle = A^T
    alpha and speed = A^T V: z is the angle at the ends of the steps, u the trapezoid mean of the speed less what the
    model takes off for the moving lever, q less the mean angle. B: (3, 3) coupling; step_dt: (N,), omega: (N, 3) of the
    steps. Numbers of the signals lie side by side in flat arrays, which is what the compiler makes vector code of.
    """
    L = TOGETHER
    turns, pushes = np.zeros(PIECE * 3 * L), np.zeros(PIECE * 3 * L)
    pushed = False
    for x in accel:
        pushed = pushed or len(x) > 0
    state, seen, before = np.zeros(6 * L), np.zeros(12 * L), np.zeros(3 * L)
    step, since, last = 0, -1, index[-1] + 1
    for first in range(0, last, PIECE):
        count = min(PIECE, last - first)
        _side_by_side(gyro, gyro_axes, first, count, turns)
        if pushed:
            _side_by_side(accel, accel_axes, first, count, pushes)
        for k in range(first, first + count):
            h, m, at = dt[k], _matrix(middle[k]), 3 * L * (k - first)
            _turn(h, m, (h * force[k, 0], h * force[k, 1], h * force[k, 2]), turns[at : at + 3 * L], state)
            if pushed:
                _push(h, m, pushes[at : at + 3 * L], state)
            _sum(_matrix(end[k]), state, seen)
            if k == index[step]:
                w = omega[step, 0], omega[step, 1], omega[step, 2]
                _close(step, k - since, step_dt[step], w, B, seen, before, out)
                step, since = step + 1, k


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
            if isinstance(signals.phins, OnAxis):
                out[:, 6 + signals.phins.axis] += step_means(signals.phins.values[:, None], self.index)[0][:, 0]
            else:
                out[:, 6:9] += step_means(signals.phins, self.index)[0]

    def _sensors(self, signals: Sequence[Signals], out: FloatArray) -> None:
        """What they do to gyros and accelerometers, as out (N, 9, k)."""
        gyro, accel = [one.gyro for one in signals], [one.accel for one in signals]
        if any(x is not None for x in (*gyro, *accel)):
            obs = self.obs
            _propagate(
                self.middle, self.attitude, self.force, self.dt, *_lanes(gyro), *_lanes(accel), self.index,
                self.coupling, obs.dt, obs.omega, out,
            )  # fmt: skip


def _lanes(signals: Sequence[Signal | None]) -> tuple[tuple[FloatArray, ...], IntArray]:
    """Signals as :func:`_side_by_side` takes them."""
    some, axes = [NOTHING] * TOGETHER, np.zeros(TOGETHER, dtype=np.int64)
    for q, x in enumerate(signals):
        if isinstance(x, OnAxis):
            some[q], axes[q] = np.require(x.values, float, ["C", "W"])[:, None], x.axis
        elif x is not None:
            some[q] = np.require(x, float, ["C", "W"])
    return tuple(some), axes


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
