"""Body and navigation conventions: from the log's axes to hull axes (x starboard, y bow, z up) and ENU."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from schemas.rig import FloatArray

_DIRECTIONS = {
    "R": (1.0, 0.0, 0.0),
    "L": (-1.0, 0.0, 0.0),
    "F": (0.0, 1.0, 0.0),
    "B": (0.0, -1.0, 0.0),
    "U": (0.0, 0.0, 1.0),
    "D": (0.0, 0.0, -1.0),
}
R_ENU_NAV: dict[str, FloatArray] = {
    "ENU": np.eye(3),
    "NED": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NWU": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
"""``R_enu_nav`` (3, 3) of the navigation frames a driver may state its attitude in."""


def hull_from_log(axes: str | Sequence[Any]) -> FloatArray:
    """``R_hull_log`` (3, 3): v_hull = R_hull_log v_log.

    axes: three letters, what the log's x, y and z point to (Right/Left, Front/Back, Up/Down: "FLU"); or three signed
    names, which log axis points to starboard, bow and up (["-y", "x", "z"] is the same as "FLU"); or the matrix, rows
    starboard, bow, up. Raises ValueError for anything that is not a right-handed rotation.
    """
    if isinstance(axes, str):
        matrix = _from_letters(axes)
    elif len(axes) == 3 and all(isinstance(axis, str) for axis in axes):
        matrix = np.array([_signed_axis(axis) for axis in axes])
    elif len(axes) == 3 and all(not isinstance(row, str) and len(row) == 3 for row in axes):
        matrix = np.array(axes, dtype=float)
    else:
        raise ValueError("give three letters, three signed axes or a 3 by 3 matrix")
    return _proper(matrix)


def _from_letters(code: str) -> FloatArray:
    if len(code) != 3 or any(letter not in _DIRECTIONS for letter in code.upper()):
        raise ValueError(f"{code!r} is not three of the letters R L F B U D, such as RFU, FLU or FRD")
    return np.array([_DIRECTIONS[letter] for letter in code.upper()]).T


def _signed_axis(name: str) -> FloatArray:
    sign = -1.0 if name.startswith("-") else 1.0
    bare = name.removeprefix("-").removeprefix("+")
    if bare not in ("x", "y", "z"):
        raise ValueError(f"{name!r} is not one of x y z -x -y -z")
    return sign * np.eye(3)["xyz".index(bare)]


def _proper(matrix: FloatArray) -> FloatArray:
    """The exact rotation next to the matrix, which must be one to 1e-3."""
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-3):
        raise ValueError("the axes are not perpendicular unit directions")
    if np.linalg.det(matrix) < 0.0:
        raise ValueError("the axes are left-handed; put wrong signs right with gyro_signs and accel_signs")
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)
