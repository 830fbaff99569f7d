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

RULE = np.polynomial.legendre.leggauss(8)  # for steps of the forcing's covariance
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
    from physics.recursion import bridge_recursion

    index = np.searchsorted(t, at) - 1
    chained = np.concatenate([[False], np.diff(index) == 0])
    left = at - np.where(chained, np.concatenate([[0.0], at[:-1]]), t[index])
    right, rule = t[index + 1] - at, np.array(RULE)
    parts = []
    for i, child in enumerate(rng.spawn(len(path))):
        mu, b2, _ = axes.unit(i)
        noise = child.standard_normal((len(at), 2))
        parts.append(bridge_recursion(path[i], index, chained, left, right, mu, b2, rule, noise)[:, 0])
    return np.stack(parts)


def _factor(covariance: FloatArray) -> FloatArray:
    """Lower Cholesky factor of a covariance that may be singular."""
    size = np.sqrt(np.diag(covariance))
    scaled = covariance / np.outer(size, size)
    if np.array_equal(scaled, np.eye(len(scaled))):
        return np.diag(size)
    return size[:, None] * np.linalg.cholesky(scaled + JITTER * np.eye(len(scaled)))
