"""The covariance of the total angle at full rate, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from schemas.rig import FloatArray

KNOWN = 5  # states that the total depends on: the drift d, the delay and its drift
UPPER = np.triu_indices(KNOWN)


@njit(cache=True, nogil=True)
def _carried(attitude: FloatArray, rate: FloatArray, centred: FloatArray, upper: FloatArray, out: FloatArray) -> None:
    J, JP, P = np.empty((3, 5)), np.empty((3, 5)), np.empty((5, 5))
    for k in range(len(attitude)):
        x, y, z, w = attitude[k]
        J[0, 0], J[1, 0], J[2, 0] = 2 * (y * y + z * z) - 1, -2 * (x * y - z * w), -2 * (x * z + y * w)
        J[0, 1], J[1, 1], J[2, 1] = -2 * (x * y + z * w), 2 * (x * x + z * z) - 1, -2 * (y * z - x * w)
        J[0, 2], J[1, 2], J[2, 2] = -2 * (x * z - y * w), -2 * (y * z + x * w), 2 * (x * x + y * y) - 1
        entry = 0
        for a in range(5):
            for b in range(a, 5):
                P[a, b] = P[b, a] = upper[k, entry]
                entry += 1
        for i in range(3):
            J[i, 3] = rate[k, i]
            J[i, 4] = rate[k, i] * centred[k]
            for b in range(5):
                JP[i, b] = 0.0
                for a in range(5):
                    JP[i, b] += J[i, a] * P[a, b]
        for i in range(3):
            for j in range(i, 3):
                value = 0.0
                for a in range(5):
                    value += JP[i, a] * J[j, a]
                out[k, i, j] = out[k, j, i] = value


def carried(attitude: FloatArray, rate: FloatArray, centred: FloatArray, upper: FloatArray) -> FloatArray:
    """(k, 3, 3) J P J^T with J = [-A_m^T, omega, omega centred].

    attitude: (k, 4) of A_m. rate: (k, 3) omega, rad/s. centred: (k,) s. upper: (k, 15) of P at UPPER.
    """
    out = np.empty((len(attitude), 3, 3))
    _carried(attitude, rate, centred, upper, out)
    return out
