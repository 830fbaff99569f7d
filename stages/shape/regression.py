"""Generalised least squares with Gaussian priors and coloured noise, one axis at a time.

    y = X beta + e,   beta ~ N(0, P^-1),   e ~ N(0, C),   C block-diagonal over runs

with, within a run, C_ij = (r/n_i) delta_ij + sigma_b^2 + g^2 (1 - b tau) exp(-b tau), tau = |t_i - t_j|: white noise of
a mean of n_i samples, the run's own gyro bias, and the rate of a second-order critically damped Gauss-Markov flexure
(std sigma, inverse time b, g = b sigma) that nothing in X explains. That is a process of three states, so that C need
not be written out: rows are divided by its Cholesky factor by the filter whose innovations they are. Noise and prior
parameters maximise the marginal likelihood (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006,
ch. 5) times weak priors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from physics.flexure import noise_covariance, stationary_covariance, transition
from physics.innovations import innovations
from schemas.rig import FloatArray

NOISE_CALLS, PRIOR_CALLS = 50, 100  # evaluations of the likelihood in one search

Precision = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Run:
    """Rows of one run and one axis. y: (n,) rad/s. X: (n, p). t: (n,) s, increasing. count: (n,) samples averaged in
    each row."""

    y: FloatArray
    X: FloatArray
    t: FloatArray
    count: FloatArray


@dataclass(frozen=True)
class Guess:
    """Gaussian belief about log parameters: mean and std (k,)."""

    mean: FloatArray
    std: FloatArray

    def cost(self, x: FloatArray) -> float:
        """Minus log density of x (k,), up to a constant."""
        return float(0.5 * np.sum(((x - self.mean) / self.std) ** 2))


@dataclass(frozen=True)
class Normal:
    """Normal equations: gram X'C^-1X (p, p), right X'C^-1y (p,), square y'C^-1y, logdet of C, rows n."""

    gram: FloatArray
    right: FloatArray
    square: float
    logdet: float
    rows: int

    def __add__(self, other: Normal) -> Normal:
        return Normal(
            self.gram + other.gram,
            self.right + other.right,
            self.square + other.square,
            self.logdet + other.logdet,
            self.rows + other.rows,
        )


@dataclass(frozen=True)
class Posterior:
    """Mean (p,) and covariance (p, p) of beta."""

    mean: FloatArray
    covariance: FloatArray


def whitened(run: Run, noise: FloatArray) -> tuple[FloatArray, float]:
    """[X y] of a run (n, p + 1) divided by the Cholesky factor of C, and log det C.

    noise: logs of r (one sample's variance), g, b, sigma_b. Raises LinAlgError where C is not positive definite.
    """
    r, g, b, bias = np.exp(noise)
    step = np.diff(run.t, prepend=run.t[0])
    F, Q = transition(b, b * b, step), noise_covariance(b, b * b, g / b, step)
    both = np.column_stack([run.X, run.y])
    constant = np.zeros(len(step))
    log_det = innovations(F, Q, stationary_covariance(b * b, g / b), bias**2, constant, 1, r / run.count, both)
    if not np.isfinite(log_det):
        raise np.linalg.LinAlgError("the noise of a run is not positive definite")
    return both, float(log_det)


def normal(run: Run, noise: FloatArray) -> Normal:
    """Normal equations of one run."""
    both, logdet = whitened(run, noise)
    full = both.T @ both
    return Normal(full[:-1, :-1], full[:-1, -1], float(full[-1, -1]), logdet, len(run.y))


def total(runs: Sequence[Run], noise: FloatArray) -> Normal:
    """Normal equations of all runs together."""
    return added([normal(run, noise) for run in runs])


def added(parts: Sequence[Normal]) -> Normal:
    """Sum of normal equations."""
    out = parts[0]
    for part in parts[1:]:
        out = out + part
    return out


def evidence(n: Normal, P: FloatArray) -> float:
    """log p(y) of the data in n under prior precision P (p, p)."""
    scale = 1.0 / np.sqrt(np.diag(n.gram) + np.diag(P))
    both = cholesky(scale[:, None] * (n.gram + P) * scale, lower=True, check_finite=False)
    prior = cholesky(scale[:, None] * P * scale, lower=True, check_finite=False)
    fitted = solve_triangular(both, scale * n.right, lower=True, check_finite=False)
    volume = np.sum(np.log(np.diag(both))) - np.sum(np.log(np.diag(prior)))
    return float(-0.5 * (n.square - fitted @ fitted + n.logdet) - volume - 0.5 * n.rows * np.log(2.0 * np.pi))


def posterior(n: Normal, P: FloatArray, prior_mean: FloatArray | None = None) -> Posterior:
    """Posterior of beta under prior N(prior_mean, P^-1); zero mean by default."""
    scale = 1.0 / np.sqrt(np.diag(n.gram) + np.diag(P))
    factor = cho_factor(scale[:, None] * (n.gram + P) * scale, lower=True, check_finite=False)
    right = n.right if prior_mean is None else n.right + P @ prior_mean
    inverse = cho_solve(factor, np.eye(len(scale)), check_finite=False)
    return Posterior(scale * cho_solve(factor, scale * right, check_finite=False), scale[:, None] * inverse * scale)


def maximise(
    runs: Sequence[Run],
    precision: Precision,
    noise: Guess,
    prior: Guess,
    start: tuple[FloatArray, FloatArray],
    rounds: int,
) -> tuple[FloatArray, FloatArray]:
    """Noise and prior parameters (logs) of greatest marginal likelihood, alternating between the two groups.

    A group at a time, because the normal equations do not depend on the prior: its share of the search is cheap.
    """
    x, z = start
    for _ in range(rounds):
        x = _best_noise(runs, precision(z), noise, x)
        z = _best_prior(total(runs, x), precision, prior, z)
    return x, z


def _best_noise(runs: Sequence[Run], P: FloatArray, noise: Guess, start: FloatArray) -> FloatArray:
    return _search(lambda x: noise.cost(x) - _evidence(runs, x, P), start, noise, NOISE_CALLS)


def _best_prior(n: Normal, precision: Precision, prior: Guess, start: FloatArray) -> FloatArray:
    return _search(lambda z: prior.cost(z) - _safe(n, precision(z)), start, prior, PRIOR_CALLS)


def _search(cost: Callable[[FloatArray], float], start: FloatArray, guess: Guess, calls: int) -> FloatArray:
    simplex = np.vstack([start, start + np.diag(np.minimum(guess.std, 1.5))])
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": calls, "xatol": 0.03, "fatol": 0.05},
    )
    return np.asarray(found.x)


def _evidence(runs: Sequence[Run], noise: FloatArray, P: FloatArray) -> float:
    try:
        return _safe(total(runs, noise), P)
    except np.linalg.LinAlgError:
        return -1e12


def _safe(n: Normal, P: FloatArray) -> float:
    try:
        return evidence(n, P)
    except np.linalg.LinAlgError:
        return -1e12
