"""The bound on what can be detected, against a dense reference and against least squares on drawn logs."""

from dataclasses import replace

import numpy as np
import pytest

from physics.units import ARCMIN
from pipeline.blind.reality import limits
from pipeline.blind.reality.drawing import draw
from pipeline.blind.reality.flexure import STEP, Restoring, grid, random_path, settled
from pipeline.blind.reality.scenes import draw_scene
from pipeline.blind.reality.severity import MOST_OFF, parameters, reached
from twin.config import Flexure


@pytest.fixture(scope="module")
def nature():
    return draw_scene(np.random.default_rng(3), 600.0, 100.0, "navigation", "moderate").nature


def test_the_spectrum_of_the_deck_is_that_of_its_integration(nature):
    """Residual rates and attitude of a drawn path: power in bands against the densities."""
    f = np.array([0.1, 0.3, 0.6, 1.0])
    density = limits.spectra(nature, np.linspace(0.0, 4.0, 4001))
    power = np.zeros((len(f), 3))
    for seed in range(4):
        t = grid(nature.duration)
        rng = np.random.default_rng(seed)
        path = settled(t, random_path(nature.deck, t, (Restoring(),) * 3, np.ones(len(t)), rng))[1]
        thin = path[:: round(0.05 / STEP)]
        window = np.hanning(len(thin))[:, None]
        spectrum = np.abs(np.fft.rfft(thin * window, axis=0)) ** 2 * 0.05 / (window**2).sum()
        at = np.fft.rfftfreq(len(thin), 0.05)
        power += [spectrum[np.abs(at - x) < 0.05].mean(axis=0) / 4.0 for x in f]
    expected = np.array(
        [np.mean([np.diag(density[k].real)[6:] for k in range(4001) if abs(k * 1e-3 - x) < 0.05], axis=0) for x in f]
    )
    noise = 2.0 * nature.phins.noise**2 / nature.rate
    slow = 4.0 * nature.phins.tau * nature.phins.drift**2 / (1.0 + (2.0 * np.pi * f[:, None] * nature.phins.tau) ** 2)
    np.testing.assert_allclose(power, expected - noise - slow, rtol=0.35)


def test_the_other_channels_know_most_of_the_flexure_in_the_gyros(nature):
    """What is left of the gyros' residual, given accelerometers and PHINS, is a small part of it."""
    density = limits.spectra(nature, np.array([0.099, 0.1, 0.101]))[1]
    gyro, both, others = density[:3, :3], density[:3, 3:], density[3:, 3:]
    left = np.diag(gyro - both @ np.linalg.solve(others, both.conj().T)).real
    assert (left < 0.2 * np.diag(gyro).real).all()
    assert (left > 0.0).all()


def test_longer_and_rougher_logs_bound_less():
    def bound(duration, sea, name):
        nature = draw_scene(np.random.default_rng(5), duration, 100.0, "navigation", sea).nature
        seen = limits.drive(nature)
        return limits.limit(nature, limits.unit_signals(name, seen, {}), seen)

    assert (bound(600.0, "rough", "time_delay") < bound(300.0, "rough", "time_delay")).all()
    assert (bound(300.0, "rough", "lever_arm") < bound(300.0, "calm", "lever_arm")).all()


def test_the_bound_is_five_and_a_half_deviations_of_white_noise():
    """With the flexure and PHINS drift all but gone only white noise is left: sum of squares over the density."""
    from dataclasses import replace

    nature = draw_scene(np.random.default_rng(3), 600.0, 100.0, "navigation", "moderate").nature
    nature = nature.with_deck(std=np.full(3, 1e-12))
    nature = replace(nature, phins=replace(nature.phins, drift=np.full(3, 1e-12)))
    seen = limits.drive(nature)
    pulse = np.where((seen.t > 290.0) & (seen.t < 310.0), np.sin(2.0 * np.pi * 0.5 * seen.t), 0.0)
    found = limits.limit(nature, [limits.signal(seen, accel=np.outer(pulse, [1.0, 0.0, 0.0]))], seen)[0]
    density = nature.main.vrw**2 + nature.sub.vrw**2
    energy = np.sum(pulse**2) * limits.STEP
    window = np.sum(np.hanning(len(seen.t)) ** 2) / len(seen.t)  # the middle of the record weighs 1 / 0.375
    assert found == pytest.approx(limits.DETECTABLE * np.sqrt(density / energy * window), rel=0.05)


