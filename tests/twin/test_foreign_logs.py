"""The twin's motion and sampling against logs of an independent generator, driven by the same twin files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import quaternions
from schemas.wire import read_log
from twin import load_twin
from twin.motion import ShipMotion
from twin.sea import realise

LOGS = Path(__file__).parents[2].parent / "shared" / "logs"
pytestmark = pytest.mark.skipif(not LOGS.exists(), reason="needs the shared logs beside the repository")

DPH, MICRO_G = np.pi / 180 / 3600, 9.80665e-6
NOISE = {"sliding-sim": 2.91e-6, "stalign-sim": 3.29e-6}  # rad/s a sample: ARW sqrt(rate)


@pytest.fixture(scope="module", params=NOISE)
def foreign(request):
    twin = load_twin(LOGS / f"{request.param}.twin.toml")
    tables = read_log(LOGS / f"{request.param}.mcap", ["/imu/main", "/imu/sub", "/truth/deformation"]).tables
    stamp = tables["/imu/main"].columns["header.stamp"]
    t = (stamp - stamp[0]) * 1e-9
    ship = ShipMotion(twin.ship, realise(twin.sea, np.random.default_rng(0)), (-1.0, t[-1] + 1.0))
    return request.param, twin, tables, ship, t


def increments(attitude: np.ndarray, dt: float) -> np.ndarray:
    return quaternions.log(quaternions.multiply(quaternions.conjugate(attitude[:-1]), attitude[1:])) / dt


def test_main_gyro_differs_by_its_own_noise_alone(foreign) -> None:
    name, twin, tables, ship, t = foreign
    error = tables["/imu/main"].vector("angular_velocity")[1:] - increments(ship.at(t).q_i_m, 1 / twin.run.rate)
    np.testing.assert_allclose(error.std(axis=0), NOISE[name], rtol=0.03)
    assert np.abs(error.mean(axis=0)).max() < 3 * max(np.abs(twin.imu.main.gyro_bias_dph)) * DPH


def test_level_axes_of_the_main_accelerometer_agree(foreign) -> None:
    _, twin, tables, ship, t = foreign
    middle = ship.at(t - 0.5 / twin.run.rate).specific_force
    error = tables["/imu/main"].vector("linear_acceleration") - middle
    white = 10 * MICRO_G * np.sqrt(twin.run.rate)
    assert (error.std(axis=0)[:2] < 2 * white).all()  # heave of the other generator shows on the tilted axes a little
    assert np.abs(error.mean(axis=0)).max() < 100 * MICRO_G


def test_sub_gyro_follows_flexure_mounting_and_delay(foreign) -> None:
    name, twin, tables, ship, t = foreign
    total = tables["/truth/deformation"].vector("total")
    lag = round(twin.mount.time_delay * twin.run.rate)
    q_i_s = quaternions.multiply(ship.at(t).q_i_m, Rotation.from_rotvec(total).as_quat())
    gyro = tables["/imu/sub"].vector("angular_velocity")
    error = gyro[1 + lag :] - increments(q_i_s, 1 / twin.run.rate)[: len(gyro) - 1 - lag]
    np.testing.assert_allclose(error.std(axis=0), NOISE[name], rtol=0.05)
