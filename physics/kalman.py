"""Linear time-varying Kalman filter and fixed-interval smoother with sparse models, compiled.

``x[k] = (I + E[k]) x[k-1] + w[k]``, ``cov w = Q[k]``; ``z[k] = H[k] x[k] + v[k]`` with independent scalar measurements,
taken one after the other (NaN: no measurement). E, Q and H have a fixed pattern and values that change with k, so a
step costs a few sparse rank-one operations instead of dense products. The smoother is the modified Bryson-Frazier
form (G. J. Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18, 1973): it needs no inverse
of a covariance, which matters for nearly noise-free measurements.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from physics.compiled import put

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

    innovation, innovation_variance: (N, m), NaN where nothing was measured. gain: (N, m, n). x_last, P_last:
    (n,), (n, n) at the last step. log_likelihood: of all measurements.
    """

    out: IndexArray
    x: FloatArray
    P_out: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    gain: FloatArray
    x_last: FloatArray
    P_last: FloatArray
    log_likelihood: float


@dataclass(frozen=True)
class Smoothed:
    """x: (N, o) smoothed means and P: (N, o, o) covariances of the states ``out``."""

    x: FloatArray
    P: FloatArray


@dataclass(frozen=True)
class Course:
    """What is kept of a filter run over a long record, of the states ``out``: x (N, o) and P (N, o, o), posterior.

    innovation, innovation_variance: (N, m). x_last, P_last: (n,), (n, n), all states at the last step.
    """

    x: FloatArray
    P: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    x_last: FloatArray
    P_last: FloatArray
    log_likelihood: float


FAST = {"reassoc", "contract"}  # sums may be regrouped; NaN keeps its meaning


# Vectors are long enough to gain by several terms a pass and short enough to lose by one: hence groups of four and six.
_FOUR, _SIX = 4, 6


