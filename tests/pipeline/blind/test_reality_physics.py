"""The independent reality obeys physics: checked against scipy, finite differences and plain integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from physics import earth
from pipeline.blind.reality import sensing
from pipeline.blind.reality.assembly import STREAMS, assemble, make_world
from pipeline.blind.reality.drawing import CAUSES
from pipeline.blind.reality.nature import Nature, Unit
from pipeline.blind.reality.scenes import draw_scene
from pipeline.blind.reality.turns import Turns

ARCMIN = np.pi / 180.0 / 60.0
GRAVITATION = 3.986004418e14
ORBIT = 7.292115e-5


@pytest.fixture(scope="module")
def nature() -> Nature:
    rng = np.random.default_rng(3)
    return draw_scene(rng, 60.0, 100.0, "navigation", "rough").nature


def world_of(nature, *causes, seed=5):
    streams = dict(zip(STREAMS, np.random.default_rng(seed).spawn(len(STREAMS))))
    return make_world(nature, [CAUSES[name](values) for name, values in causes], streams)


def silent(nature, *causes, seed=5):
    """A trial without noise and biases."""
    quiet = Unit(np.zeros(3), np.zeros((3, 3)), 0.0, np.zeros(3), 0.0)
    from dataclasses import replace

    phins = replace(nature.phins, drift=np.zeros(3), noise=0.0, arw=0.0, vrw=0.0)
    calm = replace(nature, main=quiet, sub=quiet, phins=phins)
    return assemble(calm, [CAUSES[name](values) for name, values in causes], np.random.default_rng(seed))


def scipy_of(turns: Turns) -> Rotation:
    return Rotation.from_quat(turns.xyzw)


def test_turns_agree_with_scipy():
    rng = np.random.default_rng(0)
    a, b, v = rng.normal(size=(3, 50, 3))
    a[0], b[0] = 1e-9, 0.0
    ours = Turns.of_vectors(a) @ Turns.of_vectors(b).inverse
    theirs = Rotation.from_rotvec(a) * Rotation.from_rotvec(b).inv()
    np.testing.assert_allclose(ours.apply(v), theirs.apply(v), atol=1e-13)
    np.testing.assert_allclose(ours.vectors, theirs.as_rotvec(), atol=1e-12)


def test_integrating_the_rate_gives_the_attitude(nature):
    ship = world_of(nature).ship
    step, count = 0.005, 6000
    nodes = step * np.arange(2 * count + 1) / 2.0
    omega = ship.at(nodes).omega
    turned = Rotation.identity()
    # Magnus expansion of fourth order on three points of each step (Simpson)
    w0, wm, w1 = omega[:-1:2], omega[1::2], omega[2::2]
    parts = Rotation.from_rotvec(step / 6.0 * (w0 + 4.0 * wm + w1) + step**2 / 12.0 * np.cross(w0, w1))
    for part in parts:
        turned = turned * part
    ends = scipy_of(ship.at(nodes[[0, -1]]).R_i_m)
    error = (ends[0].inv() * ends[1]).inv() * turned
    assert error.magnitude() < 1e-9


def test_mean_rates_of_all_units_reproduce_their_attitudes(nature):
    trial, truth = silent(nature)
    for series, attitude in ((trial.main, None), (trial.sub, Rotation.from_quat(truth.attitude))):
        turned = Rotation.identity()
        for part in Rotation.from_rotvec(series.gyro[1:] / nature.rate):
            turned = turned * part
        if attitude is None:
            ship = world_of(nature).ship
            attitude_i = scipy_of(ship.at(np.array([0.0, 59.99])).R_i_m)
        else:
            place = world_of(nature).ship.at(np.array([0.0, 59.99]))
            R_i_n = scipy_of(place.R_i_m) * scipy_of(place.R_n_m).inv()
            attitude_i = R_i_n * attitude[[0, -1]]
        assert ((attitude_i[0].inv() * attitude_i[1]).inv() * turned).magnitude() < 1e-9


def test_the_derivative_of_the_rate_is_one(nature):
    ship, t, h = world_of(nature).ship, np.linspace(1.0, 50.0, 200), 1e-3
    difference = (ship.at(t + h).omega - ship.at(t - h).omega) / (2.0 * h)
    np.testing.assert_allclose(ship.at(t).omega_dot, difference, atol=3e-7)


def inertial_place(place: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Position (n, 3) m in the frame that the Earth-fixed one passes at t = 0."""
    latitude, longitude, height = place.T
    transverse = earth.radii(latitude)[1]
    polar = transverse * (1.0 - earth.ECCENTRICITY_SQUARED) + height
    turned = longitude + ORBIT * t
    flat = (transverse + height) * np.cos(latitude)
    return np.stack([flat * np.cos(turned), flat * np.sin(turned), polar * np.sin(latitude)], axis=-1)


