"""Regression on whitened innovations from Gram matrices of time blocks: any subset or hold-out is a tiny solve.

With y the whitened innovations and X the whitened regressors, each block keeps ``[X y]^T [X y]``. Nuisances have
Gaussian priors, effects have none but what makes the solve regular. Held-out evidence of a set of regressors: the
coefficients of one fold score the other, ``1/2 (|y - N n0|^2 - |y - N n1 - E e|^2)`` summed over both; folds are
interleaved blocks. Beside a process that takes other values in every block (its regressors' names begin with PROCESS)
one fold foretells little of the other: there both are fitted together, at the price of a nat a number, which is what
data held out would cost on the average.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from physics.normal import solve_normal
from schemas.products import BoolArray
from schemas.rig import FloatArray

BLOCK_S = 30.0
PROCESS = "wander"


@dataclass(frozen=True)
class Gram:
    """names: (K,) of the regressors. blocks: (b, K + 1, K + 1), the last row and column are y's. edges: (b + 1,) s.
    precision: (K,) of the priors, 0 for none. count: (b,) innovations."""

    names: tuple[str, ...]
    blocks: FloatArray
    edges: FloatArray
    precision: FloatArray
    count: FloatArray

    @cached_property
    def halves(self) -> FloatArray:
        """(2, K + 1, K + 1), sums of either fold."""
        return np.stack([self.blocks[fold].sum(axis=0) for fold in folds(self)])

    @cached_property
    def total(self) -> FloatArray:
        """(K + 1, K + 1)."""
        return np.asarray(self.halves.sum(axis=0))

    @cached_property
    def wanders(self) -> bool:
        """Whether a process is among the regressors."""
        return any(name.startswith(PROCESS) for name in self.names)

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
    return Table.of(names, columns, y, t, precision, block).gram


@dataclass(frozen=True)
class Table:
    """Rows ``[X y]`` of every block that are not masked, to which further regressors are set. gram: of themselves."""

    rows: tuple[FloatArray, ...]
    parts: tuple[slice, ...]
    seen: BoolArray
    gram: Gram

    @classmethod
    def of(
        cls, names: Sequence[str], columns: FloatArray, y: FloatArray, t: FloatArray, precision: FloatArray,
        block: float = BLOCK_S, chosen: Sequence[int] | None = None,
    ) -> Table:  # fmt: skip
        """As :func:`gram`; chosen: places of the columns that are taken, all by default."""
        count = max(2, round((t[-1] - t[0]) / block))
        edges = np.linspace(t[0], t[-1], count + 1)
        which = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, count - 1)
        starts = np.searchsorted(which, np.arange(count + 1))
        parts = tuple(slice(a, b) for a, b in pairwise(starts))
        seen: BoolArray = np.isfinite(y)
        taken = slice(None) if chosen is None else list(chosen)
        rows = tuple(
            np.column_stack([_rows(columns[part], seen[part])[:, taken], y[part][seen[part]]]) for part in parts
        )
        blocks = np.array([Z.T @ Z for Z in rows])
        number = np.array([float(len(Z)) for Z in rows])
        return cls(rows, parts, seen, Gram(tuple(names), blocks, edges, np.asarray(precision, dtype=float), number))

    def widened(self, names: Sequence[str], columns: FloatArray, precision: FloatArray) -> Gram:
        """Gram matrices of these regressors and of more, columns (N, m, k), which stand behind them, before y."""
        old, k = self.gram, columns.shape[2]
        K = len(old.names)
        place = [*range(K), K + k]
        blocks = np.zeros((len(old.blocks), K + k + 1, K + k + 1))
        for b, (Z, part) in enumerate(zip(self.rows, self.parts)):
            X = _rows(columns[part], self.seen[part])
            blocks[b][np.ix_(place, place)] = old.blocks[b]
            blocks[b][K : K + k, K : K + k] = X.T @ X
            cross = X.T @ Z
            blocks[b][K : K + k, place] = cross
            blocks[b][place, K : K + k] = cross.T
        return Gram((*old.names, *names), blocks, old.edges, np.concatenate([old.precision, precision]), old.count)


def _rows(columns: FloatArray, seen: BoolArray) -> FloatArray:
    """columns (n, m, K) where seen (n, m), one row each; without a copy where that is everywhere."""
    return columns.reshape(-1, columns.shape[2]) if seen.all() else columns[seen]


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
    solved = solve_normal(A, np.column_stack([b, np.eye(len(k))]))
    return Fit(solved[:, 0], solved[:, 1:], 0.5 * float(solved[:, 0] @ b))


def folds(gram_: Gram) -> tuple[BoolArray, BoolArray]:
    """Interleaved blocks."""
    odd = np.arange(len(gram_.blocks)) % 2 == 1
    return ~odd, odd


def held_out(gram_: Gram, base: Sequence[int], more: Sequence[int]) -> FloatArray:
    """(b,) nats per block by which base and more beat base, each block scored by the other fold's coefficients."""
    out = np.zeros(len(gram_.blocks))
    used = [*base, *more, -1]
    if gram_.wanders:
        lesser, greater = _both(gram_.total, gram_.precision, base, more)
        blocks = gram_.blocks[:, used][:, :, used]
        out = 0.5 * (_squares(blocks, lesser) - _squares(blocks, greater))
        return np.asarray(out + (held_out_sum(gram_, base, more) - out.sum()) / len(out))  # of the priors' cost
    for G, tested in zip(gram_.halves, reversed(folds(gram_))):
        lesser, greater = _both(G, gram_.precision, base, more)
        blocks = gram_.blocks[tested][:, used][:, :, used]
        out[tested] = 0.5 * (_squares(blocks, lesser) - _squares(blocks, greater))
    return out


