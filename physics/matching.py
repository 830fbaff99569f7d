"""Attitude and velocity matching of two strapdown units, exact at any angle.

Both units are integrated from their own start in their own inertial frame (``A_m(0) = A_s(0) = I``). With
``R_0 ~ R_m_s(0)`` the product ``Y(t) = A_m^T R_0 A_s`` is ``Exp(A_m^T d) R_m_s(t)``: the total deformation, free of
noise, turned by one slowly drifting inertial vector d (``d' = A_m (R eps_s - eps_m)``). Likewise the difference of the
velocities ``V = R_0 int A_s f_s - int A_m f_m`` is the velocity of the sub-IMU relative to the main one, plus errors
that grow with ``-f x d`` and the accelerometer biases. Nothing is differentiated, no angle is taken as small.

Samples are means over the interval that ends at the stamp; rotation increments are then exact, velocity increments
carry the sculling correction for linearly varying rate and force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from physics.compiled import put

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Unit:
    """One unit on a gapless time axis.

    t: (n,) s. gyro: (n, 3) rad/s, accel: (n, 3) m/s^2, means over the interval ending at t. filled: (n,) bool, samples
    that were not measured but put in to bridge a gap.
    """

    t: FloatArray
    gyro: FloatArray
    accel: FloatArray
    filled: BoolArray


@dataclass(frozen=True)
class Strapdown:
    """attitude: (n, 4) quaternion x, y, z, w of A(t). velocity: (n, 3) m/s, int A f dt. Both start at t[0]."""

    t: FloatArray
    attitude: FloatArray
    velocity: FloatArray


def interval_means(values: FloatArray) -> FloatArray:
    """Means over the interval ending at each stamp of a signal (n, 3) sampled at the stamps, by a local cubic.

    Exact for cubics on a uniform grid: ``(-x[k-2] + 13 x[k-1] + 13 x[k] - x[k+1]) / 24``.
    """
    padded = np.concatenate([3 * values[:1] - 3 * values[1:2] + values[2:3], values, values[-1:]])
    padded[-1] = 3 * values[-1] - 3 * values[-2] + values[-3]
    previous = np.concatenate([padded[:1], padded[:-3]])
    means = (-previous + 13 * padded[:-2] + 13 * padded[1:-1] - padded[2:]) / 24
    means[1] = (padded[1] + padded[2]) / 2
    means[0] = values[0]
    return means


def bridge(t: FloatArray, gyro: FloatArray, accel: FloatArray) -> Unit:
    """Put samples into gaps so that the time axis has none; values run linearly across.

    t: (n,) s, strictly increasing. A gap is a step longer than 1.5 nominal (median) intervals.
    """
    step = float(np.median(np.diff(t)))
    missing = np.maximum(np.rint(np.diff(t) / step).astype(int) - 1, 0)
    if not missing.any():
        return Unit(t, gyro, accel, np.zeros(len(t), bool))
    where = np.flatnonzero(missing)
    # New samples stand at nominal distance before the sample that ends the gap: its interval is nominal.
    times = np.concatenate([t[k + 1] - step * np.arange(missing[k], 0, -1) for k in where])
    merged = np.concatenate([t, times])
    order = np.argsort(merged, kind="stable")
    filled = (np.arange(len(merged)) >= len(t))[order]
    axis = merged[order]
    spread = lambda values: np.stack([np.interp(axis, t, values[:, i]) for i in range(values.shape[1])], axis=1)  # noqa: E731
    return Unit(axis, spread(gyro), spread(accel), filled)


@njit(cache=True, nogil=True)
def _exp_quaternion(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-3:  # series: the error of the dropped terms is below 1e-19
        s = 0.5 - angle2 * (1.0 / 48.0 - angle2 * (1.0 / 3840.0 - angle2 / 645120.0))
        return s * x, s * y, s * z, 1.0 - angle2 * (0.125 - angle2 * (1.0 / 384.0 - angle2 / 46080.0))
    angle = np.sqrt(angle2)
    s = np.sin(0.5 * angle) / angle
    return s * x, s * y, s * z, np.cos(0.5 * angle)


@njit(cache=True, nogil=True)
def turned(q: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector turned by a quaternion (4,), inside compiled loops."""
    tx = 2.0 * (q[1] * z - q[2] * y)
    ty = 2.0 * (q[2] * x - q[0] * z)
    tz = 2.0 * (q[0] * y - q[1] * x)
    return (
        x + q[3] * tx + q[1] * tz - q[2] * ty,
        y + q[3] * ty + q[2] * tx - q[0] * tz,
        z + q[3] * tz + q[0] * ty - q[1] * tx,
    )


