"""Paths of several flexure axes at once: correlated forcing, and instants put in between without touching the rest.

Each axis obeys theta'' + 2 mu theta' + b^2 theta = w (:mod:`physics.flexure`); the white accelerations w of
the axes may be correlated. The path is drawn on a base of instants first; others follow from the exact distribution
conditional on it, so that asking for more instants never changes the path elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_sylvester

from physics import flexure

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SLAB = 1 << 15  # instants put in between at a time
JITTER = 1e-12  # of a unit variance, added before factoring a covariance that may be singular


@dataclass(frozen=True)
class Axes:
    """damping, stiffness, std: (k,) mu 1/s, b^2 1/s^2, sigma rad. correlation: (k, k) of the white accelerations."""

    damping: FloatArray
    stiffness: FloatArray
    std: FloatArray
    correlation: FloatArray

    def unit(self, axis: int) -> tuple[float, float, float]:
        """mu, b^2 and a standard deviation of one."""
        return float(self.damping[axis]), float(self.stiffness[axis]), 1.0


def stationary_covariance(axes: Axes) -> FloatArray:
    """Covariance (2k, 2k) of (theta, theta') of all axes at unit standard deviations: F_i P + P F_j^T + q_ij = 0."""
    k = len(axes.damping)
    out = np.zeros((2 * k, 2 * k))
    drift = [np.array([[0.0, 1.0], [-b2, -2.0 * mu]]) for mu, b2 in zip(axes.damping, axes.stiffness)]
    strength = [np.sqrt(flexure.forcing(*axes.unit(i))) for i in range(k)]
    for i in range(k):
        for j in range(k):
            forced = np.diag([0.0, axes.correlation[i, j] * strength[i] * strength[j]])
            out[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = solve_sylvester(drift[i], drift[j].T, -forced)
    return out


def draw(axes: Axes, step: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Stationary paths (k, n + 1, 2) of (theta, theta') at unit standard deviations, apart by steps (n,) s.

    Exact in distribution for each axis, and for all together to the first order of a step times the axes' rates. A
    longer path begins with the shorter one of the same generator.
    """
    from physics.recursion import linear_recursion

    k = len(axes.damping)
    children = rng.spawn(k)
    start = _factor(stationary_covariance(axes)) @ np.concatenate([child.standard_normal(2) for child in children])
    noise = np.stack([child.standard_normal((len(step), 2)) for child in children])
    if not np.array_equal(axes.correlation, np.eye(k)):
        noise = np.einsum("ij,jnc->inc", _factor(axes.correlation), noise)
    size, which = np.unique(np.asarray(step, dtype=float), return_inverse=True)
    paths = []
    for i in range(k):
        f = flexure.transition(*axes.unit(i)[:2], size)
        root = flexure.cholesky(flexure.noise_covariance(*axes.unit(i), size))
        paths.append(linear_recursion(f, root, which, start[2 * i : 2 * i + 2], noise[i]))
    return np.stack(paths)


def between(axes: Axes, t: FloatArray, path: FloatArray, at: FloatArray, rng: np.random.Generator) -> FloatArray:
    """theta (k, m) at increasing instants ``at`` (m,) strictly between those of a path: t (n,), path (k, n, 2)."""
    index = np.searchsorted(t, at) - 1
    chained = np.concatenate([[False], np.diff(index) == 0])
    before = np.where(chained, np.concatenate([[0.0], at[:-1]]), t[index])
    children = rng.spawn(len(path))
    parts = [
        _between(axes.unit(i), path[i], index, chained, at - before, t[index + 1] - at, children[i])
        for i in range(len(path))
    ]
    return np.stack(parts)


def _between(
    unit: tuple[float, float, float], path: FloatArray, index: IntArray, chained: NDArray[np.bool_],
    left: FloatArray, right: FloatArray, rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    from physics.recursion import bridge_recursion

    coefficients = [_bridge(*unit, left[k : k + SLAB], right[k : k + SLAB]) for k in range(0, len(index), SLAB)]
    to_left, to_right, root = (np.concatenate(parts) for parts in zip(*coefficients))
    noise = rng.standard_normal((len(index), 2))
    return bridge_recursion(path, index, chained.astype(np.int64), to_left, to_right, root, noise)[:, 0]


def _bridge(
    damping: float, stiffness: float, std: float, left: FloatArray, right: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x | before, after: gains on both (n, 2, 2) and the factor of the covariance, for spans to either side (n,).

    x = F1 before + n1, after = F2 x + n2: K = Q1 F2^T (F2 Q1 F2^T + Q2)^-1, covariance by Joseph's form.
    """
    f1, f2 = (flexure.transition(damping, stiffness, h) for h in (left, right))
    q1, q2 = (flexure.noise_covariance(damping, stiffness, std, h) for h in (left, right))
    transposed = np.swapaxes(f2, -1, -2)
    gain = q1 @ transposed @ _inverse(f2 @ q1 @ transposed + q2)
    rest = np.eye(2) - gain @ f2
    spread = rest @ q1 @ np.swapaxes(rest, -1, -2) + gain @ q2 @ np.swapaxes(gain, -1, -2)
    return rest @ f1, gain, flexure.cholesky(spread)


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of symmetric (n, 2, 2)."""
    a, b, c = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    return np.stack([c, -b, -b, a], axis=-1).reshape(-1, 2, 2) / (a * c - b * b)[:, None, None]


def _factor(covariance: FloatArray) -> FloatArray:
    """Lower Cholesky factor of a covariance that may be singular."""
    size = np.sqrt(np.diag(covariance))
    scaled = covariance / np.outer(size, size)
    if np.array_equal(scaled, np.eye(len(scaled))):
        return np.diag(size)
    return size[:, None] * np.linalg.cholesky(scaled + JITTER * np.eye(len(scaled)))
