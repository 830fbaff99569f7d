"""Covariance effects: nothing is named on nulls and under mean effects, each effect is, with the right parameters."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import welch

from physics import flexure, whittle
from physics.recursion import stiffening_excess
from physics.units import ARCMIN
from schemas.diagnosis import ParameterEstimate
from stages.align import align
from stages.decode import decode
from stages.diagnose import spectra, spectral_residual
from stages.diagnose.spectral_data import SHARE
from stages.diagnose.spectral_data import spectra as spectra_of
from stages.diagnose.spectral_fit import fit_model
from stages.diagnose.spectral_model import Model
from stages.diagnose.spectral_residual import FullRateResidual
from tests.stages.diagnose.full_rate import drawn, residual_of
from twin import effects, load_twin
from twin.config import EffectSpec

LOGS = Path(__file__).parents[4] / "shared" / "logs"

CASES = {
    "second_mode": {"damping": 0.1, "frequency": 3.0, "std_arcmin": 0.8, "axis": "y"},
    "axis_coupling": {"xz": 0.2},
    "nonstationary_sea": {"growth": 1.3},
    "gyro_bandwidth": {"cutoff": 50.0},
    "gyro_random_walk": {"arw": 0.0018},
    "flexure_parameters": {"std_arcmin": 9.0},
    "narrowband_vibration": {"frequency": 12.3, "amplitude": 1e-3, "axis": "z"},
}
FAST = {"second_mode", "axis_coupling"}
MEAN = {
    "time_delay": {"delay": 0.0123},
    "gyro_scale_factor": {"x": 500.0, "z": -800.0},
    "static_misalignment": {"x": 10.0},
    "wave_forced_bending": {"x": 0.5},
    "gyro_bias": {"z": 1.0},
}


def frozen(given):
    return tuple((key, value) for key, value in given.items())


def named(candidates):
    return {candidate.finding.name for candidate in candidates if candidate.named}


def best(candidates):
    return max(candidates, key=lambda candidate: candidate.finding.evidence_nats)


@cache
def examined(name):
    """What is found of a log with one of the cases."""
    return spectra.examine(*residual_of(7, 240.0, ((name, frozen(CASES[name])),)))


def test_what_is_in_proportion_to_the_motion_is_predicted_as_it_was_regressed():
    t = 0.1 * np.arange(400)
    omega = np.stack([0.1 * np.sin(t), 0.2 * np.cos(0.7 * t), 0.05 + 0.01 * np.sin(0.3 * t)], axis=1)
    attitude = spectral_residual._attitude(omega, 0.1)
    slope = spectral_residual._slope(omega, 0.1)
    columns = spectral_residual._columns(omega, slope, spectral_residual._clock(len(t)), attitude)
    x = np.random.default_rng(1).standard_normal(len(columns))
    told = spectral_residual._predicted(x, omega, slope, attitude)
    np.testing.assert_allclose(told, np.einsum("k,kni->ni", x, columns), atol=1e-12)


def test_a_lag_is_taken_out_of_the_motion_and_not_out_of_the_noise():
    """12 ms, as of a low-pass of 13 Hz: by differences of samples it would leave 0.7 of the noise's power at 25 Hz."""
    rng, interval, lag = np.random.default_rng(4), 0.01, 0.012
    t = interval * np.arange(60000)
    waves = np.stack([np.sin(0.6 * t), 0.5 * np.sin(0.8 * t), np.cos(0.5 * t)], axis=1)
    slope = np.stack([0.6 * np.cos(0.6 * t), 0.4 * np.cos(0.8 * t), -0.5 * np.sin(0.5 * t)], axis=1)
    noise = 1e-4 * rng.standard_normal((2, len(t), 3))
    omega = 0.1 * waves + noise[0]
    rate = -lag * 0.1 * slope + noise[1] - noise[0]
    smooth, attitude = spectral_residual._slope(omega, interval), spectral_residual._attitude(omega, interval)
    taken, found, _ = spectral_residual._motion(
        rate, omega, smooth, attitude, interval, load_twin("random-sea"), np.inf
    )
    left = welch(rate - taken, 1.0 / interval, nperseg=1000, axis=0)[1][20:480].mean(axis=1)
    before = welch(noise[1] - noise[0], 1.0 / interval, nperseg=1000, axis=0)[1][20:480].mean(axis=1)
    assert found == pytest.approx(lag, rel=0.02)
    np.testing.assert_allclose(left / before, 1.0, atol=0.02)


