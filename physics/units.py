"""Conversion factors: multiply a figure in the named unit to get SI (radians, seconds, metres)."""

from __future__ import annotations

import math

DEG = math.pi / 180.0
ARCMIN = DEG / 60.0
ARCSEC = ARCMIN / 60.0
DEG_PER_HOUR = DEG / 3600.0
DEG_PER_SQRT_HOUR = DEG / 60.0
PPM = 1e-6
STANDARD_GRAVITY = 9.80665
MICRO_G = 1e-6 * STANDARD_GRAVITY
KNOT = 1852.0 / 3600.0
NS = 1e-9
