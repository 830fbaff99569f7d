"""Regression on whitened innovations from Gram matrices of time blocks: any subset or hold-out is a tiny solve.

With y the whitened innovations and X the whitened regressors, each block keeps ``[X y]^T [X y]``. Nuisances have
Gaussian priors, effects have none but what makes the solve regular. Held-out evidence of a set of regressors: the
coefficients of one fold score the other, ``1/2 (|y - N n0|^2 - |y - N n1 - E e|^2)`` summed over both; folds are
interleaved blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from schemas.products import BoolArray
from schemas.rig import FloatArray

BLOCK_S = 30.0


@dataclass(frozen=True)
class Gram:
    """names: (K,) of the regressors. blocks: (b, K + 1, K + 1), the last row and column are y's. edges: (b + 1,) s.
    precision: (K,) of the priors, 0 for none. count: (b,) innovations."""

    names: tuple[str, ...]
    blocks: FloatArray
    edges: FloatArray
    precision: FloatArray
    count: FloatArray

    @property
    def total(self) -> FloatArray:
        """(K + 1, K + 1)."""
        return np.asarray(self.blocks.sum(axis=0))

    def index(self, names: Sequence[str]) -> list[int]:
        """Places of regressors by name."""
        place = {name: k for k, name in enumerate(self.names)}
        return [place[name] for name in names]


def gram(
    names: Sequence[str],
    columns: FloatArray,
    y: FloatArray,
    t: FloatArray,
    precision: FloatArray,
    block: float = BLOCK_S,
) -> Gram:
    """columns: (N, m, K) and y: (N, m) whitened, NaN in y is masked; t: (N,) s."""
    count = max(2, round((t[-1] - t[0]) / block))
    edges = np.linspace(t[0], t[-1], count + 1)
    which = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, count - 1)
    seen = np.isfinite(y)
    starts = np.searchsorted(which, np.arange(count + 1))
    blocks = np.zeros((count, columns.shape[2] + 1, columns.shape[2] + 1))
    number = np.zeros(count)
    for b in range(count):
        rows = slice(starts[b], starts[b + 1])
        ok = seen[rows]
        Z = np.concatenate([columns[rows][ok], y[rows][ok][:, None]], axis=1)
        blocks[b], number[b] = Z.T @ Z, ok.sum()
    return Gram(tuple(names), blocks, edges, np.asarray(precision, dtype=float), number)


@dataclass(frozen=True)
class Fit:
    """value: (k,), covariance: (k, k) of chosen regressors, gain: nats over nothing at all (prior's cost included)."""

    value: FloatArray
    covariance: FloatArray
    gain: float


def solve(G: FloatArray, precision: FloatArray, chosen: Sequence[int]) -> Fit:
    """Ridge solution of some regressors of one Gram matrix (K + 1, K + 1)."""
    k = list(chosen)
    A, b = G[np.ix_(k, k)] + np.diag(precision[k]), G[k, -1]
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))  # units differ by many powers of ten
    root = np.linalg.inv(A / np.outer(size, size) + 1e-10 * np.eye(len(k)))
    value = root @ (b / size) / size
    return Fit(value, root / np.outer(size, size), 0.5 * float(value @ b))


def deviance(G: FloatArray, chosen: Sequence[int], value: FloatArray) -> float:
    """|y - X value|^2 on one Gram matrix."""
    k = list(chosen)
    return float(G[-1, -1] - 2.0 * value @ G[k, -1] + value @ G[np.ix_(k, k)] @ value)


def folds(gram_: Gram) -> tuple[BoolArray, BoolArray]:
    """Interleaved blocks."""
    odd = np.arange(len(gram_.blocks)) % 2 == 1
    return ~odd, odd


def held_out(gram_: Gram, base: Sequence[int], more: Sequence[int]) -> FloatArray:
    """(b,) nats per block by which base and more beat base, each block scored by the other fold's coefficients."""
    out = np.zeros(len(gram_.blocks))
    both = [*base, *more]
    for train in folds(gram_):
        G = gram_.blocks[train].sum(axis=0)
        lesser = solve(G, gram_.precision, base).value
        greater = solve(G, gram_.precision, both).value
        for b in np.flatnonzero(~train):
            block = gram_.blocks[b]
            out[b] = 0.5 * (deviance(block, base, lesser) - deviance(block, both, greater))
    return out


def gain(gram_: Gram, base: Sequence[int], more: Sequence[int]) -> float:
    """Nats in sample by which base and more beat base."""
    G = gram_.total
    return solve(G, gram_.precision, [*base, *more]).gain - solve(G, gram_.precision, base).gain


def shifted(gram_: Gram, places: Sequence[int], values: FloatArray) -> Gram:
    """The same with the columns at ``places`` times ``values`` added to y."""
    T = np.eye(len(gram_.names) + 1)
    T[list(places), -1] = values
    return replace(gram_, blocks=np.einsum("ji,bjk,kl->bil", T, gram_.blocks, T, optimize=True))


def null_evidence(
    gram_: Gram, base: Sequence[int], groups: Sequence[Sequence[int]], rng: np.random.Generator, draws: int
) -> FloatArray:
    """(groups,) largest held-out nats of each group in replays in which the innovations are white noise.

    X^T y of a block is then normal with covariance X^T X, so that replays need no time series.
    """
    used = sorted({*base, *(k for group in groups for k in group)})
    place = {k: i for i, k in enumerate(used)}
    G = gram_.blocks[:, used][:, :, used]
    b = np.stack([_root(block) @ rng.standard_normal((len(used), draws)) for block in G])  # (blocks, k, draws)
    lesser = [place[k] for k in base]
    precision = gram_.precision[used]
    nothing = _held_out_draws(G, b, precision, lesser, folds(gram_))
    out = [_held_out_draws(G, b, precision, lesser + [place[k] for k in group], folds(gram_)) for group in groups]
    return np.array([float(np.max(gained - nothing)) for gained in out])


def _root(block: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(block)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _held_out_draws(
    G: FloatArray, b: FloatArray, precision: FloatArray, chosen: Sequence[int], halves: tuple[BoolArray, BoolArray]
) -> FloatArray:
    """(draws,) nats by which chosen regressors beat nothing, each half scored by the other's coefficients."""
    k = list(chosen)
    total = np.zeros(b.shape[2])
    for train in halves:
        A = G[train].sum(axis=0)[np.ix_(k, k)] + np.diag(precision[k])
        size = np.sqrt(np.maximum(np.diag(A), 1e-300))
        moment = b[train].sum(axis=0)[k] / size[:, None]
        value = np.linalg.solve(A / np.outer(size, size) + 1e-10 * np.eye(len(k)), moment) / size[:, None]
        test, moment = G[~train].sum(axis=0)[np.ix_(k, k)], b[~train].sum(axis=0)[k]
        total += np.sum(value * moment, axis=0) - 0.5 * np.einsum("id,ij,jd->d", value, test, value, optimize=True)
    return total
