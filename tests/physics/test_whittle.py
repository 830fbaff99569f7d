"""The exact sampled spectrum against the autocovariance summed, and the fit against paths of known parameters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import periodogram as scipy_periodogram
from scipy.signal.windows import tukey

from physics import flexure, whittle
from physics.units import ARCMIN, DEG_PER_SQRT_HOUR

SECOND_ORDER = {
    "underdamped": (0.12, 0.12**2 + 0.55**2),
    "critical": (0.2146, 0.2146**2),
    "a hair from critical": (0.2146, 0.2146**2 * (1 + 1e-7)),
    "overdamped": (0.5, 0.1),
}
damping_cases = pytest.mark.parametrize(("mu", "b2"), SECOND_ORDER.values(), ids=SECOND_ORDER.keys())


def increment_autocovariance(mu: float, b2: float, sigma: float, noise: float, T: float, lag: np.ndarray) -> np.ndarray:
    """cov(theta_k+1 - theta_k, theta_k+1+n - theta_k+n) = 2 R(n) - R(n - 1) - R(n + 1), and N^2 T at n = 0.

    R(n) = sigma^2 exp(-mu t)(cos l t + mu/l sin l t) by the textbook, hyperbolic where overdamped, 1 + mu t in between.
    """
    split = b2 - mu * mu

    def correlation(n: np.ndarray) -> np.ndarray:
        t, rate = np.abs(n) * T, np.sqrt(abs(split))
        if rate < 1e-3 * mu:  # two terms of the series about critical damping
            shape = 1.0 + mu * t - split * t * t * (0.5 + mu * t / 6.0)
            return sigma**2 * np.exp(-mu * t) * shape
        if split > 0.0:
            return sigma**2 * np.exp(-mu * t) * (np.cos(rate * t) + mu / rate * np.sin(rate * t))
        slow, fast = mu - rate, mu + rate
        return sigma**2 * (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (2.0 * rate)

    covariance = 2.0 * correlation(lag) - correlation(lag - 1) - correlation(lag + 1)
    return covariance + np.where(lag == 0, noise**2 * T, 0.0)


@damping_cases
@pytest.mark.parametrize("T", [0.5, 0.1])
def test_increment_spectrum_is_the_fourier_sum_of_the_autocovariance(mu: float, b2: float, T: float) -> None:
    sigma, noise = 1.7, 0.03
    slow = mu - np.sqrt(max(mu * mu - b2, 0.0))
    lag = np.arange(-int(45 / slow / T), int(45 / slow / T) + 1)
    omega = np.array([0.01, 0.1, 0.4, 1.0, 2.0, 3.0, np.pi])
    covariance = increment_autocovariance(mu, b2, sigma, noise, T, lag)
    expected = np.cos(np.outer(omega, lag)) @ covariance
    found = whittle.increment_spectrum(omega, mu, b2, sigma, noise, T)
    # The sum of cancelling terms of the size of the variance cannot be better than its rounding.
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-11 * covariance.max() * len(lag))


@damping_cases
def test_spectra_integrate_to_the_variances(mu: float, b2: float) -> None:
    sigma, noise, T = 0.8, 0.02, 0.2
    omega = (np.arange(200_000) + 0.5) / 200_000 * np.pi
    assert whittle.sampled_spectrum(omega, mu, b2, sigma, T).mean() == pytest.approx(sigma**2, rel=1e-6)
    variance = increment_autocovariance(mu, b2, sigma, noise, T, np.array([0]))[0]
    assert whittle.increment_spectrum(omega, mu, b2, sigma, noise, T).mean() == pytest.approx(variance, rel=1e-6)


def test_fast_sampling_gives_the_continuous_spectrum() -> None:
    mu, b2, sigma, T = 0.15, 0.08, 2.0, 0.01
    frequency = np.array([0.01, 0.05, 0.2, 1.0])
    found = whittle.sampled_spectrum(2 * np.pi * frequency * T, mu, b2, sigma, T)
    np.testing.assert_allclose(found * T, flexure.spectrum(mu, b2, sigma, frequency), rtol=1e-4)


def test_periodogram_of_white_noise_has_its_variance() -> None:
    x = 0.3 * np.random.default_rng(1).standard_normal(60_000)
    found = whittle.periodogram([x[:20_000], x[20_000:]])
    total = np.sum(found.power * found.count) / found.count.sum()
    assert total == pytest.approx(0.09, rel=4 * np.sqrt(1 / 30_000))
    assert found.count.sum() == 9_999 + 19_999
    assert np.all(np.diff(found.omega) >= 0.0)


def test_periodogram_keeps_low_frequencies_apart_and_pools_high_ones_without_loss() -> None:
    x = np.random.default_rng(2).standard_normal(8_000)
    found = whittle.periodogram([x])
    window = whittle.cosine_taper(len(x), whittle.TAPER)
    frequency, power = scipy_periodogram(x, 2 * np.pi, window=window, detrend=False)
    np.testing.assert_allclose(found.omega[:400], frequency[1:401], rtol=1e-12)
    np.testing.assert_allclose(found.power[:400], np.pi * power[1:401], rtol=1e-9)
    np.testing.assert_allclose(np.sum(found.power * found.count), np.pi * np.sum(power[1:-1]), rtol=1e-9)


def sampled_fit(seed: int, *, mu: float, b2: float, sigma: float, noise: float, T: float, n: int) -> whittle.WhittleFit:
    rng = np.random.default_rng(seed)
    theta, _ = flexure.sample(mu, b2, sigma, np.full(n, T), rng)
    x = np.diff(theta) + noise * np.sqrt(T) * rng.standard_normal(n)
    centre = 1.4e-3 * DEG_PER_SQRT_HOUR
    return whittle.fit(whittle.periodogram([x]), T, noise_prior=centre, noise_spread=1.5)


def standardised(fit: whittle.WhittleFit, mu: float, b2: float, sigma: float) -> np.ndarray:
    error = np.log([fit.damping / mu, fit.stiffness / b2, fit.std / sigma])
    return error / np.sqrt(np.diag(fit.covariance)[:3])


def test_fit_recovers_the_parameters_of_a_path_within_its_standard_errors() -> None:
    truth = {"mu": 0.15, "b2": 0.15**2 + 0.24**2, "sigma": 2.0 * ARCMIN}
    fit = sampled_fit(11, **truth, noise=1e-3 * DEG_PER_SQRT_HOUR, T=0.1, n=36_000)
    assert np.abs(standardised(fit, **truth)).max() < 3.5
    # sqrt(mu/T) is the floor of the theory for mu; the fit's own figure must be of its size.
    assert np.sqrt(fit.covariance[0, 0]) * 0.15 == pytest.approx(np.sqrt(0.15 / 3600), rel=0.6)
    assert abs(fit.misfit) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mu", "b2"), [(0.15, 0.15**2 + 0.24**2), (0.2146, 0.2146**2), (0.4, 0.1)], ids=["underdamped", "critical", "over"]
)
def test_errors_of_the_fit_are_as_large_as_it_says(mu: float, b2: float) -> None:
    sigma = 4.0 * ARCMIN
    scores = np.array([
        standardised(sampled_fit(seed, mu=mu, b2=b2, sigma=sigma, noise=4e-7, T=0.2, n=18_000), mu, b2, sigma)
        for seed in range(12)
    ])  # fmt: skip
    spread = np.sqrt(np.mean(scores**2, axis=0))
    # chi with 12 degrees of freedom: 0.5 to 1.5 holds 99.5 %
    assert np.all(spread > 0.5), spread
    assert np.all(spread < 1.5), spread


@pytest.mark.parametrize("arw", [0.003, 0.03])
def test_gyro_noise_is_found_where_it_shows(arw: float) -> None:
    noise = arw * DEG_PER_SQRT_HOUR
    truth = {"mu": 0.2146, "b2": 0.2146**2, "sigma": 6.0 * ARCMIN}
    fit = sampled_fit(5, **truth, noise=noise, T=0.01, n=30_000)
    assert fit.gyro_noise == pytest.approx(noise, rel=0.05)
    assert np.abs(standardised(fit, **truth)).max() < 3.5


def test_coarse_gyro_noise_is_not_taken_for_flexure() -> None:
    """0.3 deg/sqrt(h), two decades and more above the centre of the prior."""
    noise = 0.42 * DEG_PER_SQRT_HOUR
    truth = {"mu": 0.2146, "b2": 0.2146**2, "sigma": 6.0 * ARCMIN}
    fit = sampled_fit(5, **truth, noise=noise, T=0.01, n=30_000)
    assert fit.gyro_noise == pytest.approx(noise, rel=0.05)


def test_gyro_noise_that_does_not_show_stays_near_its_prior() -> None:
    fit = sampled_fit(7, mu=0.2146, b2=0.2146**2, sigma=6 * ARCMIN, noise=0.0, T=0.2, n=9_000)
    prior = 1.4e-3 * DEG_PER_SQRT_HOUR
    assert fit.gyro_noise < 5.0 * prior
    assert fit.covariance[3, 3] > 0.3  # ln units: it knows that it does not know


def test_weight_zero_leaves_bins_out() -> None:
    mu, b2, sigma, T = 0.15, 0.08, 3 * ARCMIN, 0.2
    theta, _ = flexure.sample(mu, b2, sigma, np.full(18_000, T), np.random.default_rng(9))
    x = np.diff(theta) + 3e-5 * np.sin(2 * np.pi / 8.0 * T * np.arange(18_000))
    data = whittle.periodogram([x])
    weight = np.where(np.abs(data.omega - 2 * np.pi / 8.0 * T) < 0.01, 0.0, 1.0)
    prior = {"noise_prior": 4e-7, "noise_spread": 1.5}
    clean = whittle.fit(data, T, weight=weight, **prior)
    spoilt = whittle.fit(data, T, **prior)
    assert np.abs(standardised(clean, mu, b2, sigma)).max() < 3.5
    assert abs(np.log(spoilt.stiffness / b2)) > 2.0 * abs(np.log(clean.stiffness / b2))
    assert abs(clean.misfit) < 0.3
    assert spoilt.misfit > 0.5  # a line that no second-order process has


def test_start_near_the_optimum_and_search_from_afar_meet() -> None:
    mu, b2, sigma, T = 0.12, 0.3, 3 * ARCMIN, 0.2
    theta, _ = flexure.sample(mu, b2, sigma, np.full(9_000, T), np.random.default_rng(10))
    data = whittle.periodogram([np.diff(theta)])
    prior = {"noise_prior": 4e-7, "noise_spread": 1.5}
    afar, near = whittle.fit(data, T, **prior), whittle.fit(data, T, start=(0.15, 0.25, 4 * ARCMIN, 4e-7), **prior)
    np.testing.assert_allclose(
        np.log([near.damping, near.stiffness, near.std]), np.log([afar.damping, afar.stiffness, afar.std]), atol=0.02
    )


@pytest.mark.parametrize("n", [64, 101, 2000])
def test_taper_is_tukeys_window(n: int) -> None:
    np.testing.assert_allclose(whittle.cosine_taper(n, 0.1), tukey(n, 0.1), atol=1e-14)
