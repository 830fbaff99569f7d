from __future__ import annotations

import numpy as np

from physics.normal import solve_normal


def test_units_that_differ_by_many_powers_of_ten_are_solved_as_least_squares_does() -> None:
    rng = np.random.default_rng(4)
    X = rng.standard_normal((60, 4)) * np.array([1.0, 1e8, 1e-7, 30.0])
    y = rng.standard_normal((60, 2))
    expected = np.linalg.lstsq(X / np.linalg.norm(X, axis=0), y, rcond=None)[0] / np.linalg.norm(X, axis=0)[:, None]
    np.testing.assert_allclose(solve_normal(X.T @ X, X.T @ y), expected, rtol=1e-7)
    np.testing.assert_allclose(solve_normal(X.T @ X, X.T @ y[:, 0]), expected[:, 0], rtol=1e-7)


def test_columns_that_are_one_another_or_nothing_share_or_stay_at_nothing() -> None:
    one = np.random.default_rng(5).standard_normal(50)
    X = np.stack([one, one, 0.0 * one], axis=1)
    found = solve_normal(X.T @ X, X.T @ (3.0 * one))
    np.testing.assert_allclose(found, [1.5, 1.5, 0.0], rtol=1e-6, atol=1e-9)