def test_an_angle_that_stays_in_inertial_axes_leaves_nothing_on_a_ship_that_turns():
    t = 0.1 * np.arange(6000)
    sway = [
        0.1 * np.sin(0.7 * t),
        0.15 * np.cos(0.6 * t),
        0.03 * np.exp(-(((t - 300.0) / 60.0) ** 2)) + 0.03 * np.sin(0.8 * t),
    ]
    omega = np.stack(sway, axis=1)
    attitude, slope = spectral_residual._attitude(omega, 0.1), spectral_residual._slope(omega, 0.1)
    astray = spectral_residual._back(attitude, np.broadcast_to([1e-3, -2e-3, 5e-4], omega.shape))
    rate = np.cross(omega, astray)
    left = rate - spectral_residual._motion(rate, omega, slope, attitude, 0.1, load_twin("random-sea"), np.inf)[0]
    assert np.abs(left).max() < 0.02 * np.abs(rate).max()


def test_a_turn_is_not_taken_for_bending_by_a_scale_that_waves_alone_do_not_tell():
    """About z, where the ship hardly moves but for the turn, lively flexure passes for a wrong scale."""
    belief, t = load_twin("random-sea"), 0.1 * np.arange(6000)
    waves = [0.03 * np.sin(0.8 * t + 0.1 * np.sin(0.05 * t)), 0.07 * np.sin(0.9 * t), 0.01 * np.sin(0.7 * t)]
    turn = np.where((t > 250.0) & (t < 350.0), 0.01, 0.0)
    omega = np.stack(waves, axis=1) + turn[:, None] * np.array([0.0, 0.0, 1.0])
    attitude, slope = spectral_residual._attitude(omega, 0.1), spectral_residual._slope(omega, 0.1)
    bent = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        theta = [flexure.sample(0.2, 0.5, 5.0 * ARCMIN, np.full(len(t), 0.1), rng)[0] for _ in range(3)]
        rate = np.diff(theta, axis=1).T / 0.1
        taken = [
            spectral_residual._motion(rate, omega, slope, attitude, 0.1, belief, astray)[0]
            for astray in (np.inf, ARCMIN)
        ]
        bent.append([abs(float(np.sum(one[2400:3600, 2]) * 0.1)) / ARCMIN for one in taken])
    free, held = np.array(bent).T
    assert np.median(free) > 3.0
    assert np.median(held) < 1.0


def test_the_residual_is_the_rate_of_the_flexure_and_noise():
    trial, _ = drawn(3)
    residual, _ = residual_of(3)
    back = np.cumsum(residual.rate[:, 0]) * residual.interval
    expected = residual.theta[:, 0]
    moving = slice(2000, -2000)
    difference = back[moving] - expected[moving]
    at = np.arange(len(difference))
    assert np.std(difference - np.polyval(np.polyfit(at, difference, 2), at)) < 0.1 * ARCMIN
    assert abs(len(residual.t) - len(trial.main)) <= 2


def test_what_is_proportional_to_the_ships_rate_does_not_reach_the_residual():
    plain, _ = residual_of(3)
    wrong, _ = residual_of(3, 240.0, (("gyro_scale_factor", (("x", 2000.0), ("y", -1500.0))),))
    n = min(len(plain.t), len(wrong.t))
    moving = slice(2000, n - 2000)
    difference = np.std(wrong.rate[:n][moving] - plain.rate[:n][moving], axis=0)
    assert np.all(difference < 0.02 * np.std(plain.rate[:n][moving], axis=0))


def test_a_deck_that_stiffens_is_turned_into_the_one_that_does_not():
    """Against Heun's integration of the stiffened answer to the same forcing."""
    belief = load_twin("random-sea")
    t, gain = 0.01 * np.arange(30_000), 0.02 / ARCMIN**2
    plain, stiff = np.empty((len(t), 3)), np.empty((len(t), 3))
    for axis, (mu, frequency) in enumerate(zip(belief.flexure.damping, belief.flexure.frequency)):
        b2 = mu**2 + frequency**2
        plain[:, axis] = flexure.sample(mu, b2, 5.0 * ARCMIN, np.diff(t), np.random.default_rng(axis))[0]
        stiff[:, axis] = plain[:, axis] + stiffening_excess(t, plain[:, axis].copy(), mu, b2, gain, 0.0)
    rate = np.gradient(stiff, 0.01, axis=0)
    nothing = np.zeros_like(rate)
    residual = FullRateResidual(t, 0.01, rate, np.ones(len(t), bool), nothing, stiff, np.eye(3), 0.0, 0.0)
    mu = np.array(belief.flexure.damping)
    deck = np.stack([mu, mu**2 + np.array(belief.flexure.frequency) ** 2])
    straightened = spectral_residual.linear(residual, gain, deck)
    before = np.std(stiff - plain, axis=0)
    after = np.std(straightened.theta - plain, axis=0)
    assert (before > 0.3 * np.std(plain, axis=0)).all()
    assert (after < 0.02 * before).all()
    np.testing.assert_allclose(straightened.rate, np.gradient(plain, 0.01, axis=0), atol=2e-2 * rate.std())


