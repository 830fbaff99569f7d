"""Innovations against the joint normal distribution of everything that was seen, written out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from physics import flexure
from physics.innovations import innovations

MU, B2, STD = 0.08, 0.02, 1.3


def seen_theta(t: np.ndarray) -> np.ndarray:
    lag = np.abs(t[:, None] - t)
    return flexure.autocorrelation(MU, B2, STD, lag.ravel()).reshape(lag.shape)


def seen_rate(t: np.ndarray) -> np.ndarray:
    """Minus the second derivative of the autocorrelation, by the transition of theta' alone."""
    lag = np.abs(t[:, None] - t)
    return B2 * STD**2 * flexure.transition(MU, B2, lag)[..., 1, 1]


@pytest.mark.parametrize(("seen", "covariance"), [(0, seen_theta), (1, seen_rate)])
def test_the_innovations_are_those_of_the_joint_distribution(seen: int, covariance) -> None:
    rng, n = np.random.default_rng(3), 30
    t = np.cumsum(rng.uniform(0.5, 3.0, n))
    step = np.diff(t, prepend=t[0])
    walk, level, noise = 0.05 * step, 0.3, rng.uniform(1e-4, 1e-2, n)
    grown = level + np.minimum.outer(np.cumsum(walk), np.cumsum(walk))
    C = covariance(t) + grown + np.diag(noise)
    both = np.column_stack([rng.multivariate_normal(np.zeros(n), C), rng.standard_normal((n, 2))])
    kept = np.ones(n, dtype=bool)
    kept[7:12] = False
    white = np.where(kept[:, None], both, np.nan)
    F, Q = flexure.transition(MU, B2, step), flexure.noise_covariance(MU, B2, STD, step)
    log_det = innovations(F, Q, flexure.stationary_covariance(B2, STD), level, walk, seen, noise, white)
    assert not white[7:12].any()
    part = C[np.ix_(kept, kept)]
    np.testing.assert_allclose(np.linalg.cholesky(part) @ white[kept], both[kept], rtol=1e-7, atol=1e-9)
    told = -0.5 * (float(white[:, 0] @ white[:, 0]) + log_det + kept.sum() * np.log(2.0 * np.pi))
    assert told == pytest.approx(multivariate_normal(cov=part).logpdf(both[kept, 0]), rel=1e-8)


def test_noise_that_is_none_is_told() -> None:
    nothing = np.zeros((3, 2, 2))
    assert np.isnan(innovations(nothing, nothing, nothing[0], 0.0, np.zeros(3), 0, np.zeros(3), np.ones((3, 1))))
