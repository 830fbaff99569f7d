"""Columns through a second-order process beside a random walk: rows divided by the Cholesky factor of their covariance.

The factor is never written out: the rows of its inverse are the innovations of the filter of three states, which takes
as many steps as there are rows.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from physics.kalman_loops import FAST


@njit(cache=True, nogil=True, fastmath=FAST)
def innovations(F, Q, P0, level, walk, seen, R, Y):  # type: ignore[no-untyped-def]
    """Y (n, c) in place: innovations of its columns over their standard deviation. Returns ln det of the covariance.

    State: theta, theta' with F, Q (n, 2, 2) over the step before each row and P0 (2, 2) at the first, and a random walk
    of variance ``level`` that grows by walk (n,). Seen is theta (``seen`` 0) or theta' (1), and the walk, with noise of
    variance R (n,). A row whose first entry is NaN was not seen, and becomes zeros. NaN where no such noise can be.
    """
    n, c = Y.shape
    x = np.zeros((3, c))
    gain = np.empty(3)
    log_det = 0.0
    p00, p01, p11 = P0[0, 0], P0[0, 1], P0[1, 1]
    p02, p12, p22 = 0.0, 0.0, level
    for k in range(n):
        a, b, d, e = F[k, 0, 0], F[k, 0, 1], F[k, 1, 0], F[k, 1, 1]
        q00, q01, q11 = a * p00 + b * p01, a * p01 + b * p11, d * p01 + e * p11
        r0, r1 = d * p00 + e * p01, a * p02 + b * p12
        p12 = d * p02 + e * p12
        p02 = r1
        p00 = a * q00 + b * q01 + Q[k, 0, 0]
        p01 = a * r0 + b * q11 + Q[k, 0, 1]
        p11 = d * r0 + e * q11 + Q[k, 1, 1]
        p22 += walk[k]
        for j in range(c):
            first = a * x[0, j] + b * x[1, j]
            x[1, j] = d * x[0, j] + e * x[1, j]
            x[0, j] = first
        if np.isnan(Y[k, 0]):
            for j in range(c):
                Y[k, j] = 0.0
            continue
        if seen == 0:
            h0, h1, h2 = p00 + p02, p01 + p12, p02 + p22
            S = h0 + h2 + R[k]
        else:
            h0, h1, h2 = p01 + p02, p11 + p12, p12 + p22
            S = h1 + h2 + R[k]
        if not S > 0.0:
            return np.nan
        log_det += np.log(S)
        root = 1.0 / np.sqrt(S)
        gain[0], gain[1], gain[2] = h0 / S, h1 / S, h2 / S
        for j in range(c):
            off = Y[k, j] - x[seen, j] - x[2, j]
            x[0, j] += gain[0] * off
            x[1, j] += gain[1] * off
            x[2, j] += gain[2] * off
            Y[k, j] = off * root
        p00 -= h0 * gain[0]
        p01 -= h0 * gain[1]
        p11 -= h1 * gain[1]
        p02 -= h0 * gain[2]
        p12 -= h1 * gain[2]
        p22 -= h2 * gain[2]
    return log_det