@njit(cache=True, nogil=True)
def carry_on(
    t: FloatArray, gyro: FloatArray, accel: FloatArray, before: FloatArray, attitude: FloatArray, velocity: FloatArray
) -> None:
    """Fill attitude (n, 4) and velocity (n, 3) from their first rows on; before: (6,) last increments, brought on."""
    q = attitude[0].copy()
    half = np.empty(4)
    ox, oy, oz, ux, uy, uz = before
    for k in range(1, len(t)):
        dt = t[k] - t[k - 1]
        px, py, pz = gyro[k, 0] * dt, gyro[k, 1] * dt, gyro[k, 2] * dt
        dx, dy, dz = accel[k, 0] * dt, accel[k, 1] * dt, accel[k, 2] * dt
        # Sculling for linearly varying rate and force, in axes of the middle of the interval; and for the turning
        # itself: half the rotation leaves phi x (phi x dv) / 24 of it.
        cx, cy, cz = py * dz - pz * dy, pz * dx - px * dz, px * dy - py * dx
        sx = dx + (oy * dz - oz * dy + uy * pz - uz * py) / 12.0 + (py * cz - pz * cy) / 24.0
        sy = dy + (oz * dx - ox * dz + uz * px - ux * pz) / 12.0 + (pz * cx - px * cz) / 24.0
        sz = dz + (ox * dy - oy * dx + ux * py - uy * px) / 12.0 + (px * cy - py * cx) / 24.0
        bx, by, bz, bw = _exp_quaternion(0.5 * px, 0.5 * py, 0.5 * pz)
        _multiply(q, bx, by, bz, bw, half)
        vx, vy, vz = turned(half, sx, sy, sz)
        velocity[k, 0] = velocity[k - 1, 0] + vx
        velocity[k, 1] = velocity[k - 1, 1] + vy
        velocity[k, 2] = velocity[k - 1, 2] + vz
        _multiply(half, bx, by, bz, bw, q)
        norm = 1.0 / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        for c in range(4):
            q[c] *= norm
            attitude[k, c] = q[c]
        ox, oy, oz, ux, uy, uz = px, py, pz, dx, dy, dz
    before[:] = ox, oy, oz, ux, uy, uz


@njit(cache=True, nogil=True)
def _multiply(a: FloatArray, bx: float, by: float, bz: float, bw: float, out: FloatArray) -> None:
    x = a[3] * bx + a[0] * bw + a[1] * bz - a[2] * by
    y = a[3] * by - a[0] * bz + a[1] * bw + a[2] * bx
    z = a[3] * bz + a[0] * by - a[1] * bx + a[2] * bw
    w = a[3] * bw - a[0] * bx - a[1] * by - a[2] * bz
    out[0], out[1], out[2], out[3] = x, y, z, w


def strapdown(unit: Unit) -> Strapdown:
    """Integrate a unit from identity at its first stamp: ``A_k = A_{k-1} Exp(gyro_k dt)``, ``V_k += A f dt``."""
    attitude, velocity = np.zeros((len(unit.t), 4)), np.zeros((len(unit.t), 3))
    attitude[0, 3] = 1.0
    carry_on(unit.t, unit.gyro, unit.accel, first_increments(unit.t, unit.gyro, unit.accel), attitude, velocity)
    return Strapdown(unit.t, attitude, velocity)


def first_increments(t: FloatArray, gyro: FloatArray, accel: FloatArray) -> FloatArray:
    """(6,) increments of angle and velocity before the first interval, where all is as within it."""
    if len(t) < 2:
        return np.zeros(6)
    return np.asarray(np.concatenate([gyro[1], accel[1]]) * (t[1] - t[0]))


