"""Effects about one axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from twin.effects._parameters import AXES, Axis

FloatArray = NDArray[np.float64]


def along(axis: Axis, values: FloatArray) -> FloatArray:
    """Values (n,) as the component of vectors (n, 3) on an axis, the others zero."""
    out = np.zeros((len(values), 3))
    out[:, AXES.index(axis)] = values
    return out