@njit(cache=True, nogil=True, fastmath=FAST)
def _combine(target: FloatArray, source: FloatArray, values: FloatArray, cols: IndexArray, entries: IndexArray) -> None:
    """target (t, n) <- rows of E times source (., n); entries (t, 4 w): which of the values each row of E holds."""
    n = target.shape[1]
    for i in range(len(entries)):
        for c in range(n):
            target[i, c] = 0.0
        for g in range(0, entries.shape[1], _FOUR):
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
def _forward(
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
def _backward(
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
        for a in range(o):
            value = xs[k, out[a]]
            for j in range(n):
                value -= P_out[k, a, j] * adjoint[j]
            x_s[k, a] = value
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
        for j in range(n):
            shift[j] = 0.0
        for a in range(len(e_row)):
            shift[e_col[a]] += E[k, a] * adjoint[e_row[a]]
        adjoint += shift
        _predict(information, E[k], e_row, e_entries, first, W, W_T, G)
    return x_s, P_s


def _by_row(rows: IndexArray) -> tuple[IndexArray, int]:
    """(t, w) which of ``rows`` are the first, second ... row in use, w a multiple of four, -1: none; and the first row.

    States should be numbered so that few rows lie between the first and the last one in use.
    """
    if not len(rows):
        return np.full((0, _FOUR), -1), 0
    first, last = int(rows.min()), int(rows.max())
    of_each = [np.flatnonzero(rows == row) for row in range(first, last + 1)]
    width = -(-max(map(len, of_each)) // _FOUR) * _FOUR
    entries = np.full((len(of_each), width), -1)
    for row, mine in zip(entries, of_each, strict=True):
        row[: len(mine)] = mine
    return entries, first


def run_filter(model: SparseModel, out: IndexArray, keep: bool = True) -> Filtered:
    """Filter; ``out`` names the states whose covariance rows are kept, ``keep=False`` keeps the likelihood alone."""
    x, P_out, innovation, S, gain, x_last, P_last, log_likelihood = _forward(
        model.transition_row, model.transition_col, model.transition, *_by_row(model.transition_row),
        model.noise_row, model.noise_col, model.noise, model.measurement_col, model.measurement, model.z,
        model.variance, model.x0, model.P0, out, keep,
    )  # fmt: skip
    return Filtered(out, x, P_out, innovation, S, gain, x_last, P_last, log_likelihood)


def run_smoother(model: SparseModel, filtered: Filtered, stride: int = 1) -> Smoothed:
    """Smooth what :func:`run_filter` kept: means and covariances of the states ``filtered.out`` given all data.

    stride: covariances are computed at every so many steps and held in between. The states should be chosen so that no
    nearly noise-free measurement is a difference of widely uncertain ones: ``P - P Lambda P`` would lose its digits.
    """
    n = len(model.x0)
    return _smoothed(model, filtered, stride, np.zeros(n), np.zeros((n, n)))


def _smoothed(
    model: SparseModel, filtered: Filtered, stride: int, adjoint: FloatArray, information: FloatArray
) -> Smoothed:
    x, P = _backward(
        model.transition_row, model.transition_col, model.transition, *_by_row(model.transition_col),
        model.measurement_col, model.measurement, filtered.out, filtered.x, filtered.P_out, filtered.innovation,
        filtered.innovation_variance, filtered.gain, stride, adjoint, information,
    )  # fmt: skip
    return Smoothed(x, P)


def run_pieces(
    pieces: Sequence[Callable[[], SparseModel]], out: IndexArray, stride: int = 1
) -> tuple[Course, Smoothed]:
    """Filter and smooth a record whose model is made piece by piece, so that memory is that of one piece.

    Each piece goes on where the one before ends; x0 and P0 of the first alone count. All but the last are filtered
    twice: forward, to know where each begins, and again when its turn comes backward.
    """
    begin, _ = _ahead(pieces[:-1])
    parts: list[tuple[Course, Smoothed]] = []
    later: list[FloatArray] = []  # adjoint and information, carried on from piece to piece
    for piece, start in zip(reversed(pieces), reversed(begin)):
        parts.append(_both_ways(_begun(piece(), start), out, stride, later))
    return _joined(parts[::-1])


def _both_ways(model: SparseModel, out: IndexArray, stride: int, later: list[FloatArray]) -> tuple[Course, Smoothed]:
    if not later:
        later += [np.zeros(len(model.x0)), np.zeros_like(model.P0)]
    filtered = run_filter(model, out)
    return _course(filtered), _smoothed(model, filtered, stride, *later)


def log_likelihood(pieces: Sequence[Callable[[], SparseModel]]) -> float:
    """Of all measurements of a record whose model is made piece by piece."""
    return _ahead(pieces)[1]


def _ahead(pieces: Sequence[Callable[[], SparseModel]]) -> tuple[list[tuple[FloatArray, FloatArray] | None], float]:
    """Where each piece and what follows the last one begins, and the log-likelihood of all."""
    begin: list[tuple[FloatArray, FloatArray] | None] = [None]
    total = 0.0
    for piece in pieces:
        found = run_filter(_begun(piece(), begin[-1]), np.zeros(0, dtype=np.int64), keep=False)
        begin.append((found.x_last, found.P_last))
        total += found.log_likelihood
    return begin, total


def _begun(model: SparseModel, start: tuple[FloatArray, FloatArray] | None) -> SparseModel:
    return model if start is None else replace(model, x0=start[0], P0=start[1])


def _course(filtered: Filtered) -> Course:
    return Course(
        filtered.x[:, filtered.out].copy(), filtered.P_out[:, :, filtered.out].copy(), filtered.innovation,
        filtered.innovation_variance, filtered.x_last, filtered.P_last, filtered.log_likelihood,
    )  # fmt: skip


def _joined(parts: list[tuple[Course, Smoothed]]) -> tuple[Course, Smoothed]:
    courses, smoothed = [part[0] for part in parts], [part[1] for part in parts]
    last = courses[-1]
    course = Course(
        np.concatenate([part.x for part in courses]), np.concatenate([part.P for part in courses]),
        np.concatenate([part.innovation for part in courses]),
        np.concatenate([part.innovation_variance for part in courses]),
        last.x_last, last.P_last, sum(part.log_likelihood for part in courses),
    )  # fmt: skip
    return course, Smoothed(
        np.concatenate([part.x for part in smoothed]), np.concatenate([part.P for part in smoothed])
    )


def selected(model: SparseModel, kept: IndexArray) -> SparseModel:
    """The model of the states ``kept`` (sorted) alone; exact where no measurement nor kept state sees the others."""
    number = np.full(len(model.x0), -1)
    number[kept] = np.arange(len(kept))
    e = (number[model.transition_row] >= 0) & (number[model.transition_col] >= 0)
    q = (number[model.noise_row] >= 0) & (number[model.noise_col] >= 0)
    seen = number[model.measurement_col] >= 0
    return replace(
        model,
        transition_row=number[model.transition_row[e]],
        transition_col=number[model.transition_col[e]],
        transition=np.ascontiguousarray(model.transition[:, e]),
        noise_row=number[model.noise_row[q]],
        noise_col=number[model.noise_col[q]],
        noise=np.ascontiguousarray(model.noise[:, q]),
        measurement_col=np.where(seen, number[model.measurement_col], 0),
        measurement=np.where(seen, model.measurement, 0.0),
        x0=model.x0[kept],
        P0=np.ascontiguousarray(model.P0[np.ix_(kept, kept)]),
    )