def held_out_sum(gram_: Gram, base: Sequence[int], more: Sequence[int]) -> float:
    """Sum over the blocks of :func:`held_out`, without looking at each of them."""
    if gram_.wanders:
        return gain(gram_, base, more) - len(more)
    used, total = [*base, *more, -1], 0.0
    for trained, tested in zip(gram_.halves, gram_.halves[::-1]):
        lesser, greater = _both(trained, gram_.precision, base, more)
        G = tested[np.ix_(used, used)][None]
        total += 0.5 * float(_squares(G, lesser)[0] - _squares(G, greater)[0])
    return total


def _both(
    G: FloatArray, precision: FloatArray, base: Sequence[int], more: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """(k + 1,) residuals as combinations of base, more and y, without more and with it."""
    lesser, greater = solve(G, precision, base).value, solve(G, precision, [*base, *more]).value
    return np.concatenate([-lesser, np.zeros(len(more)), [1.0]]), np.append(-greater, 1.0)


def _squares(blocks: FloatArray, combination: FloatArray) -> FloatArray:
    """(b,) sums of squares of a combination of the columns of each block."""
    return np.asarray((blocks @ combination) @ combination)


def combined(columns: FloatArray, places: Sequence[int], values: FloatArray) -> FloatArray:
    """(N, m) sum of some columns of (N, m, K) times values, without a copy of them."""
    weights = np.zeros(columns.shape[2])
    weights[list(places)] = values
    return np.asarray(columns @ weights)


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
    if gram_.wanders:
        nothing = _gained(G, b, precision, lesser)
        found = [_gained(G, b, precision, lesser + [place[k] for k in group]) - len(group) for group in groups]
        return np.array([float(np.max(gained - nothing)) for gained in found])
    nothing = _held_out_draws(G, b, precision, lesser, folds(gram_))
    out = [_held_out_draws(G, b, precision, lesser + [place[k] for k in group], folds(gram_)) for group in groups]
    return np.array([float(np.max(gained - nothing)) for gained in out])


def _root(block: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(block)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _gained(G: FloatArray, b: FloatArray, precision: FloatArray, chosen: Sequence[int]) -> FloatArray:
    """(draws,) nats in sample by which chosen regressors beat nothing."""
    k = list(chosen)
    moment = b.sum(axis=0)[k]
    A = G.sum(axis=0)[np.ix_(k, k)] + np.diag(precision[k])
    return np.asarray(0.5 * np.sum(solve_normal(A, moment) * moment, axis=0))


def _held_out_draws(
    G: FloatArray, b: FloatArray, precision: FloatArray, chosen: Sequence[int], halves: tuple[BoolArray, BoolArray]
) -> FloatArray:
    """(draws,) nats by which chosen regressors beat nothing, each half scored by the other's coefficients."""
    k = list(chosen)
    total = np.zeros(b.shape[2])
    for train in halves:
        A = G[train].sum(axis=0)[np.ix_(k, k)] + np.diag(precision[k])
        value = solve_normal(A, b[train].sum(axis=0)[k])
        test, moment = G[~train].sum(axis=0)[np.ix_(k, k)], b[~train].sum(axis=0)[k]
        total += np.sum(value * moment, axis=0) - 0.5 * np.einsum("id,ij,jd->d", value, test, value, optimize=True)
    return total
