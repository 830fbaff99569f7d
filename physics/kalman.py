"""Linear time-varying Kalman filter and fixed-interval smoother with sparse models, compiled.

``x[k] = (I + E[k]) x[k-1] + w[k]``, ``cov w = Q[k]``; ``z[k] = H[k] x[k] + v[k]`` with independent scalar measurements,
taken one after the other (NaN: no measurement). E, Q and H have a fixed pattern and values that change with k, so a
step costs a few sparse rank-one operations instead of dense products. The smoother is the modified Bryson-Frazier
form (G. J. Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18, 1973): it needs no inverse
of a covariance, which matters for nearly noise-free measurements.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]


@dataclass(frozen=True)
class SparseModel:
    """A linear model of n states, N steps, m scalar measurements a step.

    transition: (N, a) values of E at (transition_row, transition_col). noise: (N, b) values of the upper triangle of Q
    at (noise_row, noise_col). measurement: (N, m, c) values of H at columns measurement_col (m, c), padded with zeros.
    z, variance: (N, m). Step 0 is predicted from the prior mean x0 (n,) and covariance P0 (n, n) like any other.
    """

    transition_row: IndexArray
    transition_col: IndexArray
    transition: FloatArray
    noise_row: IndexArray
    noise_col: IndexArray
    noise: FloatArray
    measurement_col: IndexArray
    measurement: FloatArray
    z: FloatArray
    variance: FloatArray
    x0: FloatArray
    P0: FloatArray


@dataclass(frozen=True)
class Filtered:
    """x: (N, n) posterior means. P_out: (N, o, n) rows ``out`` of the posterior covariances.

    innovation, innovation_variance: (N, m), NaN where nothing was measured. gain: (N, m, n). P_last:
    (n, n). log_likelihood: of all measurements.
    """

    out: IndexArray
    x: FloatArray
    P_out: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    gain: FloatArray
    P_last: FloatArray
    log_likelihood: float


@dataclass(frozen=True)
class Smoothed:
    """x: (N, o) smoothed means and P: (N, o, o) covariances of the states ``out``."""

    x: FloatArray
    P: FloatArray


FAST = {"reassoc", "contract"}  # sums may be regrouped; NaN keeps its meaning


@njit(cache=True, nogil=True, fastmath=FAST)
def _predict(P: FloatArray, rows: IndexArray, cols: IndexArray, values: FloatArray, work: FloatArray) -> None:
    """P <- (I + E) P (I + E)^T."""
    n = P.shape[0]
    work[:] = 0.0
    for a in range(len(rows)):
        value = values[a]
        if value != 0.0:
            i, j = rows[a], cols[a]
            for c in range(n):
                work[i, c] += value * P[j, c]
    for i in range(n):
        for j in range(n):
            P[i, j] += work[i, j]
    # The second factor from the right: columns of (I + E) P are combined likewise.
    work[:] = 0.0
    for a in range(len(rows)):
        value = values[a]
        if value != 0.0:
            i, j = rows[a], cols[a]
            for r in range(n):
                work[i, r] += value * P[r, j]
    for i in range(n):
        for j in range(n):
            P[j, i] += work[i, j]


@njit(cache=True, nogil=True, fastmath=FAST)
def _forward(
    e_row: IndexArray,
    e_col: IndexArray,
    E: FloatArray,
    q_row: IndexArray,
    q_col: IndexArray,
    Q: FloatArray,
    h_col: IndexArray,
    H: FloatArray,
    z: FloatArray,
    R: FloatArray,
    x0: FloatArray,
    P0: FloatArray,
    out: IndexArray,
    keep: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float]:
    steps, m = z.shape
    n = len(x0)
    c = h_col.shape[1]
    x = x0.copy()
    P = P0.copy()
    work = np.zeros((n, n))
    hP = np.zeros(n)
    dx = np.zeros(n)
    kept = steps if keep else 0
    xs = np.zeros((kept, n))
    P_out = np.zeros((kept, len(out), n))
    gain = np.zeros((kept, m, n))
    nu = np.full((steps, m), np.nan)
    S = np.full((steps, m), np.nan)
    loglik = 0.0
    for k in range(steps):
        dx[:] = 0.0
        for a in range(len(e_row)):
            dx[e_row[a]] += E[k, a] * x[e_col[a]]
        x += dx
        _predict(P, e_row, e_col, E[k], work)
        for a in range(len(q_row)):
            P[q_row[a], q_col[a]] += Q[k, a]
            if q_row[a] != q_col[a]:
                P[q_col[a], q_row[a]] += Q[k, a]
        for i in range(m):
            if np.isnan(z[k, i]):
                continue
            hP[:] = 0.0
            residual = z[k, i]
            for a in range(c):
                h = H[k, i, a]
                if h != 0.0:
                    col = h_col[i, a]
                    residual -= h * x[col]
                    for j in range(n):
                        hP[j] += h * P[col, j]
            s = R[k, i]
            for a in range(c):
                s += H[k, i, a] * hP[h_col[i, a]]
            nu[k, i] = residual
            S[k, i] = s
            loglik -= 0.5 * (np.log(2.0 * np.pi * s) + residual * residual / s)
            for j in range(n):
                factor = hP[j] / s
                x[j] += factor * residual
                if keep:
                    gain[k, i, j] = factor
                for c2 in range(n):
                    P[j, c2] -= factor * hP[c2]
        for i in range(n):  # rounding must not let P lose its symmetry
            for j in range(i):
                mean = 0.5 * (P[i, j] + P[j, i])
                P[i, j] = mean
                P[j, i] = mean
        if keep:
            xs[k] = x
            for a in range(len(out)):
                P_out[k, a] = P[out[a]]
    return xs, P_out, nu, S, gain, P, loglik


@njit(cache=True, nogil=True, fastmath=FAST)
def _backward(
    e_row: IndexArray,
    e_col: IndexArray,
    E: FloatArray,
    h_col: IndexArray,
    H: FloatArray,
    out: IndexArray,
    xs: FloatArray,
    P_out: FloatArray,
    nu: FloatArray,
    S: FloatArray,
    gain: FloatArray,
    stride: int,
) -> tuple[FloatArray, FloatArray]:
    steps, m = nu.shape
    n = xs.shape[1]
    c = h_col.shape[1]
    o = len(out)
    adjoint = np.zeros(n)
    information = np.zeros((n, n))
    work = np.zeros((n, n))
    Lk = np.zeros(n)
    x_s = np.zeros((steps, o))
    P_s = np.zeros((steps, o, o))
    PL = np.zeros((o, n))
    for k in range(steps - 1, -1, -1):
        for a in range(o):
            value = xs[k, out[a]]
            for j in range(n):
                value -= P_out[k, a, j] * adjoint[j]
            x_s[k, a] = value
        if k % stride == 0 or k == steps - 1:
            PL[:] = P_out[k] @ information
            for a in range(o):
                for b in range(o):
                    value = P_out[k, a, out[b]]
                    for j in range(n):
                        value -= PL[a, j] * P_out[k, b, j]
                    P_s[k, a, b] = value
        else:
            P_s[k] = P_s[k + 1]
        for i in range(m - 1, -1, -1):
            if np.isnan(nu[k, i]):
                continue
            dot = nu[k, i] / S[k, i]
            scale = 1.0 / S[k, i]
            for j in range(n):
                dot += gain[k, i, j] * adjoint[j]
            for j in range(n):
                Lk[j] = 0.0
                for c2 in range(n):
                    Lk[j] += information[j, c2] * gain[k, i, c2]
                scale += Lk[j] * gain[k, i, j]
            for a in range(c):
                h = H[k, i, a]
                if h != 0.0:
                    adjoint[h_col[i, a]] -= h * dot
            for a in range(c):
                h = H[k, i, a]
                if h != 0.0:
                    col = h_col[i, a]
                    for j in range(n):
                        information[col, j] -= h * Lk[j]
                        information[j, col] -= h * Lk[j]
            for a in range(c):
                for b in range(c):
                    information[h_col[i, a], h_col[i, b]] += scale * H[k, i, a] * H[k, i, b]
        # adjoint <- (I + E)^T adjoint, information <- (I + E)^T information (I + E)
        shift = np.zeros(n)
        for a in range(len(e_row)):
            shift[e_col[a]] += E[k, a] * adjoint[e_row[a]]
        adjoint += shift
        _predict(information, e_col, e_row, E[k], work)
    return x_s, P_s


def run_filter(model: SparseModel, out: IndexArray, keep: bool = True) -> Filtered:
    """Filter; ``out`` names the states whose covariance rows are kept, ``keep=False`` keeps the likelihood alone."""
    x, P_out, innovation, S, gain, P_last, log_likelihood = _forward(
        model.transition_row, model.transition_col, model.transition, model.noise_row, model.noise_col, model.noise,
        model.measurement_col, model.measurement, model.z, model.variance, model.x0, model.P0, out, keep,
    )  # fmt: skip
    return Filtered(out, x, P_out, innovation, S, gain, P_last, log_likelihood)


def run_smoother(model: SparseModel, filtered: Filtered, stride: int = 1) -> Smoothed:
    """Smooth what :func:`run_filter` kept: means and covariances of the states ``filtered.out`` given all data.

    stride: covariances are computed at every so many steps and held in between. The states should be chosen so that no
    nearly noise-free measurement is a difference of widely uncertain ones: ``P - P Lambda P`` would lose its digits.
    """
    x, P = _backward(
        model.transition_row, model.transition_col, model.transition, model.measurement_col, model.measurement,
        filtered.out, filtered.x, filtered.P_out, filtered.innovation, filtered.innovation_variance, filtered.gain,
        stride,
    )  # fmt: skip
    return Smoothed(x, P)
