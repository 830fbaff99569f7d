"""The loops of :mod:`physics.kalman`, compiled: a filter's steps forward and a smoother's steps backward."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from physics.compiled import put

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

FAST = {"reassoc", "contract"}  # sums may be regrouped; NaN keeps its meaning


# Vectors are long enough to gain by several terms a pass and short enough to lose by one: hence groups of four and six.
FOUR, _SIX = 4, 6


@njit(cache=True, nogil=True, fastmath=FAST)
def _combine(target: FloatArray, source: FloatArray, values: FloatArray, cols: IndexArray, entries: IndexArray) -> None:
    """target (t, n) <- rows of E times source (., n); entries (t, 4 w): which of the values each row of E holds."""
    n = target.shape[1]
    for i in range(len(entries)):
        for c in range(n):
            target[i, c] = 0.0
        for g in range(0, entries.shape[1], FOUR):
            p, q, r, s = entries[i, g], entries[i, g + 1], entries[i, g + 2], entries[i, g + 3]
            if p < 0:
                break
            v0, v1 = values[p], values[q] if q >= 0 else 0.0
            v2, v3 = values[r] if r >= 0 else 0.0, values[s] if s >= 0 else 0.0
            c0, c1, c2, c3 = cols[p], cols[q], cols[r], cols[s]
            for c in range(n):
                target[i, c] += v0 * source[c0, c] + v1 * source[c1, c] + v2 * source[c2, c] + v3 * source[c3, c]


@njit(cache=True, nogil=True, fastmath=FAST)
def _predict(
    P: FloatArray,
    values: FloatArray,
    cols: IndexArray,
    entries: IndexArray,
    first: int,
    W: FloatArray,
    W_T: FloatArray,
    G: FloatArray,
) -> None:
    """P <- (I + E) P (I + E)^T = P + W + W^T + W E^T with W = E P; P is symmetric before and after.

    E touches the rows first..first + t. W (t, n), W_T (n, t) and G (t, t), W E^T, are scratch.
    """
    n, t = W_T.shape
    _combine(W, P, values, cols, entries)
    for i in range(t):
        for j in range(n):
            W_T[j, i] = W[i, j]
    _combine(G, W_T, values, cols, entries)
    for i in range(t):
        for j in range(n):
            P[first + i, j] += W[i, j]
        for j in range(t):
            P[first + i, first + j] += G[i, j]
    for j in range(n):
        for i in range(t):
            P[j, first + i] += W_T[j, i]
    for i in range(first, first + t):  # rounding must not let P lose its symmetry
        for j in range(first, i):
            P[i, j] = P[j, i]


@njit(cache=True, nogil=True, fastmath=FAST)
def _add_products(P: FloatArray, one: FloatArray, other: FloatArray) -> None:
    """P <- P + sum of one[i]^T other[i], which is symmetric; one, other: (6 w, n)."""
    n = len(P)
    for j in range(n):
        for i in range(0, len(one), _SIX):
            f0, f1, f2 = one[i, j], one[i + 1, j], one[i + 2, j]
            f3, f4, f5 = one[i + 3, j], one[i + 4, j], one[i + 5, j]
            for c in range(n):
                P[j, c] += (f0 * other[i, c] + f1 * other[i + 1, c] + f2 * other[i + 2, c]) + (
                    f3 * other[i + 3, c] + f4 * other[i + 4, c] + f5 * other[i + 5, c]
                )
    for j in range(n):
        for i in range(j):
            P[j, i] = P[i, j]


@njit(cache=True, nogil=True, fastmath=FAST)
def forward(
    e_row: IndexArray,
    e_col: IndexArray,
    E: FloatArray,
    e_entries: IndexArray,
    first: int,
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
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Filter all steps of a :class:`physics.kalman.SparseModel`: the fields of a ``Filtered`` but for out, in order."""
    steps, m = z.shape
    n = len(x0)
    c = h_col.shape[1]
    x = x0.copy()
    P = P0.copy()
    t = len(e_entries)
    W, W_T, G = np.zeros((t, n)), np.zeros((n, t)), np.zeros((t, t))
    taken = np.zeros((-(-m // _SIX) * _SIX, n))  # h P over the root of the innovation's variance: P loses its square
    given = np.zeros_like(taken)  # the same with the sign that makes it a loss
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
        _predict(P, E[k], e_col, e_entries, first, W, W_T, G)
        for a in range(len(q_row)):
            P[q_row[a], q_col[a]] += Q[k, a]
            if q_row[a] != q_col[a]:
                P[q_col[a], q_row[a]] += Q[k, a]
        # P stays that before the measurements of the step until all are seen; what each takes is minded along h alone.
        for i in range(m):
            hP = taken[i]
            for j in range(n):
                hP[j] = 0.0
            if not np.isnan(z[k, i]):
                residual = z[k, i]
                for a in range(c):
                    h = H[k, i, a]
                    if h != 0.0:
                        col = h_col[i, a]
                        residual -= h * x[col]
                        for j in range(n):
                            hP[j] += h * P[col, j]
                for before in range(i):
                    share = 0.0
                    for a in range(c):
                        share += H[k, i, a] * taken[before, h_col[i, a]]
                    for j in range(n):
                        hP[j] -= share * taken[before, j]
                s = R[k, i]
                for a in range(c):
                    s += H[k, i, a] * hP[h_col[i, a]]
                nu[k, i] = residual
                S[k, i] = s
                loglik -= 0.5 * (np.log(2.0 * np.pi * s) + residual * residual / s)
                for j in range(n):
                    x[j] += hP[j] / s * residual
                    if keep:
                        gain[k, i, j] = hP[j] / s
                    hP[j] /= np.sqrt(s)
            for j in range(n):
                given[i, j] = -hP[j]
        _add_products(P, given, taken)
        if keep:
            put(xs[k], x)
            for a in range(len(out)):
                put(P_out[k, a], P[out[a]])
    return xs, P_out, nu, S, gain, x, P, loglik


@njit(cache=True, nogil=True, fastmath=FAST)
def _smooth_mean(x: FloatArray, P: FloatArray, out: IndexArray, adjoint: FloatArray, smoothed: FloatArray) -> None:
    """smoothed (o,) <- x - P adjoint of the states ``out``, whose rows of P (o, n) are given."""
    for a in range(len(out)):
        value = x[out[a]]
        for j in range(len(x)):
            value -= P[a, j] * adjoint[j]
        smoothed[a] = value


@njit(cache=True, nogil=True, fastmath=FAST)
def _carry_back(e_row: IndexArray, e_col: IndexArray, E: FloatArray, adjoint: FloatArray, shift: FloatArray) -> None:
    """adjoint <- (I + E)^T adjoint; shift (n,) is scratch."""
    for j in range(len(shift)):
        shift[j] = 0.0
    for a in range(len(e_row)):
        shift[e_col[a]] += E[a] * adjoint[e_row[a]]
    adjoint += shift


@njit(cache=True, nogil=True, fastmath=FAST)
def backward(
    e_row: IndexArray,
    e_col: IndexArray,
    E: FloatArray,
    e_entries: IndexArray,
    first: int,
    h_col: IndexArray,
    H: FloatArray,
    out: IndexArray,
    xs: FloatArray,
    P_out: FloatArray,
    nu: FloatArray,
    S: FloatArray,
    gain: FloatArray,
    stride: int,
    adjoint: FloatArray,
    information: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """adjoint (n,) and information (n, n): what comes later says about the last step; then, about the one before."""
    steps, m = nu.shape
    n = xs.shape[1]
    c = h_col.shape[1]
    o = len(out)
    t = len(e_entries)
    W, W_T, G = np.zeros((t, n)), np.zeros((n, t)), np.zeros((t, t))
    # information gains the products of ``one`` and ``other``: h and y of each measurement, and again in turn
    one, other = np.zeros((-(-2 * m // _SIX) * _SIX, n)), np.zeros((-(-2 * m // _SIX) * _SIX, n))
    Lk = np.zeros((m, n))
    shift = np.zeros(n)
    x_s = np.zeros((steps, o))
    P_s = np.zeros((steps, o, o))
    PL = np.zeros((o, n))
    for k in range(steps - 1, -1, -1):
        _smooth_mean(xs[k], P_out[k], out, adjoint, x_s[k])
        if k % stride == 0 or k == steps - 1:
            np.dot(P_out[k], information, PL)
            for a in range(o):
                for b in range(o):
                    value = P_out[k, a, out[b]]
                    for j in range(n):
                        value -= PL[a, j] * P_out[k, b, j]
                    P_s[k, a, b] = value
        else:
            for a in range(o):
                put(P_s[k, a], P_s[k + 1, a])
        # (I - gain h)^T information (I - gain h) + h^T h / S, the last measurement first: with y = (gain information
        # gain^T + 1 / S) h / 2 - gain information it is information + h^T y + y^T h.
        np.dot(gain[k], information, Lk)
        for i in range(m - 1, -1, -1):
            h_row, y_row = one[i], one[m + i]
            for j in range(n):
                h_row[j] = 0.0
                y_row[j] = 0.0
            if np.isnan(nu[k, i]):
                continue
            for later in range(i + 1, m):
                on_h, on_y = 0.0, 0.0
                for j in range(n):
                    on_h += one[later, j] * gain[k, i, j]
                    on_y += one[m + later, j] * gain[k, i, j]
                for j in range(n):
                    Lk[i, j] += on_y * one[later, j] + on_h * one[m + later, j]
            dot = nu[k, i] / S[k, i]
            scale = 1.0 / S[k, i]
            for j in range(n):
                dot += gain[k, i, j] * adjoint[j]
                scale += gain[k, i, j] * Lk[i, j]
            for a in range(c):
                h_row[h_col[i, a]] += H[k, i, a]
                adjoint[h_col[i, a]] -= H[k, i, a] * dot
            for j in range(n):
                y_row[j] = 0.5 * scale * h_row[j] - Lk[i, j]
        for i in range(m):
            put(other[m + i], one[i])
            put(other[i], one[m + i])
        _add_products(information, one, other)
        # adjoint <- (I + E)^T adjoint, information <- (I + E)^T information (I + E)
        _carry_back(e_row, e_col, E[k], adjoint, shift)
        _predict(information, E[k], e_row, e_entries, first, W, W_T, G)
    return x_s, P_s


@njit(cache=True, nogil=True, fastmath=FAST)
def backward_means(
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
    adjoint: FloatArray,
) -> FloatArray:
    """The means of :func:`backward`, which do not need the information; adjoint as there."""
    steps, m = nu.shape
    n = xs.shape[1]
    o = len(out)
    shift = np.zeros(n)
    x_s = np.zeros((steps, o))
    for k in range(steps - 1, -1, -1):
        _smooth_mean(xs[k], P_out[k], out, adjoint, x_s[k])
        for i in range(m - 1, -1, -1):
            if np.isnan(nu[k, i]):
                continue
            dot = nu[k, i] / S[k, i]
            for j in range(n):
                dot += gain[k, i, j] * adjoint[j]
            for a in range(h_col.shape[1]):
                adjoint[h_col[i, a]] -= H[k, i, a] * dot
        _carry_back(e_row, e_col, E[k], adjoint, shift)
    return x_s
