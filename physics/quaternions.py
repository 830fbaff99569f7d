"""Quaternions x, y, z, w in bulk: for long records, where rotation objects cost more than the sums.

Few of them in plain numpy; many compiled, which is loaded only then.

All are unit quaternions with the shape (..., 4); ``multiply(q_a_b, q_b_c)`` is ``q_a_c``, as with matrices.
"""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MANY = 20_000  # numbers beyond which compiled loops pay
VERY_MANY = 2_000_000  # and beyond which it pays to load the compiler for them


def _many(*arrays: FloatArray) -> bool:
    most = max(array.size for array in arrays)
    pays = most > MANY and ("numba" in sys.modules or most > VERY_MANY)
    return pays and all(array.dtype == np.float64 for array in arrays)


def _compiled() -> ModuleType:
    from physics import quaternion_loops

    return quaternion_loops


def multiply(left: FloatArray, right: FloatArray) -> FloatArray:
    """Product (..., 4): the rotation ``right`` followed by the rotation ``left``."""
    if _many(left, right):
        return np.asarray(_compiled().multiply(left, right))
    ax, ay, az, aw = np.moveaxis(left, -1, 0)
    bx, by, bz, bw = np.moveaxis(right, -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def conjugate(q: FloatArray) -> FloatArray:
    """Inverse rotation (..., 4)."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def exp(vector: FloatArray) -> FloatArray:
    """Quaternion (..., 4) of a rotation vector (..., 3) rad, exact at any angle."""
    half = 0.5 * np.asarray(vector, dtype=float)
    angle = np.sqrt((half * half).sum(axis=-1, keepdims=True))
    return np.concatenate([half * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)


def log(q: FloatArray) -> FloatArray:
    """Rotation vector (..., 3) rad, angle within [0, pi], of a unit quaternion (..., 4)."""
    sign = np.where(q[..., 3:] < 0.0, -1.0, 1.0)
    vector, scalar = q[..., :3] * sign, q[..., 3:] * sign
    norm = np.sqrt((vector * vector).sum(axis=-1, keepdims=True))
    small = norm < 1e-8
    scale = np.where(small, 2.0, 2.0 * np.arctan2(norm, scalar) / np.where(small, 1.0, norm))
    return vector * scale


def rotate(q: FloatArray, vector: FloatArray) -> FloatArray:
    """The vector (..., 3) carried by the rotation: ``v_a = R_a_b v_b`` for ``q = q_a_b``."""
    if _many(q, vector):
        return np.asarray(_compiled().rotate(q, vector))
    axis, scalar = q[..., :3], q[..., 3:]
    twice = 2.0 * cross(axis, vector)
    return vector + scalar * twice + cross(axis, twice)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a x b`` of (..., 3) arrays; several times as fast as numpy's."""
    if _many(a, b):
        return np.asarray(_compiled().cross(a, b))
    ax, ay, az = np.moveaxis(a, -1, 0)
    bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def from_euler(heading: FloatArray, pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """Quaternion (..., 4) of ``R_n_b = Rz(heading) Rx(pitch) Ry(roll)``, angles in rad."""
    ch, sh = np.cos(0.5 * heading), np.sin(0.5 * heading)
    cp, sp = np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    cr, sr = np.cos(0.5 * roll), np.sin(0.5 * roll)
    return np.stack(
        [
            ch * sp * cr - sh * cp * sr,
            ch * cp * sr + sh * sp * cr,
            sh * cp * cr + ch * sp * sr,
            ch * cp * cr - sh * sp * sr,
        ],
        axis=-1,
    )
