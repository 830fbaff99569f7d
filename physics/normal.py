"""Normal equations whose units differ by many powers of ten and whose columns may be nearly one another, or nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

RIDGE = 1e-10  # of a column's own moment: what keeps columns that are nearly one another apart


def solve_normal(A: FloatArray, b: FloatArray) -> FloatArray:
    """A^-1 b of a symmetric A (k, k), positive or nearly so, and b (k,) or (k, m), with the ridge RIDGE."""
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    tied = A / np.outer(size, size) + RIDGE * np.eye(len(size))
    return np.asarray((np.linalg.solve(tied, (b.T / size).T).T / size).T)
