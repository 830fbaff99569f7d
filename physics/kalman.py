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
from numpy.typing import NDArray

from physics.kalman_loops import FAST as FAST
from physics.kalman_loops import FOUR, backward, backward_means, forward

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
    """x: (N, o) smoothed means and P: (N, o, o) covariances of the states ``out``; P (0, o, o) if left out."""

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


def _by_row(rows: IndexArray) -> tuple[IndexArray, int]:
    """(t, w) which of ``rows`` are the first, second ... row in use, w a multiple of four, -1: none; and the first row.

    States should be numbered so that few rows lie between the first and the last one in use.
    """
    if not len(rows):
        return np.full((0, FOUR), -1), 0
    first, last = int(rows.min()), int(rows.max())
    of_each = [np.flatnonzero(rows == row) for row in range(first, last + 1)]
    width = -(-max(map(len, of_each)) // FOUR) * FOUR
    entries = np.full((len(of_each), width), -1)
    for row, mine in zip(entries, of_each, strict=True):
        row[: len(mine)] = mine
    return entries, first


def run_filter(model: SparseModel, out: IndexArray, keep: bool = True) -> Filtered:
    """Filter; ``out`` names the states whose covariance rows are kept, ``keep=False`` keeps the likelihood alone."""
    # The noise lies in memory as its maker left it; for every other layout the loop would be compiled anew.
    x, P_out, innovation, S, gain, x_last, P_last, log_likelihood = forward(
        model.transition_row, model.transition_col, model.transition, *_by_row(model.transition_row),
        model.noise_row, model.noise_col, np.ascontiguousarray(model.noise), model.measurement_col, model.measurement,
        model.z, model.variance, model.x0, model.P0, out, keep,
    )  # fmt: skip
    return Filtered(out, x, P_out, innovation, S, gain, x_last, P_last, log_likelihood)


def run_smoother(model: SparseModel, filtered: Filtered, stride: int = 1) -> Smoothed:
    """Smooth what :func:`run_filter` kept: means and covariances of the states ``filtered.out`` given all data.

    stride: covariances are computed at every so many steps and held in between; 0: they are left out, and with
    them most of the work. The states should be chosen so that no nearly noise-free measurement is a difference of
    widely uncertain ones: ``P - P Lambda P`` would lose its digits.
    """
    n = len(model.x0)
    return _smoothed(model, filtered, stride, np.zeros(n), np.zeros((n, n)))


def _smoothed(
    model: SparseModel, filtered: Filtered, stride: int, adjoint: FloatArray, information: FloatArray
) -> Smoothed:
    o = len(filtered.out)
    if stride == 0:
        x = backward_means(
            model.transition_row, model.transition_col, model.transition, model.measurement_col, model.measurement,
            filtered.out, filtered.x, filtered.P_out, filtered.innovation, filtered.innovation_variance, filtered.gain,
            adjoint,
        )  # fmt: skip
        return Smoothed(x, np.empty((0, o, o)))
    x, P = backward(
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
    twice: forward, to know where each begins, and again when its turn comes backward. stride: as of
    :func:`run_smoother`.
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
