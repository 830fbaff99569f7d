"""Rotations in bulk, compiled: scipy's are right but too slow for a reality at 400 Hz."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, sin, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Turns:
    """n rotations (or one, that goes with any number) as unit quaternions (n, 4) w, x, y, z."""

    q: FloatArray

    @classmethod
    def of_vectors(cls, vectors: FloatArray) -> Turns:
        """Exp of rotation vectors (n, 3) or (3,) rad."""
        return cls(_of_vectors(np.ascontiguousarray(np.atleast_2d(vectors), dtype=float)))

    @classmethod
    def about(cls, axis: int, angle: FloatArray) -> Turns:
        """Rotations about a coordinate axis by angles (n,) rad."""
        q = np.zeros((len(angle), 4))
        q[:, 0], q[:, 1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
        return cls(q)

    @property
    def inverse(self) -> Turns:
        """The rotations back."""
        return Turns(self.q * np.array([1.0, -1.0, -1.0, -1.0]))

    def __matmul__(self, other: Turns) -> Turns:
        return Turns(_product(self.q, other.q))

    def __getitem__(self, part: slice) -> Turns:
        return Turns(np.ascontiguousarray(self.q[part]))

    def __len__(self) -> int:
        return len(self.q)

    def apply(self, vectors: FloatArray) -> FloatArray:
        """Vectors (n, 3) turned."""
        return _applied(self.q, np.ascontiguousarray(vectors))

    @property
    def vectors(self) -> FloatArray:
        """Rotation vectors (n, 3) rad, angle within [0, pi]."""
        return _vectors(self.q)

    @property
    def xyzw(self) -> FloatArray:
        """Quaternions (n, 4) in the order of logs."""
        return np.ascontiguousarray(self.q[:, [1, 2, 3, 0]])


@njit(cache=True)
def _of_vectors(v: FloatArray) -> FloatArray:  # pragma: no cover
    out = np.empty((len(v), 4))
    for k in range(len(v)):
        angle = sqrt(v[k, 0] ** 2 + v[k, 1] ** 2 + v[k, 2] ** 2)
        scale = 0.5 - angle * angle / 48.0 if angle < 1e-3 else sin(0.5 * angle) / angle
        out[k, 0] = cos(0.5 * angle)
        for i in range(3):
            out[k, 1 + i] = scale * v[k, i]
    return out


@njit(cache=True)
def _product(a: FloatArray, b: FloatArray) -> FloatArray:  # pragma: no cover
    n = max(len(a), len(b))
    out = np.empty((n, 4))
    for k in range(n):
        p, q = a[k if len(a) > 1 else 0], b[k if len(b) > 1 else 0]
        out[k, 0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
        out[k, 1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
        out[k, 2] = p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3]
        out[k, 3] = p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1]
    return out


@njit(cache=True)
def _applied(q: FloatArray, v: FloatArray) -> FloatArray:  # pragma: no cover
    n = max(len(q), len(v))
    out = np.empty((n, 3))
    for k in range(n):
        p, u = q[k if len(q) > 1 else 0], v[k if len(v) > 1 else 0]
        w, x, y, z = p[0], p[1], p[2], p[3]
        out[k, 0] = (1 - 2 * (y * y + z * z)) * u[0] + 2 * (x * y - w * z) * u[1] + 2 * (x * z + w * y) * u[2]
        out[k, 1] = 2 * (x * y + w * z) * u[0] + (1 - 2 * (x * x + z * z)) * u[1] + 2 * (y * z - w * x) * u[2]
        out[k, 2] = 2 * (x * z - w * y) * u[0] + 2 * (y * z + w * x) * u[1] + (1 - 2 * (x * x + y * y)) * u[2]
    return out


@njit(cache=True)
def _vectors(q: FloatArray) -> FloatArray:  # pragma: no cover
    out = np.empty((len(q), 3))
    for k in range(len(q)):
        sign = -1.0 if q[k, 0] < 0.0 else 1.0
        length = sqrt(q[k, 1] ** 2 + q[k, 2] ** 2 + q[k, 3] ** 2)
        scale = 2.0 if length < 1e-12 else 2.0 * atan2(length, sign * q[k, 0]) / length
        for i in range(3):
            out[k, i] = sign * scale * q[k, 1 + i]
    return out
