"""Second-order Gauss-Markov flexure against van Loan, closed forms and its own samples."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import welch

from physics import flexure

CASES = {
    "underdamped": (0.12, 0.12**2 + 0.55**2, 1.0),
    "critical": (0.2146, 0.2146**2, 1.7e-3),
    "nearly critical": (0.2, 0.2**2 + 1e-9, 1.0),
    "overdamped": (0.5, 0.1, 2.0),
}
case = pytest.mark.parametrize(("mu", "b2", "std"), CASES.values(), ids=CASES.keys())


def van_loan(mu: float, b2: float, std: float, h: float) -> tuple[np.ndarray, np.ndarray]:
    a = np.array([[0.0, 1.0], [-b2, -2 * mu]])
    big = np.zeros((4, 4))
    big[:2, :2], big[2:, 2:], big[1, 3] = -a, a.T, 4 * mu * b2 * std**2
    e = expm(big * h)
    f = e[2:, 2:].T
    return f, f @ e[:2, 2:]


@case
@pytest.mark.parametrize("h", [1e-4, 5e-3, 0.1, 1.0, 3.0])
def test_discretisation_equals_van_loan(mu: float, b2: float, std: float, h: float) -> None:
    f, q = van_loan(mu, b2, std, h)
    np.testing.assert_allclose(flexure.transition(mu, b2, np.array(h)), f, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(flexure.noise_covariance(mu, b2, std, np.array(h)), q, rtol=1e-7, atol=0)


@case
def test_two_steps_make_one(mu: float, b2: float, std: float) -> None:
    f1, f2, f12 = flexure.transition(mu, b2, np.array([0.3, 1.1, 1.4]))
    q1, q2, q12 = flexure.noise_covariance(mu, b2, std, np.array([0.3, 1.1, 1.4]))
    np.testing.assert_allclose(f2 @ f1, f12, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(f2 @ q1 @ f2.T + q2, q12, rtol=1e-10, atol=1e-15)


@case
def test_stationary_covariance_solves_the_lyapunov_equation(mu: float, b2: float, std: float) -> None:
    a, p = np.array([[0.0, 1.0], [-b2, -2 * mu]]), flexure.stationary_covariance(b2, std)
    residual = a @ p + p @ a.T + np.diag([0.0, flexure.forcing(mu, b2, std)])
    np.testing.assert_allclose(residual, 0.0, atol=1e-15)


def test_long_steps_of_an_overdamped_axis_do_not_overflow() -> None:
    f = flexure.transition(50.0, 100.0, np.array([1e4]))
    assert np.isfinite(f).all()
    np.testing.assert_allclose(f, 0.0, atol=1e-12)


@case
def test_spectrum_and_autocorrelation_are_a_fourier_pair(mu: float, b2: float, std: float) -> None:
    frequency = np.arange(-40_000, 40_001) * 5e-4
    density = flexure.spectrum(mu, b2, std, frequency)
    for lag in (0.0, 1.3, 4.0):
        assert np.trapezoid(density * np.cos(2 * np.pi * frequency * lag), frequency) == pytest.approx(
            flexure.autocorrelation(mu, b2, std, np.array(lag)), abs=2e-4 * std**2
        )


def test_autocorrelation_is_the_corrected_one_of_the_paper() -> None:
    mu, lam, std, lag = 0.15, 0.24, 2.0, np.array([0.0, 1.0, 7.0])
    b = np.hypot(mu, lam)
    paper = std**2 * b / lam * np.exp(-mu * lag) * np.sin(lam * lag + np.arctan(lam / mu))
    np.testing.assert_allclose(flexure.autocorrelation(mu, b * b, std, lag), paper, rtol=1e-12)


def test_samples_have_the_variance_autocorrelation_and_spectrum_of_the_model() -> None:
    mu, lam, std, h, n = 0.4, 0.9, 3.0, 0.25, 400_000
    b2 = mu * mu + lam * lam
    theta, rate = flexure.sample(mu, b2, std, np.full(n, h), np.random.default_rng(3))
    # standard error of the variance: sigma^2 sqrt(2 tau_eff / T), about 0.5 % here
    assert np.var(theta) == pytest.approx(std**2, rel=0.02)
    assert np.var(rate) == pytest.approx(b2 * std**2, rel=0.02)
    for k in (2, 6, 15):
        measured = np.mean(theta[k:] * theta[:-k])
        expected = flexure.autocorrelation(mu, b2, std, np.array(k * h))
        assert measured == pytest.approx(float(expected), abs=0.02 * std**2)
    frequency, power = welch(theta, 1 / h, nperseg=4096, return_onesided=False)
    band = (np.abs(frequency) > 0.01) & (np.abs(frequency) < 0.5)  # well below folding
    ratio = power[band] / flexure.spectrum(mu, b2, std, frequency[band])
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)


def test_uneven_steps_are_drawn_exactly() -> None:
    mu, b2, std = 0.3, 0.5, 1.0
    step = np.tile([0.01, 0.39], 100_000)
    theta, _ = flexure.sample(mu, b2, std, step, np.random.default_rng(4))
    short, long = np.diff(theta)[::2], np.diff(theta)[1::2]
    for increments, h in ((short, 0.01), (long, 0.39)):
        expected = 2 * (std**2 - flexure.autocorrelation(mu, b2, std, np.array(h)))
        assert np.var(increments) == pytest.approx(float(expected), rel=0.03)


def test_interval_means_of_the_rate_do_not_depend_on_how_finely_the_path_is_drawn() -> None:
    mu, b2, std = 0.2, 0.3, 1.0
    coarse, _ = flexure.sample(mu, b2, std, np.full(100_000, 0.2), np.random.default_rng(6))
    fine, _ = flexure.sample(mu, b2, std, np.full(800_000, 0.025), np.random.default_rng(7))
    exact = 2 * (std**2 - flexure.autocorrelation(mu, b2, std, np.array(0.2))) / 0.2**2
    assert np.var(np.diff(coarse) / 0.2) == pytest.approx(float(exact), rel=0.03)
    assert np.var(np.diff(fine[::8]) / 0.2) == pytest.approx(float(exact), rel=0.03)
