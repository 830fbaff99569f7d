"""The regression of the deck shape, slow and obvious: one dense Gaussian conditional, no factorisation shared."""

from __future__ import annotations

import numpy as np


def dense_posterior(
    X: np.ndarray, y: np.ndarray, C: np.ndarray, P: np.ndarray, mean: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of beta | y for y = X beta + e, beta ~ N(mean, P^-1), e ~ N(0, C): conditioning the joint."""
    S = np.linalg.inv(P)
    gain = S @ X.T @ np.linalg.inv(X @ S @ X.T + C)
    return mean + gain @ (y - X @ mean), S - gain @ X @ S


def dense_evidence(X: np.ndarray, y: np.ndarray, C: np.ndarray, P: np.ndarray) -> float:
    """log N(y; 0, X P^-1 X' + C)."""
    whole = X @ np.linalg.inv(P) @ X.T + C
    _, logdet = np.linalg.slogdet(2.0 * np.pi * whole)
    return float(-0.5 * (y @ np.linalg.solve(whole, y) + logdet))
