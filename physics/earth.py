"""The rotating ellipsoidal Earth (WGS 84): radii, gravity, rates of the local-level frame.

Angles in rad, lengths in m. Vectors are resolved in n (ENU). Latitude and height are geodetic.
Source: NIMA TR8350.2; notation as in P. D. Groves, Principles of GNSS, Inertial and Multisensor Navigation, ch. 2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

RATE = 7.292115e-5  # rad/s, sidereal
SEMI_MAJOR_AXIS = 6378137.0  # m
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
GRAVITATIONAL_CONSTANT = 3.986004418e14  # m^3/s^2, GM with the atmosphere
EQUATORIAL_GRAVITY = 9.7803253359  # m/s^2
SOMIGLIANA_K = 0.00193185265241


def radii(latitude: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Meridian and transverse radii of curvature of the ellipsoid, both with the shape of the latitude."""
    w2 = 1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2
    transverse = SEMI_MAJOR_AXIS / np.sqrt(w2)
    return transverse * (1.0 - ECCENTRICITY_SQUARED) / w2, transverse


def gravity(latitude: FloatArray, height: FloatArray) -> FloatArray:
    """Normal gravity (m/s^2, downwards, > 0): Somigliana on the ellipsoid, second order in height above it."""
    sin2 = np.sin(latitude) ** 2
    surface = EQUATORIAL_GRAVITY * (1.0 + SOMIGLIANA_K * sin2) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * sin2)
    polar_axis = SEMI_MAJOR_AXIS * (1.0 - FLATTENING)
    m = RATE**2 * SEMI_MAJOR_AXIS**2 * polar_axis / GRAVITATIONAL_CONSTANT
    linear = 2.0 * (1.0 + FLATTENING + m - 2.0 * FLATTENING * sin2) / SEMI_MAJOR_AXIS
    return surface * (1.0 - linear * height + 3.0 * height**2 / SEMI_MAJOR_AXIS**2)


def earth_rate(latitude: FloatArray) -> FloatArray:
    """Earth's rate omega_ie_n, (..., 3) rad/s."""
    lat = np.asarray(latitude, dtype=float)
    return np.stack([np.zeros_like(lat), RATE * np.cos(lat), RATE * np.sin(lat)], axis=-1)


def transport_rate(latitude: FloatArray, height: FloatArray, velocity: FloatArray) -> FloatArray:
    """Rate of the local-level frame over the Earth omega_en_n, (..., 3) rad/s, at velocity (..., 3) m/s in ENU."""
    meridian, transverse = radii(latitude)
    east = velocity[..., 0] / (transverse + height)
    return np.stack([-velocity[..., 1] / (meridian + height), east, east * np.tan(latitude)], axis=-1)


def local_level(latitude: FloatArray, longitude: FloatArray) -> FloatArray:
    """Quaternion (..., 4) x, y, z, w of ``R_e_n = Rz(longitude + 90 deg) Rx(90 deg - latitude)``, ENU to Earth-fixed.

    With the longitude counted from an inertial meridian (longitude + RATE t) it is ``R_i_n``.
    """
    half_z = 0.5 * np.asarray(longitude, dtype=float) + 0.25 * np.pi
    half_x = 0.25 * np.pi - 0.5 * np.asarray(latitude, dtype=float)
    cz, sz, cx, sx = np.cos(half_z), np.sin(half_z), np.cos(half_x), np.sin(half_x)
    return np.stack([cz * sx, sz * sx, sz * cx, cz * cx], axis=-1)
