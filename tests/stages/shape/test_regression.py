"""The least squares underneath, against a dense Gaussian conditional."""

import numpy as np
import pytest

from stages.shape import regression as gls
from stages.shape.basis import CurveBasis, ShareBasis
from tests.oracles.dense_regression import dense_evidence, dense_posterior

NOISE = np.log([0.3, 0.8, 0.6, 0.2])


@pytest.fixture
def runs() -> list[gls.Run]:
    rng = np.random.default_rng(3)
    out = []
    for n in (30, 22):
        t = np.sort(rng.uniform(0.0, 12.0, n))
        out.append(gls.Run(rng.standard_normal(n), rng.standard_normal((n, 5)), t, rng.integers(1, 9, n).astype(float)))
    return out


def covariance(noise: np.ndarray, t: np.ndarray, count: np.ndarray) -> np.ndarray:
    """C of one run, number by number."""
    r, g, b, bias = np.exp(noise)
    C = np.empty((len(t), len(t)))
    for i, ti in enumerate(t):
        for j, tj in enumerate(t):
            lag = b * abs(ti - tj)
            C[i, j] = g**2 * (1 - lag) * np.exp(-lag) + bias**2 + (r / count[i] if i == j else 0.0)
    return C


def stacked(runs: list[gls.Run]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    blocks = [covariance(NOISE, run.t, run.count) for run in runs]
    size = sum(len(C) for C in blocks)
    whole, at = np.zeros((size, size)), 0
    for C in blocks:
        whole[at : at + len(C), at : at + len(C)] = C
        at += len(C)
    return np.vstack([run.X for run in runs]), np.concatenate([run.y for run in runs]), whole


@pytest.mark.parametrize("noise", [NOISE, np.log([1e-3, 3.0, 0.02, 5.0]), np.log([1e-9, 1.0, 30.0, 1e-6])])
def test_rows_are_divided_by_the_cholesky_factor_of_their_covariance(runs: list[gls.Run], noise: np.ndarray) -> None:
    run = runs[0]
    white, log_det = gls.whitened(run, noise)
    C = covariance(noise, run.t, run.count)
    np.testing.assert_allclose(np.linalg.cholesky(C) @ white, np.column_stack([run.X, run.y]), rtol=1e-6, atol=1e-9)
    assert log_det == pytest.approx(np.linalg.slogdet(C)[1], abs=1e-7)


def test_noise_that_is_none_is_refused(runs: list[gls.Run]) -> None:
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        gls.whitened(runs[0], np.array([-800.0, -800.0, 0.0, -800.0]))


def test_posterior_is_the_dense_gaussian_conditional(runs: list[gls.Run]) -> None:
    P, mean = np.diag([1.0, 4.0, 0.5, 2.0, 1.0]) + 0.1, np.array([0.3, -0.2, 0.0, 1.0, 0.5])
    found = gls.posterior(gls.total(runs, NOISE), P, mean)
    expected, covariance = dense_posterior(*stacked(runs), P, mean)
    np.testing.assert_allclose(found.mean, expected, atol=1e-10)
    np.testing.assert_allclose(found.covariance, covariance, atol=1e-10)


def test_evidence_is_the_density_of_the_data(runs: list[gls.Run]) -> None:
    P = np.diag([1.0, 4.0, 0.5, 2.0, 1.0]) + 0.1
    assert gls.evidence(gls.total(runs, NOISE), P) == pytest.approx(dense_evidence(*stacked(runs), P), abs=1e-8)


def test_search_finds_the_noise_that_made_the_data() -> None:
    rng = np.random.default_rng(5)
    true = np.log([0.04, 0.5, 0.4, 1e-3])
    t = np.arange(150) * 0.2
    factor = np.linalg.cholesky(covariance(true, t, np.ones(150)))
    runs = [gls.Run(factor @ rng.standard_normal(150), np.ones((150, 1)), t, np.ones(150)) for _ in range(4)]
    weak = gls.Guess(np.log([0.2, 0.2, 0.2, 1e-3]), np.array([2.0, 2.0, 1.0, 0.3]))
    nothing = gls.Guess(np.zeros(1), np.ones(1))
    noise, _ = gls.maximise(runs, lambda _: np.eye(1), weak, nothing, (weak.mean, nothing.mean), rounds=2)
    np.testing.assert_allclose(noise[:3], true[:3], atol=0.5)


def test_curve_prior_leaves_a_straight_line_free_and_integrates_exactly() -> None:
    basis = CurveBasis(-1.0, 49.0)
    line = np.linspace(2.0, 3.0, basis.size)
    wiggle = line + 1e-3 * (-1.0) ** np.arange(basis.size)
    P = basis.precision(np.full(basis.size - 2, np.log(1e-12))) - np.eye(basis.size) / 1e-4
    assert line @ P @ line < 1e-6 * (wiggle @ P @ wiggle)
    s = np.array([0.0, 7.3, 31.0])
    slope = 1.0 / (basis.size - 1) / basis.step
    level = 2.0 + slope * basis.step * ((0.0 - basis.low) / basis.step + 1.0)
    np.testing.assert_allclose(basis.turned(line[:, None], s)[:, 0], level * s + 0.5 * slope * s**2, rtol=1e-9)


def test_prior_intensity_is_greater_at_an_end_when_told_so() -> None:
    basis = CurveBasis(0.0, 100.0)
    psd = np.exp(basis.log_psd(np.log([1e-16, 1e-12, 1e-18, 10.0])))
    assert psd[0] == pytest.approx(1e-12, rel=1e-3)
    assert psd[-1] == pytest.approx(1e-16, rel=2e-2)


def test_share_hats_add_up_to_one() -> None:
    np.testing.assert_allclose(ShareBasis(0.0, 50.0).matrix(np.linspace(0, 50, 33)).sum(axis=1), 1.0)
