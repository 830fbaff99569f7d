"""Each hidden effect does what the log contract says of it, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.blind.reality.assembly import STREAMS, assemble, shaken_deck
from pipeline.blind.reality.drawing import CAUSES, draw, draw_case
from pipeline.blind.reality.scenes import draw_scene
from pipeline.blind.reality.severity import FOREIGN, LISTED, SEVERITIES, parameters
from twin import effects

DEG = np.pi / 180.0
ARCMIN = DEG / 60.0
DPH = DEG / 3600.0
G = 9.80665
DURATION = 40.0


@pytest.fixture(scope="module")
def nature():
    return draw_scene(np.random.default_rng(8), DURATION, 100.0, "navigation", "rough").nature


@pytest.fixture(scope="module")
def plain(nature):
    return assemble(nature, (), np.random.default_rng(2))


@pytest.fixture(scope="module")
def apply(nature):
    def applied(name, **parameters):
        return assemble(nature, (CAUSES[name](parameters),), np.random.default_rng(2))

    return applied


def test_every_effect_of_the_library_has_an_independent_model():
    assert set(LISTED) == set(effects.names())
    assert set(FOREIGN) == {name for name, cause in CAUSES.items() if not cause.listed}
    assert len(FOREIGN) >= 4
    assert set(CAUSES) == set(SEVERITIES)


def test_the_same_noise_lies_under_every_effect(plain, apply):
    trial, _ = apply("gyro_bias", x=0.0)
    for unit in ("main", "sub", "phins_main", "phins_sub"):
        np.testing.assert_array_equal(getattr(trial, unit).gyro, getattr(plain[0], unit).gyro)


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("gyro_bias", {"x": 1.0, "z": -2.0}, lambda w, f, k: np.array([1.0, 0.0, -2.0]) * DPH),
        ("gyro_scale_factor", {"y": 300.0}, lambda w, f, k: w * np.array([0.0, 3e-4, 0.0])),
        ("gyro_nonorthogonality", {"xy": 100.0}, lambda w, f, k: np.outer(w[:, 1], [100.0 / 3600.0 * DEG, 0.0, 0.0])),
        ("gyro_g_sensitivity", {"z": 5.0}, lambda w, f, k: f * np.array([0.0, 0.0, 5.0 * DPH / G])),
        ("gyro_temperature", {"slope": [0.0, 0.2, 0.0]}, lambda w, f, k: np.outer(k, [0.0, 0.2 * DPH, 0.0])),
        ("rate_nonlinearity", {"x": 0.01, "order": 2}, lambda w, f, k: 0.01 * np.abs(w) * w * np.array([1.0, 0, 0])),
    ],
)
def test_errors_of_the_gyros(plain, apply, nature, name, parameters, expected):
    trial, _ = apply(name, **parameters)
    sub = plain[0].sub
    more = expected(sub.gyro, sub.accel, nature.warmth.at(1, np.arange(len(sub)) / 100.0) - 20.0)
    difference = trial.sub.gyro - sub.gyro
    scale = np.abs(more).max()
    np.testing.assert_allclose(difference, np.broadcast_to(more, difference.shape), atol=5e-3 * scale)
    np.testing.assert_array_equal(trial.sub.accel, sub.accel)
    np.testing.assert_array_equal(trial.main.gyro, plain[0].main.gyro)


def test_errors_of_the_accelerometers(plain, apply):
    biased, _ = apply("accel_bias", y=500.0)
    np.testing.assert_allclose(biased.sub.accel - plain[0].sub.accel, [[0.0, 500e-6 * G, 0.0]] * 4000, atol=1e-9)
    scaled, _ = apply("accel_scale_factor", z=200.0)
    expected = plain[0].sub.accel * np.array([0.0, 0.0, 2e-4])
    np.testing.assert_allclose(scaled.sub.accel - plain[0].sub.accel, expected, atol=1e-6)


def test_the_lever_arm_acts_through_rigid_rotation(plain, apply):
    trial, _ = apply("lever_arm", y=0.5)
    t = np.arange(4000) / 100.0
    omega, arm = plain[0].main.gyro, np.array([0.0, 0.5, 0.0])
    smooth = np.stack([np.convolve(omega[:, i], np.ones(11) / 11, mode="same") for i in range(3)], axis=-1)
    expected = np.cross(np.gradient(smooth, t, axis=0), arm) + np.cross(smooth, np.cross(smooth, arm))
    seen = (trial.sub.accel - plain[0].sub.accel)[50:-50, 2]
    assert np.corrcoef(seen, expected[50:-50, 2])[0, 1] > 0.99


def test_bending_shows_in_the_truth_in_the_right_size(plain, apply):
    still = plain[1].dynamic_part
    t = np.arange(4000) / 100.0
    thermal = apply("thermal_bending", amplitude=[5.0, 0.0, 0.0], period=80.0)[1].dynamic_part - still
    np.testing.assert_allclose(thermal[:, 0], 5.0 * ARCMIN * np.sin(2.0 * np.pi * t / 80.0), atol=1e-12)
    roll = Rotation.from_quat(plain[0].phins_main.attitude).as_euler("ZXY")[:, 2]
    wave = apply("wave_forced_bending", z=2.0)[1].dynamic_part - still
    assert np.polyfit(roll / DEG, wave[:, 2] / ARCMIN, 1)[0] == pytest.approx(2.0, rel=0.01)
    both = apply("static_misalignment", x=3.0)[1]
    np.testing.assert_allclose(both.static_part - plain[1].static_part, [[3.0 * ARCMIN, 0.0, 0.0]] * 4000, atol=1e-12)
    step = apply("misalignment_step", y=2.0, time=20.0)[1].static_part - plain[1].static_part
    np.testing.assert_allclose(step[[1999, 2000], 1], [0.0, 2.0 * ARCMIN], atol=1e-12)


def test_heel_bending_lags_lateral_force_by_twenty_seconds(plain, apply):
    bent = (apply("heel_bending", x=10.0)[1].dynamic_part - plain[1].dynamic_part)[:, 0] / (10.0 * ARCMIN)
    rate = np.gradient(bent, 0.01)
    np.testing.assert_allclose(20.0 * rate[5:-5] + bent[5:-5], plain[0].main.accel[5:-5, 0], atol=0.02)


def test_slams_ring_as_stated(plain, apply):
    ring = apply("slamming", rate=1.5, amplitude=10.0, frequency=8.0, damping=0.5)[1].dynamic_part
    ring = (ring - plain[1].dynamic_part)[:, 0]
    first = int(np.flatnonzero(np.abs(ring) > 1e-12)[0])
    assert np.diff(ring)[first : first + 3].max() * 100.0 == pytest.approx(10.0 * ARCMIN, rel=0.1)


def test_attitudes_of_the_phins(plain, apply):
    late, _ = apply("phins_latency", delay=0.05)
    for unit in ("phins_main", "phins_sub"):
        delayed, right = getattr(late, unit).attitude, getattr(plain[0], unit).attitude
        apart = (Rotation.from_quat(delayed[5:]) * Rotation.from_quat(right[:-5]).inv()).magnitude()
        moved = (Rotation.from_quat(right[5:]) * Rotation.from_quat(right[:-5]).inv()).magnitude()
        assert np.median(apart) < 0.05 * np.median(moved)
    wrong, truth = apply("phins_attitude_error", y=4.0, period=40.0)
    turned = Rotation.from_quat(wrong.phins_sub.attitude) * Rotation.from_quat(plain[0].phins_sub.attitude).inv()
    R_n_m = Rotation.from_quat(truth.attitude) * Rotation.from_rotvec(truth.total).inv()
    expected = np.outer(np.sin(2.0 * np.pi * np.arange(4000) / 4000.0), [0.0, 4.0 * ARCMIN, 0.0])
    np.testing.assert_allclose(R_n_m.inv().apply(turned.as_rotvec()), expected, atol=0.02 * ARCMIN)
    np.testing.assert_array_equal(wrong.phins_main.attitude, plain[0].phins_main.attitude)


def test_output_of_the_sub(plain, apply):
    sub = plain[0].sub
    clipped = apply("gyro_saturation", limit=2.0)[0].sub.gyro
    np.testing.assert_array_equal(clipped, np.clip(sub.gyro, -2.0 * DEG, 2.0 * DEG))
    assert (np.abs(clipped) == 2.0 * DEG).any()
    counted = apply("gyro_quantization", step=1.0)[0].sub.gyro / 100.0 / (DEG / 3600.0)
    np.testing.assert_allclose(counted, np.rint(counted), atol=1e-6)
    assert np.abs(np.cumsum(counted * DEG / 3600.0 - sub.gyro / 100.0, axis=0)).max() < 2.1 * DEG / 3600.0
    wild = apply("outliers", rate=30.0, size=1.0)[0].sub.gyro - sub.gyro
    sizes = np.abs(wild[wild != 0.0]) / DEG
    assert len(sizes) == 20
    assert sizes.min() >= 0.6 - 1e-9
    assert sizes.max() <= 1.4 + 1e-9
    lost = apply("sample_dropout", rate=0.25, length=7)[0].sub
    missing = np.setdiff1d(sub.stamp, lost.stamp)
    assert 60 <= len(missing) <= 70
    assert len(lost.gyro) == len(lost.accel) == len(lost.stamp)
    jittered = apply("timestamp_jitter", std=1e-3)[0].sub.stamp
    assert (np.diff(jittered) > 0).all()
    assert np.std(jittered - sub.stamp) == pytest.approx(1e6, rel=0.1)


def test_spectra_of_the_sub(plain, apply):
    sub = plain[0].sub.gyro
    noisy = apply("gyro_random_walk", arw=0.1)[0].sub.gyro - sub
    assert np.std(noisy) == pytest.approx(0.1 * DEG / 60.0 * 10.0, rel=0.05)
    shaken = apply("narrowband_vibration", frequency=10.0, amplitude=0.01, axis="y")[0].sub.gyro - sub
    peak = np.abs(np.fft.rfft(shaken[:, 1]))
    assert np.fft.rfftfreq(4000, 0.01)[np.argmax(peak)] == pytest.approx(10.0)
    assert 2.0 * peak.max() / 4000 == pytest.approx(0.01 * DEG * np.sinc(0.1), rel=1e-3)
    assert np.abs(shaken[:, [0, 2]]).max() < 1e-4 * np.abs(shaken[:, 1]).max()


def test_a_slow_gyro_lags_by_its_time_constant(nature):
    quiet = replace(nature, sub=replace(nature.sub, arw=0.0))
    fast, _ = assemble(quiet, (), np.random.default_rng(2))
    slow, _ = assemble(quiet, (CAUSES["gyro_bandwidth"]({"cutoff": 4.0}),), np.random.default_rng(2))
    tau = 1.0 / (2.0 * np.pi * 4.0)
    rate = np.gradient(slow.sub.gyro, 0.01, axis=0)
    restored = slow.sub.gyro + tau * rate
    error = (restored - fast.sub.gyro)[10:-10]
    assert np.std(error) < 0.1 * np.std((slow.sub.gyro - fast.sub.gyro)[10:-10])


def test_the_deck_changes_as_stated():
    long = draw_scene(np.random.default_rng(8), 500.0, 100.0, "navigation", "calm").nature

    def path(name, **stated):
        cause = CAUSES[name](stated)
        streams = dict(zip(STREAMS, np.random.default_rng(4).spawn(len(STREAMS))))
        return shaken_deck(cause.nature(long), (cause,), streams)[1][24_000:-24_000:20] / ARCMIN

    other = path("flexure_parameters", std_arcmin=[20.0, None, None], damping=[0.5, None, None])
    assert np.std(other[:, 0]) == pytest.approx(20.0, rel=0.25)
    growing = path("nonstationary_sea", growth=5.0)
    assert np.std(growing[-15000:]) > 1.7 * np.std(growing[:15000])
    stiff = path("amplitude_stiffening", gain=0.5)
    assert (np.std(stiff, axis=0) < 0.7 * np.std(path("gyro_bias", x=0.0), axis=0)).all()
    coupled = path("axis_coupling", xy=0.9)
    jumps = np.diff(coupled[::10], n=2, axis=0)
    assert np.corrcoef(jumps[:, 0], jumps[:, 1])[0, 1] == pytest.approx(0.9, abs=0.05)
    second = path("second_mode", damping=0.1, frequency=6.0, std_arcmin=3.0, axis="y") - path("gyro_bias", x=0.0)
    assert np.std(second[:, 1]) == pytest.approx(3.0, rel=0.2)
    assert not second[:, 0].any()
    for name, stated in (
        ("bouc_wen", {"hysteretic_share": 0.6, "yield_sigmas": 0.5}),
        ("fractional_flexure", {"order": 0.4, "knee": 0.3}),
    ):
        foreign = path(name, **stated)
        np.testing.assert_allclose(np.std(foreign, axis=0), long.deck.std / ARCMIN, rtol=0.2)


def test_a_swinging_clock_comes_back(plain, apply):
    swung, _ = apply("sinusoidal_clock", amplitude=0.02, period=40.0)
    quarter, half = 1000, 2000
    assert np.abs(swung.sub.accel[half] - plain[0].sub.accel[half]).max() < 1e-3
    np.testing.assert_allclose(swung.sub.gyro[quarter], plain[0].sub.gyro[quarter - 2], atol=5e-6)


def test_a_draw_is_repeatable_and_states_its_answer():
    first, again = (draw(5, effects=["gyro_bias"], duration=30.0, severity=3.0) for _ in range(2))
    np.testing.assert_array_equal(first[0].sub.gyro, again[0].sub.gyro)
    assert first[2] == again[2]
    stated = first[2]["effects"][0]
    assert stated["name"] == "gyro_bias"
    assert stated["listed"]
    assert draw(5, null=True, duration=30.0)[2]["effects"] == []
    assert draw(5, null=False, duration=30.0)[2]["effects"] != []


def test_the_twin_knows_nothing_of_the_effect():
    plain_twin = draw_case(9, effects=[], duration=30.0).twin
    assert draw_case(9, effects=["lever_arm"], duration=30.0).twin == plain_twin
    assert plain_twin.effect == ()


@pytest.mark.parametrize("name", sorted(SEVERITIES))
def test_severity_grows_with_the_multiple(name):
    scene = draw_scene(np.random.default_rng(8), 150.0, 100.0, "fine", "rough")
    multiples = (0.1, 1.0) if name == "bouc_wen" else (1.0, 10.0)  # it cannot be made plainer than so
    weak, strong = (parameters(name, multiple, scene, np.random.default_rng(1)) for multiple in multiples)
    if name != "flexure_parameters":  # which may be off in another parameter, where one cannot be off so plainly
        assert weak.keys() == strong.keys()
    assert weak != strong
    if name in effects.names():
        effects.build(name, strong)