def second_difference(points: np.ndarray, h: float) -> np.ndarray:
    """Sixth order, from seven neighbouring instants (7, n, 3)."""
    weights = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / (180.0 * h * h)
    return np.tensordot(weights, points, axes=1)


@pytest.mark.parametrize("lever", [False, True], ids=["main", "sub"])
def test_specific_force_is_acceleration_less_gravitation(nature, lever):
    world = world_of(nature)
    t, h = np.linspace(5.0, 50.0, 60), 0.02
    arm = nature.deck.lever
    points = []
    for k in range(-3, 4):
        state = world.ship.at(t + k * h)
        bent = Rotation.from_rotvec(world.lever.at(t + k * h)[0]).apply(arm) if lever else np.zeros((len(t), 3))
        points.append(inertial_place(state.place, t + k * h) + scipy_of(state.R_i_m).apply(bent))
    state = world.ship.at(t)
    force = sensing.lever_force(state, arm, world.lever.at(t)) if lever else state.force
    # Gravitation is normal gravity (vertical) plus the centrifugal part taken back out.
    up = Rotation.from_quat(scipy_of(state.R_i_m).as_quat()) * scipy_of(state.R_n_m).inv()
    gravity = up.apply(np.outer(-earth.gravity(state.place[:, 0], state.place[:, 2]), [0.0, 0.0, 1.0]))
    axis_distance = inertial_place(state.place, t) * np.array([1.0, 1.0, 0.0])
    gravitation = gravity - ORBIT**2 * axis_distance
    expected = scipy_of(state.R_i_m).inv().apply(second_difference(np.array(points), h) - gravitation)
    np.testing.assert_allclose(force, expected, atol=2e-4 if lever else 5e-5)


def test_the_sub_turns_with_the_deck(nature):
    """omega_s = R_s_m (omega_m + theta') to first order, R_m_s = Exp(theta) Exp(Phi)."""
    trial, truth = silent(nature)
    relative = Rotation.from_rotvec(truth.dynamic_part) * Rotation.from_rotvec(truth.static_part)
    np.testing.assert_allclose((relative.inv() * Rotation.from_rotvec(truth.total)).magnitude(), 0.0, atol=1e-12)
    theta_dot = np.diff(truth.dynamic_part, axis=0) * nature.rate
    middle = Rotation.from_rotvec(0.5 * (truth.dynamic_part[1:] + truth.dynamic_part[:-1]))
    seen = (middle * Rotation.from_rotvec(truth.static_part[1:])).inv().apply(trial.main.gyro[1:] + theta_dot)
    assert np.abs(trial.sub.gyro[1:] - seen).max() < 2e-3 * np.abs(theta_dot).max()


def test_attitude_of_a_phins_carries_its_installation(nature):
    trial, truth = silent(nature)
    pitch, roll, heading = nature.phins.installation_sub
    seat = Rotation.from_euler("ZXY", [heading, pitch, roll])
    error = Rotation.from_quat(trial.phins_sub.attitude) * (Rotation.from_quat(truth.attitude) * seat).inv()
    assert error.magnitude().max() < 1e-12
    turned = seat.inv().apply(trial.sub.gyro)
    np.testing.assert_allclose(trial.phins_sub.gyro, turned, atol=1e-12)


def test_a_force_sample_is_the_mean_over_the_interval_that_ends_at_its_stamp(nature):
    world, (trial, _) = world_of(nature), silent(nature)
    for k in (1, 777, 5000):
        fine = k / 100.0 - 0.01 + 0.01 * (np.arange(200) + 0.5) / 200.0
        np.testing.assert_allclose(trial.main.accel[k], world.ship.at(fine).force.mean(axis=0), atol=1e-7)


