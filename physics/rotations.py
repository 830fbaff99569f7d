"""Rotations, exact at any angle. Quaternions are x, y, z, w as in scipy; rotation vectors are radians."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]


def exp(vector: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3)."""
    flat = np.asarray(vector, dtype=float).reshape(-1, 3)
    return Rotation.from_rotvec(flat).as_matrix().reshape(*np.shape(vector)[:-1], 3, 3)


def log(matrix: FloatArray) -> FloatArray:
    """Rotation vectors (..., 3), angle within [0, pi], of rotation matrices (..., 3, 3)."""
    flat = np.asarray(matrix, dtype=float).reshape(-1, 3, 3)
    return Rotation.from_matrix(flat).as_rotvec().reshape(*np.shape(matrix)[:-2], 3)


def skew(vector: FloatArray) -> FloatArray:
    """Cross-product matrices (..., 3, 3): ``skew(a) @ b = a x b``."""
    v = np.asarray(vector, dtype=float)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out


def from_euler(heading: FloatArray, pitch: FloatArray, roll: FloatArray) -> FloatArray:
    """``R_n_b = Rz(heading) Rx(pitch) Ry(roll)``, (..., 3, 3), angles in rad of any one shape."""
    angles = np.stack(np.broadcast_arrays(heading, pitch, roll), axis=-1).astype(float)
    matrices = Rotation.from_euler("ZXY", angles.reshape(-1, 3)).as_matrix()
    return matrices.reshape(*angles.shape[:-1], 3, 3)


def to_euler(matrix: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Heading, pitch and roll (rad) of ``R_n_b`` (..., 3, 3); inverse of :func:`from_euler`."""
    flat = np.asarray(matrix, dtype=float).reshape(-1, 3, 3)
    angles = Rotation.from_matrix(flat).as_euler("ZXY").reshape(*np.shape(matrix)[:-2], 3)
    return angles[..., 0], angles[..., 1], angles[..., 2]
