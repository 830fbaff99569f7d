"""Ship motion against differences of its own positions and attitudes, in the inertial frame."""

import numpy as np
import pytest

from physics import quaternions
from tests.twin.worlds import EARTH_RATE, enu_to_inertial
from twin.config import Phase, Sea, Ship
from twin.motion import ShipMotion, Steps
from twin.sea import MOTIONS, realise

A, E2, GM = 6378137.0, 0.0066943799901414, 3.986004418e14

SHIPS = {
    "waves": Ship(latitude=45.0, speed=20.0, height=20.0),
    "south, west, fast": Ship(latitude=-62.0, longitude=-178.0, heading=-130.0, speed=45.0, height=-30.0),
    "manoeuvres": Ship(
        latitude=12.0,
        phase=(
            Phase(start=0.0, ramp=30.0, weave=30.0, speed=5.0),
            Phase(start=40.0, ramp=20.0, heading=120.0, sea=0.3),
        ),
    ),
}
SEA = Sea(
    pitch=((10.0, 8.0, 0.0), (1.0, 5.0, 40.0)),
    roll=((12.0, 9.0, 30.0),),
    heading=((4.0, 11.0, 80.0),),
    surge=((0.4, 9.0, 10.0),),
    sway=((0.7, 8.0, 50.0),),
    heave=((1.5, 7.0, 0.0),),
)


@pytest.fixture(params=SHIPS.values(), ids=SHIPS.keys())
def ship(request) -> ShipMotion:
    return ShipMotion(request.param, realise(SEA, np.random.default_rng(0)), (-5.0, 100.0))


def inertial_position(ship: ShipMotion, t: np.ndarray) -> np.ndarray:
    """Geocentric position (n, 3) m from latitude, longitude and height, turned with the Earth."""
    motion = ship.at(t)
    lat, h = motion.latitude, motion.height
    n = A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    lon = motion.longitude + EARTH_RATE * t
    return np.stack(
        [(n + h) * np.cos(lat) * np.cos(lon), (n + h) * np.cos(lat) * np.sin(lon), (n * (1 - E2) + h) * np.sin(lat)],
        axis=-1,
    )


def test_specific_force_is_inertial_acceleration_less_gravitation(ship: ShipMotion) -> None:
    """The oracle knows no Coriolis, transport rate or local-level frame: positions in space and Newton."""
    t, h = np.linspace(1.0, 95.0, 48), 0.25
    weight = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
    acceleration = sum(w * inertial_position(ship, t + (k - 4) * h) for k, w in enumerate(weight)) / h**2
    motion = ship.at(t)
    R_i_n = enu_to_inertial(motion.latitude, motion.longitude, t)
    position = inertial_position(ship, t)
    spin = np.array([0.0, 0.0, EARTH_RATE])
    from physics import earth

    plumb = -earth.gravity(motion.latitude, motion.height)[:, None] * R_i_n[:, :, 2]
    gravitation = plumb + np.cross(spin, np.cross(spin, position))
    force = np.einsum("nij,nj->ni", R_i_n, quaternions.rotate(motion.q_n_m, motion.specific_force))
    np.testing.assert_allclose(force, acceleration - gravitation, atol=2e-6)


def test_rates_are_those_of_the_attitude(ship: ShipMotion) -> None:
    t, h = np.linspace(1.0, 95.0, 200), 1e-3
    before, after, now = ship.at(t - h), ship.at(t + h), ship.at(t)
    turn = quaternions.log(quaternions.multiply(quaternions.conjugate(before.q_i_m), after.q_i_m))
    np.testing.assert_allclose(turn / (2 * h), now.omega, atol=5e-8)
    np.testing.assert_allclose((after.omega - before.omega) / (2 * h), now.omega_dot, atol=5e-8)


