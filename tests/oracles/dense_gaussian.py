"""Linear Gaussian models solved all at once: the whole path and all measurements as one normal distribution.

No recursion, no sparsity, no code of the project: the slow, obvious reference for filters and smoothers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve


@dataclass(frozen=True)
class DenseModel:
    """x[k] = F[k] x[k-1] + w[k], cov w = Q[k]; z[k] = H[k] x[k] + v[k], var v = R[k] (NaN in z: not measured)."""

    F: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    z: np.ndarray
    R: np.ndarray
    x0: np.ndarray
    P0: np.ndarray


def path_prior(model: DenseModel) -> tuple[np.ndarray, np.ndarray]:
    """Mean (N n,) and covariance (N n, N n) of x[0..N-1] stacked, before any measurement."""
    steps, n = len(model.F), len(model.x0)
    mean, covariance = np.zeros((steps, n)), np.zeros((steps, n, steps, n))
    x, P = model.x0, model.P0
    for k in range(steps):
        x, P = model.F[k] @ x, model.F[k] @ P @ model.F[k].T + model.Q[k]
        mean[k], covariance[k, :, k] = x, P
        cross = P
        for later in range(k + 1, steps):
            cross = model.F[later] @ cross
            covariance[later, :, k], covariance[k, :, later] = cross, cross.T
    return mean.ravel(), covariance.reshape(steps * n, steps * n)


def condition(model: DenseModel, last: int | None = None) -> tuple[np.ndarray, np.ndarray, float]:
    """Means (N, n), covariances (N, n, n) of the path and log-likelihood, given all up to step ``last``."""
    steps, n = len(model.F), len(model.x0)
    mean, covariance = path_prior(model)
    measured = np.isfinite(model.z)
    if last is not None:
        measured[last + 1 :] = False
    rows = [np.concatenate([np.zeros(k * n), model.H[k, i], np.zeros((steps - k - 1) * n)])
            for k, i in zip(*np.nonzero(measured))]  # fmt: skip
    H, residual = np.array(rows), model.z[measured]
    residual = residual - H @ mean
    S = H @ covariance @ H.T + np.diag(model.R[measured])
    factor = cho_factor(S, lower=True)
    gain = cho_solve(factor, H @ covariance).T
    mean, covariance = mean + gain @ residual, covariance - gain @ H @ covariance
    log_determinant = 2.0 * np.sum(np.log(np.diag(factor[0])))
    likelihood = -0.5 * (residual @ cho_solve(factor, residual) + log_determinant + len(residual) * np.log(2 * np.pi))
    blocks = covariance.reshape(steps, n, steps, n)
    return mean.reshape(steps, n), np.stack([blocks[k, :, k] for k in range(steps)]), float(likelihood)