def test_no_channel_tells_bending_from_flexure_better_than_theta_itself_would(nature):
    """Bending adds to theta, so that its bound is at least that of theta seen without noise: sum of |s|^2 / S_theta."""
    seen = limits.drive(nature)
    found = limits.limit(nature, limits.unit_signals("wave_forced_bending", seen, {}), seen) / limits.DETECTABLE
    deck, wave = nature.deck, np.radians(1.0 / 60.0) * np.degrees(seen.roll)
    window = np.hanning(len(wave))
    spectrum = np.fft.rfft(wave * window)
    w = 2.0 * np.pi * np.fft.rfftfreq(len(wave), limits.STEP)
    inside = w < 2.0 * np.pi * limits.HIGHEST
    for axis in range(3):
        mu, stiffness = deck.damping[axis], deck.damping[axis] ** 2 + deck.frequency[axis] ** 2
        density = 4.0 * mu * stiffness * deck.std[axis] ** 2 / ((stiffness - w**2) ** 2 + (2.0 * mu * w) ** 2)
        variance = density * np.sum(window**2) / limits.STEP
        information = 2.0 * np.sum(np.abs(spectrum[inside]) ** 2 / variance[inside])
        assert 0.9 < found[axis] * np.sqrt(information) < 1.6


def test_the_least_hysteresis_falls_with_the_root_of_the_duration_and_without_yielding_there_is_none():
    def least(duration, yields):
        nature = draw_scene(np.random.default_rng(5), duration, 100.0, "navigation", "rough").nature
        return float(limits.hysteresis(nature, yields)[0])

    assert least(2400.0, 1.0) == pytest.approx(0.5 * least(600.0, 1.0), rel=1e-6)
    assert least(600.0, 100.0) > 10.0 * least(600.0, 1.0)


def test_a_hysteresis_that_cannot_be_plainer_is_drawn_with_the_severity_it_reaches():
    answer = draw([3, 99], effects=["bouc_wen"], severity=10.0, duration=120.0)[2]
    stated = answer["effects"][0]
    assert stated["parameters"]["hysteretic_share"] == 0.9
    assert answer["severity"] == stated["severity"] < 3.0


def test_the_rates_density_is_that_of_the_gyros_beside_all_channels(nature):
    f = np.linspace(0.0, 4.0, 4001)
    expected = np.diagonal(limits.spectra(nature, f).real, axis1=1, axis2=2)[:, :3]
    np.testing.assert_allclose(limits.rate_density(nature, f)[20:-1], expected[20:-1], rtol=1e-2)


def test_the_least_walk_is_larger_where_flexure_drowns_the_gyros_noise(nature):
    wide = replace(nature, deck=replace(nature.deck, std=30.0 * nature.deck.std))
    still = replace(nature, deck=replace(nature.deck, std=1e-6 * nature.deck.std))
    assert limits.random_walk(wide) > 2.0 * limits.random_walk(nature) > 2.0 * nature.sub.arw
    # Beside white noise alone x - ln(1 + x) is D^2 / 2 over three axes' bins.
    x = (limits.random_walk(still) ** 2 - still.sub.arw**2) / (still.main.arw**2 + still.sub.arw**2)
    bins = 3.0 * 0.5 * still.rate * still.duration
    assert bins * (x - np.log1p(x)) == pytest.approx(0.5 * limits.DETECTABLE**2, rel=1e-3)


def test_a_sine_of_the_least_amplitude_stands_so_many_sigmas_out_of_white_noise(nature):
    still = replace(nature, deck=replace(nature.deck, std=1e-9 * nature.deck.std))
    t = np.arange(0.0, still.duration, 1.0 / still.rate)
    sine = limits.vibration(still, 7.0, 2) * np.sin(2.0 * np.pi * 7.0 * t)
    noise = np.sqrt((still.main.arw**2 + still.sub.arw**2) * still.rate)
    assert np.linalg.norm(sine) / noise == pytest.approx(limits.DETECTABLE, rel=1e-3)


