"""Perfect gyros and accelerometers integrate back to the attitude and velocity they came from."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.twin.worlds import angle_between, enu_to_inertial, integrate, perfect
from twin import simulate

IDAM_FLEXURE = {"damping": [0.2146, 0.2146, 0.0715], "std_arcmin": [6.0, 6.0, 10.0]}


@pytest.fixture(scope="module")
def ten_minutes():
    twin = perfect(run={"duration": 600.01, "rate": 100.0}, flexure=IDAM_FLEXURE, gnss={"rate": 1.0})
    return simulate(twin, np.random.default_rng(1))


def inertial(simulation, attitude):
    """Attitudes at whole seconds in the inertial frame, by way of the fixes of a perfect GNSS receiver."""
    fix, rate = simulation.trial.gnss, simulation.twin.run.rate
    whole = np.arange(0, len(attitude), round(rate))
    t = whole / rate
    R_i_n = enu_to_inertial(fix.latitude[: len(t)], fix.longitude[: len(t)], t)
    return whole, R_i_n @ Rotation.from_quat(attitude[whole]).as_matrix()


def test_main_gyro_reproduces_the_attitude_to_1e_9_rad_over_ten_minutes(ten_minutes) -> None:
    whole, R_i_m = inertial(ten_minutes, ten_minutes.trial.phins_main.attitude)
    turned = R_i_m[0] @ integrate(ten_minutes.trial.main.gyro[1:], 0.01)
    assert angle_between(turned[whole], R_i_m) < 1e-9


def test_sub_gyro_reproduces_the_attitude_of_the_bent_deck(ten_minutes) -> None:
    whole, R_i_s = inertial(ten_minutes, ten_minutes.truth.attitude)
    turned = R_i_s[0] @ integrate(ten_minutes.trial.sub.gyro[1:], 0.01)
    assert angle_between(turned[whole], R_i_s) < 1e-9


def test_sub_attitude_is_main_attitude_times_flexure_times_mounting(ten_minutes) -> None:
    truth, trial = ten_minutes.truth, ten_minutes.trial
    bent = Rotation.from_rotvec(truth.dynamic_part) * Rotation.from_rotvec(truth.static_part)
    expected = Rotation.from_quat(trial.phins_main.attitude) * bent
    assert np.abs((Rotation.from_quat(truth.attitude).inv() * expected).as_rotvec()).max() < 1e-12
    assert np.abs(bent.as_rotvec() - truth.total).max() < 1e-14
    np.testing.assert_allclose(truth.static_part[0], np.radians(np.array([10, 10, 30]) / 60), rtol=1e-12)


def test_both_gyros_meet_in_the_relative_attitude(ten_minutes) -> None:
    """A_m^T R_m_s(0) A_s = R_m_s(t): the quantity every estimator is after."""
    trial, total = ten_minutes.trial, ten_minutes.truth.total
    main, sub = (integrate(unit.gyro[1:], 0.01) for unit in (trial.main, trial.sub))
    start = Rotation.from_rotvec(total[0]).as_matrix()
    found = np.swapaxes(main, -1, -2) @ start @ sub
    assert angle_between(found, Rotation.from_rotvec(total).as_matrix()) < 1e-9


@pytest.mark.parametrize(("rate", "misalignment"), [(10.0, [9000.0, -3000.0, 4000.0]), (200.0, [360.0, 180.0, 120.0])])
def test_any_rate_and_any_misalignment(rate: float, misalignment: list[float]) -> None:
    twin = perfect(run={"duration": 20.0, "rate": rate}, mount={"static_arcmin": misalignment}, flexure=IDAM_FLEXURE)
    simulation = simulate(twin)
    whole, R_i_s = inertial(simulation, simulation.truth.attitude)
    turned = R_i_s[0] @ integrate(simulation.trial.sub.gyro[1:], 1.0 / rate)
    assert angle_between(turned[whole], R_i_s) < 1e-11


def test_specific_force_with_gravity_and_coriolis_integrates_back_to_the_velocity() -> None:
    phases = [{"start": 5.0, "ramp": 20.0, "speed": 5.0, "heading": 100.0}]
    sea = {"heave": [[1.0, 9.0, 20.0]], "sway": [[0.5, 11.0, 0.0]], "surge": [[0.3, 12.0, 0.0]]}
    simulation = simulate(perfect(run={"duration": 60.0}, sea=sea, ship={"phase": phases, "height": 40.0}))
    trial, dt = simulation.trial, 0.01
    middle = Rotation.from_quat(trial.phins_main.attitude[:-1]) * Rotation.from_rotvec(0.5 * dt * trial.main.gyro[1:])
    force = middle.apply(trial.main.accel[1:])
    velocity = navigate(force, dt, trial.gnss.latitude[0], start=ship_velocity(simulation, 0.0))
    for second in (20.0, 40.0, 59.0):
        np.testing.assert_allclose(velocity[round(second / dt)], ship_velocity(simulation, second), atol=2e-4)


def ship_velocity(simulation, t: float) -> np.ndarray:
    from twin.simulation import STREAMS, make_world

    streams = dict(zip(STREAMS, np.random.default_rng(simulation.twin.run.seed).spawn(len(STREAMS))))
    return make_world(simulation.twin, streams).scene.motion(np.array([t])).velocity[0]


def navigate(force: np.ndarray, dt: float, lat: float, start: np.ndarray) -> np.ndarray:
    """Euler-midpoint navigation equation dv/dt = f - (2 w_ie + w_en) x v + g, from its textbook form."""
    velocity = [start]
    omega = 7.292115e-5 * np.array([0.0, np.cos(lat), np.sin(lat)])
    e2, a = 0.00669437999014, 6378137.0
    n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    m = n * (1 - e2) / (1 - e2 * np.sin(lat) ** 2)
    sin2 = np.sin(lat) ** 2
    g = 9.780327 * (1 + 5.3024e-3 * sin2 - 5.8e-6 * np.sin(2 * lat) ** 2) - 3.086e-6 * 40.0
    for f in force:
        v = velocity[-1]
        transport = np.array([-v[1] / m, v[0] / n, v[0] * np.tan(lat) / n])
        velocity.append(v + dt * (f - np.cross(2 * omega + transport, v) - [0.0, 0.0, g]))
    return np.array(velocity)
