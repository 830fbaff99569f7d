"""Regression from Gram matrices of blocks against the same on the stacked rows, slow and obvious."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from stages.diagnose.evidence import (
    Gram,
    Table,
    combined,
    folds,
    gain,
    gram,
    held_out,
    held_out_sum,
    null_evidence,
    shifted,
    solve,
)

NAMES = ("bias x", "bias y", "a", "b", "c")
PRECISION = np.array([4.0, 0.25, 0.0, 0.0, 0.0])
BASE, MORE = [0, 1], [2, 4]


class Stacked:
    """Whitened regressors with their innovations; some are masked."""

    def __init__(self, seed: int = 3, steps: int = 900, effect: float = 0.0) -> None:
        rng = np.random.default_rng(seed)
        self.t = 0.2 * np.arange(steps)
        self.X = rng.standard_normal((steps, 4, 5)) * np.array([1.0, 30.0, 0.02, 1e-4, 5.0])
        self.X[:, :, 4] += 2.0 * self.X[:, :, 0]
        self.y = rng.standard_normal((steps, 4)) + effect * self.X[:, :, 2] + 0.3 * self.X[:, :, 0]
        self.y[rng.random((steps, 4)) < 0.1] = np.nan
        self.y[200:260] = np.nan

    def gram(self) -> Gram:
        return gram(NAMES, self.X, self.y, self.t, PRECISION)

    def rows(self, gram_: Gram, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (k, 5) and innovations (k,) of some blocks."""
        which = np.minimum(np.searchsorted(gram_.edges, self.t, side="right") - 1, len(gram_.blocks) - 1)
        own = np.isin(which, np.flatnonzero(blocks))[:, None] & np.isfinite(self.y)
        return self.X[own], self.y[own]