def test_a_lever_arm_is_known_no_better_than_the_mean_bending_that_moves_it(nature):
    seen = limits.drive(nature)
    mean = np.diagonal(limits._bending(nature.deck, np.zeros(1))[0]).real / nature.duration
    split = np.sqrt(mean * limits.FREE["static"] ** 2 / (mean + limits.FREE["static"] ** 2))
    by_axis = np.cross(np.eye(3) * split[:, None], nature.deck.lever)
    least = limits.DETECTABLE * np.sqrt((by_axis**2).sum(axis=0))
    bound = limits.limit(nature, limits.unit_signals("lever_arm", seen, {}), seen)
    assert (bound > 0.999 * least).all()
    assert bound[2] < 2.0 * least[2]


def _off(nature, **factors):
    """What a twin believes of this deck, and the same with parameters off by factors about y."""
    deck = nature.deck
    believed = Flexure(
        damping=tuple(deck.damping), frequency=tuple(deck.frequency), std_arcmin=tuple(deck.std / ARCMIN)
    )
    there = {
        key: tuple(v * factor if axis == 1 else v for axis, v in enumerate(getattr(believed, key)))
        for key, factor in factors.items()
    }
    return believed, believed.model_copy(update=there)


def test_flexure_that_a_twin_leaves_open_is_never_told(nature):
    assert limits.flexure(nature, *_off(nature, damping=1.3, std_arcmin=1.15)) < 0.01


def test_longer_logs_tell_other_flexure_by_the_root_of_their_duration(nature):
    decks = _off(nature, std_arcmin=3.0)
    four = limits.flexure(replace(nature, duration=4.0 * nature.duration), *decks)
    assert four == pytest.approx(2.0 * limits.flexure(nature, *decks), rel=0.02)


def test_other_flexure_is_told_by_the_likelihood_ratio_of_periodograms(nature):
    """Drawn as exponential variates: the mean of ln L(there) - ln L(nearest), both searched for without the library."""
    believed, there = _off(nature, damping=4.0)
    told = limits.flexure(nature, believed, there)
    f = np.arange(1, int(0.5 * nature.rate * nature.duration)) / nature.duration
    noise = nature.main.arw**2 + nature.sub.arw**2

    def density(mu, b2, sigma):
        w = 2.0 * np.pi * f
        return w**2 * 4.0 * mu * b2 * sigma**2 / ((b2 - w**2) ** 2 + (2.0 * mu * w) ** 2) + noise

    mu, b2 = believed.damping[1], believed.damping[1] ** 2 + believed.frequency[1] ** 2
    sigma = believed.std_arcmin[1] * ARCMIN
    real = density(4.0 * mu, there.damping[1] ** 2 + there.frequency[1] ** 2, sigma)
    power = real * np.random.default_rng(0).standard_exponential((40, len(f)))
    ratios = [
        (power / other - power / real + np.log(other / real)).sum(axis=1).mean()
        for a in np.linspace(1.0 / 1.4, 1.4, 5)
        for b in np.linspace(1.0 / 1.55, 1.55, 9)
        for c in np.linspace(1.0 / 1.2, 1.2, 9)
        for other in [density(a * mu, b * b2, c * sigma)]
    ]
    assert told == pytest.approx(np.sqrt(2.0 * min(ratios)) / limits.DETECTABLE, rel=0.1)


@pytest.mark.parametrize("severity", [3.0, 10.0])
def test_other_flexure_is_drawn_as_plain_as_asked_or_told_as_less(severity):
    for seed in range(6):
        scene = draw_scene(np.random.default_rng(seed), 600.0, 100.0, None, None)
        drawn = parameters("flexure_parameters", severity, scene, np.random.default_rng(seed))
        believed = scene.twin.flexure
        there = {
            key: tuple(old if new is None else new for new, old in zip(values, getattr(believed, key)))
            for key, values in drawn.items()
        }
        plain = limits.flexure(scene.nature, believed, believed.model_copy(update=there))
        assert reached("flexure_parameters", severity, drawn, scene) == min(severity, plain)
        assert plain >= severity or max(abs(np.log(_factors(believed, there)))) == pytest.approx(np.log(MOST_OFF))


def _factors(believed, there):
    return np.concatenate([np.array(values) / getattr(believed, key) for key, values in there.items()])
