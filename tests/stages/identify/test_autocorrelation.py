"""What the published identifiers share: increments, their autocorrelation, its model, fit and standard errors."""

import numpy as np
import pytest

from physics import flexure
from physics.units import DEG_PER_SQRT_HOUR
from schemas.errors import DataError
from schemas.trial import ImuSeries, Trial
from stages.identify import autocorrelation as ac
from tests.stages.identify.synthetic import (
    AXES,
    CRITICAL,
    UNDERDAMPED,
    T,
    exact,
    misfit,
    sampled,
    state_space_covariance,
)


@pytest.mark.parametrize("axis", AXES)
def test_model_is_the_exact_covariance_of_increments(axis):
    model = ac.increment_autocorrelation(*axis, T, 150)
    assert model == pytest.approx(state_space_covariance(*axis, 150), rel=1e-9, abs=1e-12 * model[0])


def test_model_is_the_corrected_closed_form_of_the_paper():
    """(22)-(24) with b/lambda for lambda/b, and (-mu + j lambda) n T."""
    mu, stiffness, sigma = UNDERDAMPED
    rate = np.sqrt(stiffness - mu**2)
    root, b = -mu + 1j * rate, np.sqrt(stiffness)
    C = 2.0 * b / rate * sigma**2 * np.exp(1j * np.arctan2(rate, mu)) * (1.0 - np.cosh(root * T))
    n = np.arange(1, 100)
    assert ac.increment_autocorrelation(*UNDERDAMPED, T, 99)[1:] == pytest.approx(
        (C * np.exp(root * n * T)).imag, abs=1e-18
    )


def test_sample_autocorrelation_counts_only_the_pairs_there_are():
    rng = np.random.default_rng(1)
    x = rng.standard_normal(200)
    x[[0, 50, 51, 120, 199]] = np.nan
    R, pairs = ac.sample_autocorrelation(x, 20)
    for n in range(21):
        products = x[: len(x) - n] * x[n:]
        assert pairs[n] == np.isfinite(products).sum()
        assert R[n] == pytest.approx(np.nanmean(products), abs=1e-13)


@pytest.mark.parametrize("axis", AXES)
def test_fit_finds_the_truth_in_an_exact_autocorrelation(axis):
    assert misfit(ac.fit(exact(axis, 200)), axis) < 1e-3


def test_standard_errors_are_those_of_repeated_records():
    rng = np.random.default_rng(2)
    ratios = []
    for _ in range(40):
        record = sampled(UNDERDAMPED, 2400.0, rng, 125)
        found = ac.fit(record)
        std = np.sqrt(np.diag(ac.covariance(np.log(UNDERDAMPED), record)))
        ratios.append((found - np.log(UNDERDAMPED)) / std)
    assert np.all(np.std(ratios, axis=0) == pytest.approx(1.0, abs=0.35))


def test_errors_of_neighbouring_lags_are_counted_as_one():
    """Taking the lags as independent would promise far too much."""
    record = exact(CRITICAL)
    assert np.all(np.diag(ac.covariance(np.log(CRITICAL), record)) > 0)
    S = ac._bartlett(np.log(CRITICAL), record)
    assert S[30, 31] / np.sqrt(S[30, 30] * S[31, 31]) > 0.8
    assert np.linalg.eigvalsh(S).min() > -1e-9 * S[0, 0]


def test_increments_hold_the_flexure_and_nothing_of_the_motion(trial, alignment, twin):
    values, step = ac.increments(trial, alignment)
    assert step == pytest.approx(T)
    for axis in range(3):
        mu, sigma = twin.flexure.damping[axis], np.radians(twin.flexure.std_arcmin[axis] / 60.0)
        expected = np.sqrt(ac.increment_autocorrelation(mu, mu**2, sigma, T, 1)[0])
        assert np.nanstd(values[:, axis]) == pytest.approx(expected, rel=0.1)


