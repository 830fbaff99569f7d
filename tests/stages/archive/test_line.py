"""The line with its excess scatter, against least squares, a dense likelihood on a grid, and its own coverage."""

import numpy as np
import pytest
from scipy.stats import linregress, multivariate_normal

from stages.archive.line import fitted
from stages.archive.trends import MONTH_NS, apart, drift, months_since, power_law


def drawn(rng, n=25, slope=0.4, excess=0.8, std=(0.2, 1.0)):
    x = np.sort(rng.uniform(0.0, 24.0, n))
    s = rng.uniform(*std, n)
    return x, 3.0 + slope * x + rng.normal(0, excess, n) + s * rng.normal(size=n), s


def test_points_without_a_spread_of_their_own_give_ordinary_least_squares():
    rng = np.random.default_rng(1)
    x, y, _ = drawn(rng)
    line, plain = fitted(x, y, np.zeros(len(x))), linregress(x, y)
    assert line.slope == pytest.approx(plain.slope, rel=1e-6)
    assert line.slope_std == pytest.approx(plain.stderr, rel=1e-3)
    assert line.p_value == pytest.approx(plain.pvalue, rel=1e-2)
    assert line.value == pytest.approx(plain.intercept + plain.slope * line.centre)


def restricted_on_a_grid(x, y, std, grid):
    """The same likelihood from its definition: the density of contrasts that no line can reach."""
    design = np.stack([np.ones(len(x)), x], axis=1)
    left = np.linalg.svd(design)[0][:, 2:]
    z = left.T @ y
    densities = [multivariate_normal(cov=left.T @ np.diag(std**2 + e**2) @ left).logpdf(z) for e in grid]
    return grid[int(np.argmax(densities))]


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_excess_maximises_the_density_of_the_contrasts(seed):
    x, y, s = drawn(np.random.default_rng(seed))
    grid = np.linspace(0.0, 2.5, 501)
    found = fitted(x, y, s)
    assert found.excess == pytest.approx(restricted_on_a_grid(x, y, s, grid), abs=0.006)
    weight = 1.0 / (s**2 + found.excess**2)
    design = np.stack([np.ones(len(x)), x], axis=1) * np.sqrt(weight)[:, None]
    assert found.slope == pytest.approx(np.linalg.lstsq(design, y * np.sqrt(weight), rcond=None)[0][1], rel=1e-5)


def test_points_that_scatter_as_they_say_have_no_excess():
    x, y, s = drawn(np.random.default_rng(5), excess=0.0)
    line = fitted(x, 3.0 + 0.4 * x + 0.3 * (y - 3.0 - 0.4 * x), s)  # they scatter even less
    assert line.excess == 0.0
    assert line.chi2 < line.dof


def test_its_interval_holds_the_true_slope_as_often_as_it_says():
    inside = []
    for seed in range(200):
        line = fitted(*drawn(np.random.default_rng(seed), n=12))
        inside.append(line.slope_ci95[0] < 0.4 < line.slope_ci95[1])
    assert 0.90 <= np.mean(inside) <= 0.99


def test_scale_and_origin_do_not_matter():
    x, y, s = drawn(np.random.default_rng(7))
    line, other = fitted(x, y, s), fitted(1e6 + 1e-3 * x, 1e4 * y - 5e7, 1e4 * s)
    assert other.slope == pytest.approx(1e7 * line.slope, rel=1e-4)
    assert other.excess == pytest.approx(1e4 * line.excess, rel=1e-3)
    assert other.p_value == pytest.approx(line.p_value, rel=1e-3)


def test_what_is_not_known_is_left_out_and_too_few_give_no_line():
    x, y, s = drawn(np.random.default_rng(8))
    holed = y.copy()
    holed[3] = np.nan
    line = fitted(x, holed, s)
    assert line.count == len(x) - 1
    assert line.slope == fitted(np.delete(x, 3), np.delete(y, 3), np.delete(s, 3)).slope
    assert np.isnan(fitted(x[:2], y[:2], s[:2]).slope)
    assert np.isnan(fitted(np.ones(9), y[:9], s[:9]).slope)


def test_equal_values_are_a_flat_line():
    line = fitted(np.arange(5.0), np.full(5, 7.0), np.full(5, 0.1))
    assert line.slope == pytest.approx(0.0, abs=1e-12)
    assert line.value == pytest.approx(7.0)
    assert line.p_value == pytest.approx(1.0)


def test_a_drift_is_told_per_mean_month():
    epoch = 1_700_000_000_000_000_000
    stamp = epoch + (np.arange(12) * MONTH_NS).astype(np.int64)
    np.testing.assert_allclose(months_since(stamp, epoch), np.arange(12), atol=1e-9)
    line = drift(stamp, 10.0 + 0.5 * np.arange(12), np.full(12, 0.1), epoch)
    assert line.slope == pytest.approx(0.5)
    assert line.slope_std == pytest.approx(0.1 / np.sqrt(np.sum((np.arange(12) - 5.5) ** 2)), rel=1e-3)


def test_flexure_that_grows_with_the_square_of_the_sea():
    rng = np.random.default_rng(9)
    sea = rng.uniform(0.5, 4.0, 40)
    flexure = 0.7 * sea**2 * np.exp(rng.normal(0, 0.1, 40))
    line = power_law(np.append(sea, 0.0), np.append(flexure, 1.0), np.full(41, 0.1))
    assert line.count == 40
    assert line.slope == pytest.approx(2.0, abs=4 * line.slope_std)
    assert line.slope_std < 0.05


def test_a_voyage_off_the_line_stands_out():
    x, y, s = drawn(np.random.default_rng(10), excess=0.0)
    y[4] += 12.0
    away = apart(fitted(x, y, s), x, y, s)
    assert abs(away[4]) > 8
    assert np.abs(np.delete(away, 4)).max() < 3.5


def test_points_of_a_line_with_excess_scatter_do_not_stand_out():
    x, y, s = drawn(np.random.default_rng(11), n=200)
    away = apart(fitted(x, y, s), x, y, s)
    assert 0.8 < np.std(away) < 1.2
