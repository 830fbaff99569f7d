"""Twins for tests: perfect instruments, and independent ways from attitudes on Earth to attitudes in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from twin import Twin, make_twin

PERFECT = {
    "gyro_bias_dph": [0.0] * 3,
    "gyro_arw": 0.0,
    "gyro_scale_ppm": [0.0] * 3,
    "gyro_nonorthogonality_arcsec": [0.0] * 6,
    "accel_bias_ug": [0.0] * 3,
    "accel_vrw_ug": 0.0,
}
PERFECT_PHINS = {
    "attitude_noise_arcmin": 0.0,
    "attitude_drift_arcmin": [0.0] * 3,
    "installation_main_deg": [0.0] * 3,
    "installation_sub_deg": [0.0] * 3,
    "gyro_arw": 0.0,
    "accel_vrw_ug": 0.0,
}
EARTH_RATE = 7.292115e-5


def perfect(**tables: Any) -> Twin:
    """A twin whose instruments make no errors; tables are laid over it, one level deep."""
    base: dict[str, Any] = {
        "run": {"duration": 30.0, "rate": 100.0},
        "imu": {"main": PERFECT, "sub": PERFECT, "sliding": PERFECT},
        "phins": PERFECT_PHINS,
        "gnss": {"horizontal_std": 0.0, "vertical_std": 0.0},
    }
    for name, table in tables.items():
        base[name] = {**base.get(name, {}), **table} if isinstance(table, dict) else table
    return make_twin(base)


def enu_to_inertial(latitude: np.ndarray, longitude: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(n, 3, 3), columns east, north, up in the inertial frame that the Earth-fixed one passes at t = 0."""
    lon = longitude + EARTH_RATE * t
    zero = np.zeros_like(lon)
    east = np.stack([-np.sin(lon), np.cos(lon), zero], axis=-1)
    up = np.stack([np.cos(latitude) * np.cos(lon), np.cos(latitude) * np.sin(lon), np.sin(latitude)], axis=-1)
    return np.stack([east, np.cross(up, east), up], axis=-1)


def integrate(gyro: np.ndarray, dt: float) -> np.ndarray:
    """Products (n + 1, 3, 3) of the rotation increments, one after the other."""
    steps = Rotation.from_rotvec(gyro * dt).as_matrix()
    out = np.empty((len(gyro) + 1, 3, 3))
    out[0] = np.eye(3)
    for k, step in enumerate(steps):
        out[k + 1] = out[k] @ step
    return out


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Largest rotation angle between two stacks of matrices, rad."""
    difference = np.swapaxes(a, -1, -2) @ b
    skew = np.stack([difference[..., 2, 1], difference[..., 0, 2], difference[..., 1, 0]]) - np.stack(
        [difference[..., 1, 2], difference[..., 2, 0], difference[..., 0, 1]]
    )
    return float(np.abs(skew).max()) / 2.0