def test_a_delayed_sample_was_measured_earlier(nature):
    plain, _ = silent(nature)
    late, _ = silent(nature, ("time_delay", {"delay": 0.03}))
    np.testing.assert_allclose(late.sub.gyro[10:], plain.sub.gyro[7:-3], atol=2e-9)
    np.testing.assert_allclose(late.sub.accel[10:], plain.sub.accel[7:-3], atol=1e-6)
    np.testing.assert_array_equal(late.sub.stamp, plain.sub.stamp)
    np.testing.assert_array_equal(late.phins_sub.attitude, plain.phins_sub.attitude)


def test_a_fast_clock_makes_the_delay_grow(nature):
    plain, _ = silent(nature)
    fast, _ = silent(nature, ("clock_drift", {"drift": 1000.0}))
    at_end = 60.0 * 1e-3 / (1.0 + 1e-3)
    t = np.arange(6000) / 100.0
    expected = np.stack([np.interp(t - at_end * t / 60.0, t, plain.sub.gyro[:, i]) for i in range(3)], axis=-1)
    delayed = np.abs(fast.sub.gyro[4000:] - expected[4000:]).max()
    assert delayed < 0.1 * np.abs(fast.sub.gyro[4000:] - plain.sub.gyro[4000:]).max()


def test_the_rate_equation_of_the_flexure_holds_on_average():
    """Variance, and autocorrelation exp(-mu t) (cos + mu / lambda sin), of a long path."""
    from pipeline.blind.reality.flexure import STEP, shaken

    mu, frequency, std, n = 0.4, 1.5, 2e-3, 2_000_000
    noise = np.random.default_rng(1).standard_normal(n)
    x = shaken(mu, mu**2 + frequency**2, std, (0.0, 1.0, 1.0), np.ones(n), noise, (0.0, 0.0), STEP)[40_000:]
    assert np.std(x) == pytest.approx(std, rel=0.1)
    lag = round(1.0 / STEP)
    expected = np.exp(-mu) * (np.cos(frequency) + mu / frequency * np.sin(frequency))
    assert np.mean(x[lag:] * x[:-lag]) / np.var(x) == pytest.approx(expected, abs=0.08)
    # The forcing: twice the integral of motion gives back white noise of density 4 mu b^2 sigma^2.
    rate = np.diff(x) / STEP
    jumps = rate[20::20] - rate[:-20:20]
    density = 4.0 * mu * (mu**2 + frequency**2) * std**2
    assert np.var(jumps) / (20 * STEP) == pytest.approx(density, rel=0.1)


def test_a_free_oscillator_rings_as_it_should():
    from pipeline.blind.reality.flexure import STEP, shaken

    mu, frequency = 0.2, 2.0
    still = np.zeros(8000)
    x = shaken(mu, mu**2 + frequency**2, 1.0, (0.0, 1.0, 1.0), still, still, (1.0, 0.0), STEP)
    t = STEP * np.arange(1, 8001)
    exact = np.exp(-mu * t) * (np.cos(frequency * t) + mu / frequency * np.sin(frequency * t))
    np.testing.assert_allclose(x, exact, atol=1e-6)


def test_a_stiffened_or_hysteretic_oscillator_agrees_with_a_general_solver():
    from pipeline.blind.reality.flexure import STEP, shaken

    mu, stiffness, gain, share, yields = 0.1, 2.0, 3.0, 0.5, 0.3

    def slope(_, state):
        x, v, z = state
        force = stiffness * (share * x + (1.0 - share) * z) * (1.0 + gain * x * x)
        return [v, -2.0 * mu * v - force, v - 0.5 * (abs(v) * z + abs(z) * v) / yields]

    still = np.zeros(10_000)
    x = shaken(mu, stiffness, 1.0, (gain, share, yields), still, still, (0.6, 0.0), STEP)
    t = STEP * np.arange(1, 10_001)
    exact = solve_ivp(slope, (0.0, 5.0), [0.6, 0.0, 0.6], t_eval=t, rtol=1e-9, atol=1e-11).y[0]
    np.testing.assert_allclose(x, exact, atol=3e-4)


def test_the_lever_table_holds_its_own_derivatives(nature):
    lever = world_of(nature).lever
    t, h = np.linspace(1.0, 55.0, 300), 1e-3
    ahead, behind, here = lever.at(t + h), lever.at(t - h), lever.at(t)
    for order in (0, 1):
        difference = (ahead[order] - behind[order]) / (2.0 * h)
        assert np.abs(difference - here[order + 1]).max() < 1e-2 * np.abs(here[order + 1]).max()