def test_a_null_names_nothing():
    residual, belief = residual_of(1)
    candidates = spectra.examine(residual, belief)
    assert {candidate.finding.name for candidate in candidates} == set(spectra.EFFECTS)
    assert not named(candidates)
    assert best(candidates).finding.evidence_nats < 8.0


@pytest.mark.slow
def test_ten_nulls_name_nothing():
    wrong = []
    for seed in range(20, 30):
        residual, belief = residual_of(seed, 150.0)
        wrong += sorted(named(spectra.examine(residual, belief)))
    assert wrong == []


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name in FAST else pytest.mark.slow) for name in CASES])
def test_each_effect_is_the_strongest_with_its_parameters(name):
    strongest = best(examined(name))
    assert strongest.finding.name == name
    assert strongest.named
    for key, value in CASES[name].items():
        estimate = strongest.finding.parameters[key]
        for one in [estimate] if isinstance(estimate, ParameterEstimate) else estimate.values():
            if isinstance(value, str):
                assert one.value == value
            else:
                assert abs(one.value - value) < 3.5 * one.std
    assert strongest.finding.places[0].channel == "sub.gyro"


@pytest.mark.slow
@pytest.mark.parametrize("name", MEAN)
def test_mean_effects_do_not_show_in_the_spectra(name):
    residual, belief = residual_of(8, 240.0, ((name, frozen(MEAN[name])),))
    assert not named(spectra.examine(residual, belief))


@pytest.mark.slow
def test_a_named_effect_leaves_nothing_to_the_others():
    residual, belief = residual_of(7, 240.0, (("second_mode", frozen(CASES["second_mode"])),))
    assert not named(spectra.examine(residual, belief, {"second_mode"}))
    joint = spectra.fit(residual, belief, ("second_mode", "nonstationary_sea"))
    evidence = {finding.name: finding.evidence_nats for finding in joint.findings}
    assert evidence["second_mode"] > 14.0 > evidence["nonstationary_sea"]
    assert joint.log_likelihood > joint.nominal


@pytest.mark.slow
def test_what_the_twin_says_itself_is_not_found_again():
    name = "nonstationary_sea"
    residual, belief = residual_of(7, 240.0, ((name, frozen(CASES[name])),))
    told = belief.model_copy(update={"effect": (EffectSpec(name=name, **CASES[name]),)})
    assert not named(spectra.examine(residual, told))
    assert name in named(examined(name))


def test_pictures_show_the_fitted_spectrum_through_the_measured_one():
    residual, belief = residual_of(1)
    joint = spectra.fit(residual, belief, ())
    for picture in spectra.pictures(residual, residual, joint):
        high = picture.frequency > 1.0
        assert np.mean(picture.before[high] / picture.expected[high]) == pytest.approx(1.0, abs=0.05)
        assert np.array_equal(picture.before, picture.after)


def test_likelihood_of_white_noise_is_calibrated():
    """Nats that a free level gains over the true one are half a chi-square of as many degrees as levels: three."""
    residual, _ = residual_of(1)
    rng = np.random.default_rng(5)
    gains = []
    for _ in range(60):
        noise = rng.standard_normal((6000, 3))
        part = type(residual)(residual.t[:6000], 0.01, noise, np.ones(6000, bool), residual.omega[:6000],
                              residual.theta[:6000], np.eye(3), 0.0, 1.0)  # fmt: skip
        data = spectra_of(part).pooled
        count = SHARE * data.count[0, 0]
        for axis in range(3):
            level = float(np.sum(count * data.power[0, 0, :, axis, axis].real) / count.sum())
            gains.append(float(count.sum()) * (level - 1.0 - np.log(level)))
    assert np.mean(gains) == pytest.approx(0.5, abs=0.2)


