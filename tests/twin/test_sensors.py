import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin import sensors
from twin.config import Imu, Phins

DPH = np.pi / 180 / 3600


def test_non_orthogonality_xy_is_the_y_rate_seen_on_x() -> None:
    belief = Imu(
        gyro_bias_dph=(0, 0, 0), gyro_arw=0, gyro_scale_ppm=(0, 0, 0), gyro_nonorthogonality_arcsec=(1, 2, 3, 4, 5, 6)
    )
    arcsec = np.pi / 180 / 3600
    only_y = sensors.spoil_gyro(np.array([[0.0, 1.0, 0.0]]), belief, 100.0, np.random.default_rng(0))
    np.testing.assert_allclose(only_y[0], [1 * arcsec, 1.0, 6 * arcsec], rtol=1e-12)
    only_z = sensors.spoil_gyro(np.array([[0.0, 0.0, 1.0]]), belief, 100.0, np.random.default_rng(0))
    np.testing.assert_allclose(only_z[0], [2 * arcsec, 4 * arcsec, 1.0], rtol=1e-12)


def test_scale_and_bias() -> None:
    belief = Imu(
        gyro_bias_dph=(1, -2, 3), gyro_arw=0, gyro_scale_ppm=(10, -20, 30), gyro_nonorthogonality_arcsec=(0,) * 6
    )
    found = sensors.spoil_gyro(np.full((1, 3), 0.5), belief, 100.0, np.random.default_rng(0))
    expected = 0.5 * (1 + np.array([10, -20, 30]) * 1e-6) + np.array([1, -2, 3]) * DPH
    np.testing.assert_allclose(found[0], expected, rtol=1e-14)


@pytest.mark.parametrize("rate", [10.0, 200.0])
def test_integrated_gyro_noise_is_the_angle_random_walk_at_any_rate(rate: float) -> None:
    belief = Imu(
        gyro_bias_dph=(0, 0, 0), gyro_arw=0.01, gyro_scale_ppm=(0, 0, 0), gyro_nonorthogonality_arcsec=(0,) * 6
    )
    noise = sensors.spoil_gyro(np.zeros((100_000, 3)), belief, rate, np.random.default_rng(1))
    walk = noise.std() / np.sqrt(rate)  # rad/sqrt(s)
    assert np.degrees(walk) * 60 == pytest.approx(0.01, rel=0.01)  # deg/sqrt(h)


def test_accelerometer_noise_and_bias() -> None:
    belief = Imu(accel_bias_ug=(100, 0, -100), accel_vrw_ug=10.0)
    found = sensors.spoil_accel(np.zeros((100_000, 3)), belief, 100.0, np.random.default_rng(2))
    np.testing.assert_allclose(found.mean(axis=0) / 9.80665e-6, [100, 0, -100], atol=1.5)
    np.testing.assert_allclose(found.std(axis=0) / 9.80665e-6, 100.0, rtol=0.01)  # 10 ug/sqrt(Hz) over +-50 Hz


def test_markov_drift_is_stationary_from_the_first_sample() -> None:
    rng = np.random.default_rng(3)
    first = np.array([sensors.markov(2, 0.01, [1.0, 2.0], 300.0, rng)[0] for _ in range(4000)])
    np.testing.assert_allclose(first.std(axis=0), [1.0, 2.0], rtol=0.04)
    long = sensors.markov(2_000_000, 1.0, [0.5], 20.0, rng)[:, 0]
    assert long.std() == pytest.approx(0.5, rel=0.03)
    assert np.mean(long[20:] * long[:-20]) / 0.25 == pytest.approx(np.exp(-1), abs=0.03)


def test_phins_attitude_is_the_imu_turned_by_its_installation() -> None:
    """R_n_m = R_n_phins R_imu_phins^T, R_imu_phins = Rz(heading) Rx(pitch) Ry(roll)."""
    R_n_m = Rotation.random(20, random_state=1)
    quiet = Phins(attitude_noise_arcmin=0.0, attitude_drift_arcmin=(0, 0, 0))
    pitch, roll, heading = -0.041, 0.430, -0.250
    found = sensors.phins_attitude(R_n_m.as_quat(), (pitch, roll, heading), quiet, 100.0, np.random.default_rng(0))
    R_imu_phins = (
        Rotation.from_rotvec([0, 0, np.radians(heading)])
        * Rotation.from_rotvec([np.radians(pitch), 0, 0])
        * Rotation.from_rotvec([0, np.radians(roll), 0])
    )
    back = Rotation.from_quat(found) * R_imu_phins.inv()
    assert np.abs((R_n_m.inv() * back).as_rotvec()).max() < 1e-14


def test_phins_drift_lives_in_enu_and_noise_is_white() -> None:
    level = np.tile(Rotation.from_euler("z", 1.0).as_quat(), (200_000, 1))
    belief = Phins(attitude_noise_arcmin=0.0, attitude_drift_arcmin=(0.0, 0.0, 0.6), attitude_drift_tau=1.0)
    found = Rotation.from_quat(sensors.phins_attitude(level, (0, 40, 0), belief, 100.0, np.random.default_rng(5)))
    clean = Rotation.from_quat(level) * Rotation.from_euler("y", np.radians(40))
    error = np.degrees((found * clean.inv()).as_rotvec()) * 60
    np.testing.assert_allclose(error.std(axis=0), [0.0, 0.0, 0.6], atol=0.03)  # about up, though the unit is tilted
    noisy = belief.model_copy(update={"attitude_noise_arcmin": 0.06, "attitude_drift_arcmin": (0.0, 0.0, 0.0)})
    found = Rotation.from_quat(sensors.phins_attitude(level, (0, 40, 0), noisy, 100.0, np.random.default_rng(6)))
    error = np.degrees((found * clean.inv()).as_rotvec()) * 60
    np.testing.assert_allclose(error.std(axis=0), 0.06, rtol=0.01)
    assert abs(np.corrcoef(error[1:, 0], error[:-1, 0])[0, 1]) < 0.01


def test_outliers_come_at_their_rate_and_size() -> None:
    found = sensors.outliers(600_000, 100.0, 6.0, 0.5, np.random.default_rng(7))
    hit = np.abs(found).max(axis=1) > 0
    assert hit.sum() == pytest.approx(600, abs=4 * np.sqrt(600))  # 100 min at 6 a minute
    size = np.degrees(np.abs(found[hit]).max(axis=1))
    assert 0.25 <= size.min() < 0.35
    assert 0.65 < size.max() <= 0.75
    assert ((found != 0).sum(axis=1) <= 1).all()