def ridge(X: np.ndarray, y: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """argmin |y - X v|^2 + v^T P v by least squares on rows with the prior appended."""
    rows = np.vstack([X, np.diag(np.sqrt(precision))])
    return np.linalg.lstsq(rows, np.concatenate([y, np.zeros(len(precision))]), rcond=None)[0]


@pytest.fixture(scope="module")
def stacked() -> Stacked:
    return Stacked()


def test_blocks_add_up_to_all_rows_that_are_not_masked(stacked: Stacked) -> None:
    found = stacked.gram()
    ok = np.isfinite(stacked.y)
    Z = np.column_stack([stacked.X[ok], stacked.y[ok]])
    np.testing.assert_allclose(found.total, Z.T @ Z, rtol=1e-12)
    assert found.count.sum() == ok.sum()
    assert len(found.blocks) == 6
    assert np.ptp(np.diff(found.edges)) < 1e-9


def test_a_short_record_still_has_two_blocks() -> None:
    short = Stacked(steps=50)
    assert len(short.gram().blocks) == 2


@pytest.mark.parametrize("chosen", [[0], BASE, MORE, [0, 1, 2, 3, 4], [3, 1]])
def test_solve_is_the_ridge_regression_of_the_rows(stacked: Stacked, chosen: list[int]) -> None:
    found = stacked.gram()
    X, y = stacked.rows(found, np.ones(len(found.blocks), bool))
    X, P = X[:, chosen], PRECISION[chosen]
    fit = solve(found.total, PRECISION, chosen)
    expected = ridge(X, y, P)
    covariance = np.linalg.inv(X.T @ X + np.diag(P))
    np.testing.assert_allclose(fit.value, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-6, atol=1e-9 * np.abs(covariance).max())
    cost = np.sum((y - X @ expected) ** 2) + expected @ (P * expected)
    assert fit.gain == pytest.approx(0.5 * (y @ y - cost), rel=1e-6)


def test_held_out_evidence_is_what_coefficients_of_one_fold_gain_on_the_other(stacked: Stacked) -> None:
    found = stacked.gram()
    expected = np.zeros(len(found.blocks))
    for train in folds(found):
        X, y = stacked.rows(found, train)
        lesser = ridge(X[:, BASE], y, PRECISION[BASE])
        greater = ridge(X[:, BASE + MORE], y, PRECISION[BASE + MORE])
        for b in np.flatnonzero(~train):
            X_b, y_b = stacked.rows(found, np.arange(len(found.blocks)) == b)
            lost = np.sum((y_b - X_b[:, BASE] @ lesser) ** 2)
            expected[b] = 0.5 * (lost - np.sum((y_b - X_b[:, BASE + MORE] @ greater) ** 2))
    np.testing.assert_allclose(held_out(found, BASE, MORE), expected, rtol=1e-5, atol=1e-6)


def test_the_sum_of_held_out_evidence_needs_no_blocks(stacked: Stacked) -> None:
    found = stacked.gram()
    assert held_out_sum(found, BASE, MORE) == pytest.approx(held_out(found, BASE, MORE).sum(), rel=1e-9)


def test_a_table_widened_by_regressors_is_the_gram_of_all_of_them(stacked: Stacked) -> None:
    whole, kept = stacked.gram(), [0, 1, 3]
    table = Table.of([NAMES[k] for k in kept], stacked.X, stacked.y, stacked.t, PRECISION[kept], chosen=kept)
    wider = table.widened([NAMES[2], NAMES[4]], stacked.X[:, :, [2, 4]], PRECISION[[2, 4]])
    order = [*whole.index(wider.names), len(NAMES)]
    np.testing.assert_allclose(wider.blocks, whole.blocks[:, order][:, :, order], rtol=1e-12)
    np.testing.assert_array_equal(wider.precision, whole.precision[order[:-1]])
    np.testing.assert_array_equal(wider.count, whole.count)


def test_folds_are_interleaved_and_share_no_block(stacked: Stacked) -> None:
    even, odd = folds(stacked.gram())
    np.testing.assert_array_equal(even, ~odd)
    np.testing.assert_array_equal(np.flatnonzero(odd), [1, 3, 5])


def test_an_effect_gains_held_out_and_its_absence_does_not() -> None:
    there, absent = Stacked(effect=20.0).gram(), Stacked(effect=0.0).gram()
    assert held_out(there, BASE, [2]).sum() > 50.0
    assert held_out(absent, BASE, [2]).sum() < 4.0


def test_gain_in_sample_is_the_difference_of_two_fits(stacked: Stacked) -> None:
    found = stacked.gram()
    X, y = stacked.rows(found, np.ones(len(found.blocks), bool))

    def cost(chosen: list[int]) -> float:
        value = ridge(X[:, chosen], y, PRECISION[chosen])
        return float(np.sum((y - X[:, chosen] @ value) ** 2) + value @ (PRECISION[chosen] * value))

    assert gain(found, BASE, MORE) == pytest.approx(0.5 * (cost(BASE) - cost(BASE + MORE)), rel=1e-5, abs=1e-6)


def test_shifted_is_the_gram_of_innovations_with_columns_added(stacked: Stacked) -> None:
    found = stacked.gram()
    again = Stacked()
    again.y = again.y + 3.0 * again.X[:, :, 2] - 0.5 * again.X[:, :, 0]
    expected = again.gram()
    moved = shifted(found, [2, 0], np.array([3.0, -0.5]))
    np.testing.assert_allclose(moved.blocks, expected.blocks, rtol=1e-9, atol=1e-9 * np.abs(expected.blocks).max())
    np.testing.assert_array_equal(found.blocks, stacked.gram().blocks)


def test_beside_a_process_both_folds_are_fitted_together(stacked: Stacked) -> None:
    """Coefficients of one fold would say nothing of what the process does in the other."""
    found = replace(stacked.gram(), names=("wander 0", *NAMES[1:]))
    told = gain(found, BASE, MORE) - len(MORE)
    assert held_out_sum(found, BASE, MORE) == pytest.approx(told)
    assert held_out(found, BASE, MORE).sum() == pytest.approx(told)
    X, y = stacked.rows(found, np.arange(len(found.blocks)) == 3)
    P = PRECISION
    whole = stacked.rows(found, np.ones(len(found.blocks), bool))
    lesser, greater = (y - X[:, k] @ ridge(whole[0][:, k], whole[1], P[k]) for k in (BASE, BASE + MORE))
    blocks = held_out(found, BASE, MORE)
    others = [0.5 * float(r @ r) for r in (lesser, greater)]
    rest = blocks[3] - (others[0] - others[1])  # the price and what the priors cost, the same for each block
    assert abs(rest) < 2.0


@pytest.mark.parametrize("first", ["bias x", "wander 0"])
def test_null_evidence_is_distributed_as_in_replays_of_white_noise(first) -> None:
    short, draws, names = Stacked(steps=300), 200, (first, *NAMES[1:])
    found = replace(short.gram(), names=names)
    rng = np.random.default_rng(8)
    quick = [null_evidence(found, BASE, [MORE], rng, 1)[0] for _ in range(draws)]
    slow = []
    for _ in range(draws):
        replay = np.where(np.isfinite(short.y), rng.standard_normal(short.y.shape), np.nan)
        slow.append(held_out(gram(names, short.X, replay, short.t, PRECISION), BASE, MORE).sum())
    assert stats.ks_2samp(quick, slow).pvalue > 1e-3
    assert np.mean(quick) == pytest.approx(np.mean(slow), abs=0.5)


def test_null_evidence_is_the_largest_of_its_draws(stacked: Stacked) -> None:
    few, many = (
        null_evidence(stacked.gram(), BASE, [[2], MORE], np.random.default_rng(2), draws) for draws in (5, 400)
    )
    assert many.shape == (2,)
    assert (many > few).all()
    assert (many < 14.0).all()  # the floor of the selection


def test_a_combination_of_some_columns_is_that_of_the_columns_alone() -> None:
    rng = np.random.default_rng(7)
    columns, values = rng.standard_normal((50, 3, 6)), rng.standard_normal(2)
    np.testing.assert_allclose(combined(columns, [4, 1], values), columns[:, :, [4, 1]] @ values, atol=1e-13)