def test_gaps_everywhere_are_told_and_name_nothing():
    residual, belief = residual_of(1)
    good = residual.good.copy()
    for start in range(0, len(good), 700):
        good[start : start + 120] = False
    holed = type(residual)(residual.t, residual.interval, residual.rate, good, residual.omega, residual.theta,
                           residual.R_m_s, residual.lag, residual.lag_std)  # fmt: skip
    candidates = spectra.examine(holed, belief)
    assert not named(candidates)
    assert all("gaps" in candidate.reason for candidate in candidates)


def _measured_change(name, given, seed=11, duration=240.0):
    """Spectra (k, 3) of the same world with and without an effect, and the grid."""
    with_it = spectra_of(residual_of(seed, duration, ((name, frozen(given)),))[0]).pooled
    without = spectra_of(residual_of(seed, duration)[0]).pooled
    power = [np.einsum("kii->ki", data.power[0, 0]).real for data in (without, with_it)]
    return power[0], power[1], with_it


def _predicted(name, given, data, axis, share=0.5):
    """What the effect's own hooks make of a fitted spectrum without it."""
    residual, belief = residual_of(11)
    model = Model.of(belief, data.grid)
    fitted = fit_model(spectra_of(residual), model, model.believed)
    omega, T = data.grid.points, data.grid.interval
    silent = fitted.x.copy()
    silent[axis + 6] = -30.0  # no flexure: what is left is noise
    noise = np.full(len(omega), model.spectrum(silent, axis, [share])[0][-1])
    mu, stiffness, sigma = np.exp(fitted.x[[axis, axis + 3, axis + 6]])
    flexure = whittle.increment_spectrum(omega, mu, stiffness, sigma, 0.0, T) / T**2
    effect = effects.build(name, given)
    changed = effect.flexure_density(axis, omega, T, flexure, share)
    changed = changed + effect.noise_density(axis, omega, T, noise, share)
    return data.grid.seen(changed) / data.grid.seen(flexure + noise)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "given", "low", "high"),
    [
        ("gyro_bandwidth", {"cutoff": 60.0}, 5.0, 30.0),
        ("nonstationary_sea", {"growth": 1.1}, 1.0, 20.0),
        ("second_mode", {"damping": 0.3, "frequency": 4.0, "std_arcmin": 3.0}, 0.4, 1.0),
        ("gyro_quantization", {"step": 1.0}, 20.0, 45.0),
        ("outliers", {"rate": 600.0, "size": 0.05}, 15.0, 45.0),
        ("slamming", {"rate": 40.0, "amplitude": 20.0, "damping": 1.0}, 0.8, 2.0),
    ],
)
def test_the_predicted_change_of_spectrum_is_the_simulated_one(name, given, low, high):
    before, after, data = _measured_change(name, given)
    band = (data.grid.frequency > low) & (data.grid.frequency < high)
    weight = data.count[0, 0][band]
    predicted = _predicted(name, given, data, 0)[band]
    seen = np.average(after[band, 0] / before[band, 0], weights=weight)
    expected = np.average(predicted, weights=weight)
    assert seen - 1.0 == pytest.approx(expected - 1.0, rel=0.25)


@pytest.mark.slow
@pytest.mark.skipif(not LOGS.exists(), reason="logs of the independent generator are not here")
@pytest.mark.parametrize("name", ["random-sea-a", "idam-ship", "sliding-sim", "stalign-sim", "modelfree-sim"])
def test_logs_of_an_independent_generator_draw_no_false_name(name):
    trial, belief = decode(LOGS / f"{name}.mcap").trial, load_twin(LOGS / f"{name}.twin.toml")
    residual = spectra.residual(trial, align(trial), belief)
    assert not named(spectra.examine(residual, belief))


@pytest.mark.skipif(not LOGS.exists(), reason="logs of the independent generator are not here")
def test_the_hidden_mode_of_an_independent_log_is_found():
    trial, belief = decode(LOGS / "random-sea-b.mcap").trial, load_twin(LOGS / "random-sea-b.twin.toml")
    strongest = best(spectra.examine(spectra.residual(trial, align(trial), belief), belief)).finding
    assert strongest.name == "second_mode"
    assert strongest.parameters["axis"].value == "x"
    for key, value in {"damping": 0.0989, "frequency": 3.4716, "std_arcmin": 3.285}.items():
        assert abs(strongest.parameters[key].value - value) < 3.0 * strongest.parameters[key].std