@njit(cache=True, nogil=True)
def _log_relative(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Log(A^T B) of quaternions."""
    x = a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1]
    y = a[3] * b[1] + a[0] * b[2] - a[1] * b[3] - a[2] * b[0]
    z = a[3] * b[2] - a[0] * b[1] + a[1] * b[0] - a[2] * b[3]
    w = a[3] * b[3] + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    s = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 / w * (1.0 - s * s / (3.0 * w * w)) if s < 1e-4 else 2.0 * np.arctan2(s, w) / s
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@njit(cache=True, nogil=True)
def _deformation(a_m: FloatArray, a_s: FloatArray, d: FloatArray, shift: FloatArray) -> FloatArray:
    n = len(a_m)
    out = np.empty((n, 4))
    to_m, turn = np.empty(4), np.empty(4)
    for k in range(n):
        for c in range(3):
            to_m[c] = -a_m[k, c]
        to_m[3] = a_m[k, 3]
        x, y, z = turned(to_m, d[k, 0], d[k, 1], d[k, 2])
        turn[0], turn[1], turn[2], turn[3] = _exp_quaternion(shift[k, 0] - x, shift[k, 1] - y, shift[k, 2] - z)
        _multiply(turn, to_m[0], to_m[1], to_m[2], to_m[3], to_m)
        _multiply(to_m, a_s[k, 0], a_s[k, 1], a_s[k, 2], a_s[k, 3], out[k])
    return out


def deformation(a_m: FloatArray, a_s: FloatArray, d: FloatArray, shift: FloatArray) -> FloatArray:
    """``Exp(shift - A_m^T d) A_m^T A_s`` (n, 4) from attitudes (n, 4) and vectors (n, 3)."""
    return np.asarray(_deformation(a_m, a_s, d, shift))


@njit(cache=True, nogil=True)
def _increments(q: FloatArray) -> FloatArray:
    out = np.empty((max(len(q) - 1, 0), 3))
    before, after = np.empty(4), np.empty(4)
    for k in range(len(out)):
        for c in range(4):  # Log(B A^T) is Log(A'^T B') of the inverses
            sign = 1.0 if c == 3 else -1.0
            before[c], after[c] = sign * q[k, c], sign * q[k + 1, c]
        _log_relative(after, before, out[k])
    return out


def increments(q: FloatArray) -> FloatArray:
    """``Log(q[k+1] q[k]^-1)`` (n - 1, 3) of attitudes (n, 4), in the axes they turn into."""
    return np.asarray(_increments(q))


@njit(cache=True, nogil=True)
def _interpolate(
    t: FloatArray, attitude: FloatArray, velocity: FloatArray, at: FloatArray
) -> tuple[FloatArray, FloatArray]:
    n = len(t)
    m = len(at)
    q_out = np.empty((m, 4))
    v_out = np.empty((m, 3))
    tangent = np.empty((4, 3))
    node = np.empty(4)
    weight = np.empty(4)
    k = 0
    for i in range(m):
        while k < n - 2 and t[k + 1] <= at[i]:
            k += 1
        first = min(max(k - 1, 0), n - 4)
        for j in range(4):
            node[j] = t[first + j]
            _log_relative(attitude[k], attitude[first + j], tangent[j])
        for j in range(4):
            weight[j] = 1.0
            for other in range(4):
                if other != j:
                    weight[j] *= (at[i] - node[other]) / (node[j] - node[other])
        x = y = z = 0.0
        v_out[i] = 0.0
        for j in range(4):
            x += weight[j] * tangent[j, 0]
            y += weight[j] * tangent[j, 1]
            z += weight[j] * tangent[j, 2]
            for c in range(3):
                v_out[i, c] += weight[j] * velocity[first + j, c]
        ex, ey, ez, ew = _exp_quaternion(x, y, z)
        _multiply(attitude[k], ex, ey, ez, ew, q_out[i])
    return q_out, v_out


def interpolate(path: Strapdown, at: FloatArray) -> Strapdown:
    """Attitude and velocity at sorted instants (m,), s: a cubic through the four nearest stamps, on the manifold.

    Raises ValueError for instants outside the path or a path of fewer than four stamps.
    """
    if len(path.t) < 4:
        raise ValueError("interpolation needs at least four stamps")
    if len(at) and (at[0] < path.t[0] - 1e-9 or at[-1] > path.t[-1] + 1e-9):
        raise ValueError("instants lie outside the path")
    return Strapdown(at, *_interpolate(path.t, path.attitude, path.velocity, at))


@njit(cache=True, nogil=True)
def _match(
    a_m: FloatArray, v_m: FloatArray, v_s: FloatArray, index: NDArray[np.int64]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    steps = len(index)
    A_end = np.zeros((steps, 3, 3))
    A_mean = np.zeros((steps, 3, 3))
    u_mean = np.zeros((steps, 3))
    matrix = np.zeros((3, 3))
    before = np.zeros((3, 3))
    u = np.zeros(3)
    u_before = np.zeros(3)
    k = 0
    for i in range(index[-1] + 1):
        x, y, z, w = a_m[i, 0], a_m[i, 1], a_m[i, 2], a_m[i, 3]
        matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
        matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
        matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
        for c in range(3):
            u[c] = 0.0
            for r in range(3):
                u[c] += matrix[r, c] * (v_s[i, r] - v_m[i, r])
        if i > 0:
            share = 0.5 / (index[k] - index[k - 1])
            for r in range(3):
                u_mean[k, r] += share * (u[r] + u_before[r])
                for c in range(3):
                    A_mean[k, r, c] += share * (matrix[r, c] + before[r, c])
        if i == index[k]:
            for r in range(3):
                put(A_end[k, r], matrix[r])
                if k == 0:
                    put(A_mean[0, r], matrix[r])
            if k == 0:
                put(u_mean[0], u)
            k += 1
        for r in range(3):
            put(before[r], matrix[r])
        put(u_before, u)
    return A_end, A_mean, u_mean


def step_means(main: Strapdown, sub: Strapdown, index: NDArray[np.int64]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means over steps that end at samples ``index`` (N,).

    A_m at their ends and its mean, both (N, 3, 3), and the mean of the relative velocity
    ``A_m^T (V_s - V_m)``, (N, 3). Means are trapezoidal; step 0 is the first sample.
    """
    return _match(main.attitude, main.velocity, sub.velocity, index)
