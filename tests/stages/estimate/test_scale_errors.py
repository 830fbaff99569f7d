"""Sizes of scale errors learnt from a posterior, against dense normal distributions of the measurements themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from stages.estimate import scale_errors
from stages.estimate.scale_errors import sizes

USUAL = np.broadcast_to(np.where(np.eye(3, dtype=bool), 7e-6, 2e-5), (2, 3, 3))
ALL = np.ones(4, bool)


def posterior(H: np.ndarray, y: np.ndarray, noise: float, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    P = np.linalg.inv(np.diag(prior.ravel() ** -2.0) + H.T @ H / noise**2)
    return P @ H.T @ y / noise**2, P


def test_marginal_likelihood_of_other_priors_is_that_of_the_measurements() -> None:
    rng = np.random.default_rng(1)
    H, noise = rng.standard_normal((30, 18)), 1e-5
    y = H @ (USUAL.ravel() * rng.standard_normal(18)) + noise * rng.standard_normal(30)
    mean, P = posterior(H, y, noise, USUAL)
    sigma = USUAL.ravel()
    information, shown = scale_errors._information(mean / sigma, P / np.outer(sigma, sigma))
    widths = rng.uniform(0.1, 5.0, (4, 18))
    found = scale_errors._log_marginal(information, shown, widths)
    expected = [
        multivariate_normal(np.zeros(30), H @ np.diag((width * sigma) ** 2) @ H.T + noise**2 * np.eye(30)).logpdf(y)
        for width in widths
    ]
    np.testing.assert_allclose(np.diff(found), np.diff(expected), rtol=1e-6)


@pytest.mark.parametrize("factor", [0.1, 1.0, 6.0, 50.0])
def test_sizes_follow_from_what_is_seen_for_what_is_not_seen_too(factor: float) -> None:
    rng = np.random.default_rng(2)
    seen = np.delete(np.eye(18), [2, 7, 11], axis=0)  # three errors leave no trace
    ratios = []
    for _ in range(40):
        y = seen @ (factor * USUAL.ravel() * rng.standard_normal(18)) + 1e-6 * rng.standard_normal(15)
        ratios.append(sizes(*posterior(seen, y, 1e-6, USUAL), USUAL, USUAL, ALL) / (factor * USUAL))
    middle = np.exp(np.mean(np.log(ratios), axis=0))
    assert np.all((middle > 0.75) & (middle < 1.5)), middle


def test_where_nothing_is_seen_the_usual_sizes_stay() -> None:
    prior = 2.0 * USUAL
    found = sizes(np.zeros(18), np.diag(prior.ravel() ** 2), prior, USUAL, ALL)
    np.testing.assert_allclose(found, USUAL, rtol=0.05)


def test_errors_there_are_none_of_are_not_held_for_large_and_stated_ones_stay() -> None:
    mean, P = posterior(np.eye(18), np.zeros(18), 1e-6, USUAL)
    free = np.array([True, True, True, False])
    found = sizes(mean, P, USUAL, USUAL, free)
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose(found[1][off], USUAL[1][off], rtol=1e-12)
    assert np.all(found[0] < 0.25 * USUAL[0])