def test_printed_increments_hold_motion_too(trial, alignment):
    """omega x theta, which (16) drops, is as large as theta' at 10 degrees of motion."""
    full, _ = ac.increments(trial, alignment)
    printed, _ = ac.increments(trial, alignment, as_printed=True)
    ratio = np.nanvar(printed, axis=0) / np.nanvar(full, axis=0)
    assert np.all(ratio > 1.3)


def test_a_gap_costs_its_increments_alone(trial, alignment):
    keep = np.ones(len(trial.sub), bool)
    keep[20000:20500] = False
    sub = ImuSeries(trial.sub.stamp[keep], trial.sub.gyro[keep], trial.sub.accel[keep])
    values, _ = ac.increments(Trial(trial.main, sub, trial.epoch), alignment)
    whole, _ = ac.increments(trial, alignment)
    lost = np.flatnonzero(np.isnan(values[:, 0]))
    assert 24 <= len(lost) <= 28
    assert lost[-1] - lost[0] == len(lost) - 1
    assert np.nanstd(values, axis=0) == pytest.approx(np.std(whole, axis=0), rel=0.05)


def test_samples_lost_here_and_there_cost_hardly_anything(trial, alignment):
    """One in twenty; nearly every increment then spans one of them."""
    keep = np.random.default_rng(1).random(len(trial.sub)) > 0.05
    sub = ImuSeries(trial.sub.stamp[keep], trial.sub.gyro[keep], trial.sub.accel[keep])
    lossy = ac.identify_axes("acf", Trial(trial.main, sub, trial.epoch), alignment, ac.fit, False)
    whole = ac.identify_axes("acf", trial, alignment, ac.fit, False)
    np.testing.assert_allclose(lossy.std / whole.std, 1.0, atol=0.15)
    np.testing.assert_allclose(lossy.stiffness / whole.stiffness, 1.0, atol=0.3)


def test_noise_of_coarse_gyros_is_found_and_that_of_fine_ones_is_not_made_up(trial, alignment):
    noise, rng = 0.2 * DEG_PER_SQRT_HOUR, np.random.default_rng(2)
    noisy = trial.sub.gyro + noise / np.sqrt(0.01) * rng.standard_normal(trial.sub.gyro.shape)
    coarse = Trial(trial.main, ImuSeries(trial.sub.stamp, noisy, trial.sub.accel), trial.epoch)
    found = ac.identify_axes("acf", coarse, alignment, ac.fit, False).gyro_noise
    np.testing.assert_allclose(found / noise, 1.0, atol=0.05)
    assert not ac.identify_axes("acf", trial, alignment, ac.fit, False).gyro_noise.any()


def test_too_short_a_record_is_refused_in_a_sentence(trial, alignment):
    part = slice(0, 2500)
    short = [ImuSeries(u.stamp[part], u.gyro[part], u.accel[part]) for u in (trial.main, trial.sub)]
    with pytest.raises(DataError, match="autocorrelation of the flexure"):
        ac.identify_axes("acf", Trial(*short, trial.epoch), alignment, ac.fit, False)


def test_units_that_turn_alike_show_no_flexure():
    with pytest.raises(DataError, match="no flexure"):
        ac._axis(np.zeros(5000), T, 25.0)


def test_a_record_without_flexure_slower_than_itself():
    lower, upper = ac.limits(100.0)
    assert np.exp(lower[1]) == pytest.approx((2 * np.pi / 100.0) ** 2)
    assert np.all(lower < upper)


def test_oversampled_path_and_model_agree():
    """The paths the other tests draw have the autocorrelation the model states."""
    rng = np.random.default_rng(5)
    theta, _ = flexure.sample(*UNDERDAMPED, np.full(400000, T), rng)
    R, _ = ac.sample_autocorrelation(np.diff(theta), 40)
    model = ac.increment_autocorrelation(*UNDERDAMPED, T, 40)
    assert model == pytest.approx(R, abs=0.03 * model[0])