def test_attitude_is_heading_pitch_roll_in_this_order(ship: ShipMotion) -> None:
    motion = ship.at(np.array([10.0, 33.3]))
    p, r, h = motion.angles.T

    def rot(axis: int, angle: float) -> np.ndarray:
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        out = np.eye(3)
        out[i, i] = out[j, j] = np.cos(angle)
        out[i, j], out[j, i] = -np.sin(angle), np.sin(angle)
        return out

    for k in range(2):
        expected = rot(2, h[k]) @ rot(0, p[k]) @ rot(1, r[k])
        np.testing.assert_allclose(quaternions.rotate(motion.q_n_m[k], np.eye(3)).T, expected, atol=1e-14)


def test_a_ship_heading_north_west_goes_north_west() -> None:
    still = Sea(pitch=(), roll=(), heading=())
    ship = ShipMotion(Ship(heading=45.0, speed=20.0), realise(still, np.random.default_rng(0)), (-1.0, 100.0))
    motion = ship.at(np.array([50.0]))
    speed = 20 * 1852 / 3600
    np.testing.assert_allclose(motion.velocity[0], [-speed / np.sqrt(2), speed / np.sqrt(2), 0.0], atol=1e-12)
    bow = quaternions.rotate(motion.q_n_m, np.array([[0.0, 1.0, 0.0]]))
    np.testing.assert_allclose(bow, motion.velocity / speed, atol=1e-12)


def test_at_rest_the_accelerometer_shows_plus_g_on_z_and_the_gyro_the_earth() -> None:
    still = Sea(pitch=(), roll=(), heading=())
    ship = ShipMotion(
        Ship(speed=0.0, heading=0.0, latitude=30.0), realise(still, np.random.default_rng(0)), (-1.0, 9.0)
    )
    motion = ship.at(np.array([4.0]))
    np.testing.assert_allclose(motion.specific_force[0], [0.0, 0.0, 9.7932], atol=1e-3)
    np.testing.assert_allclose(motion.omega[0], EARTH_RATE * np.array([0.0, np.cos(np.pi / 6), 0.5]), atol=1e-15)


def test_phases_reach_their_speed_heading_and_sea() -> None:
    ship = Ship(speed=12.0, heading=45.0, phase=(Phase(start=10.0, ramp=20.0, speed=0.0, sea=0.0, heading=90.0),))
    world = ShipMotion(ship, realise(SEA, np.random.default_rng(0)), (-1.0, 60.0))
    motion = world.at(np.array([5.0, 35.0]))
    assert np.linalg.norm(motion.velocity[0, :2]) > 5.0
    np.testing.assert_allclose(motion.velocity[1], 0.0, atol=1e-12)
    np.testing.assert_allclose(motion.angles[1], [0.0, 0.0, np.pi / 2], atol=1e-12)


def test_steps_have_their_derivatives() -> None:
    steps = Steps.through(1.0, [(2.0, 4.0, 3.0), (5.0, 2.0, -1.0)])
    t, h = np.linspace(0.0, 9.0, 91), 1e-4
    value, plus, minus = steps.at(t), steps.at(t + h), steps.at(t - h)
    np.testing.assert_allclose((plus[:, :2] - minus[:, :2]) / (2 * h), value[:, 1:], atol=1e-6)
    np.testing.assert_allclose(value[[0, -1], 0], [1.0, -1.0])


def test_a_spectrum_has_its_significant_amplitude_and_period() -> None:
    sea = Sea(model="spectrum", roll_significant=6.0, roll_period=10.0, pitch_significant=2.0, components=60)
    motions = realise(sea, np.random.default_rng(8))
    assert set(motions) == set(MOTIONS)
    t = np.arange(0.0, 20_000.0, 0.5)
    roll = np.degrees(motions["roll"].at(t)[:, 0])
    assert 2 * roll.std() == pytest.approx(6.0, rel=0.02)
    power = np.abs(np.fft.rfft(roll)) ** 2
    centroid = (power * np.fft.rfftfreq(len(t), 0.5)).sum() / power.sum()
    assert 0.09 < centroid < 0.13
    assert realise(sea, np.random.default_rng(9))["roll"].phase[0] != motions["roll"].phase[0]
