import numpy as np
from scipy.spatial.transform import Rotation

from tests.twin.effects.worlds import ARCMIN, LIVELY, PLUMB, STIFF, pair, table

UG = 9.80665e-6


def test_accelerometer_bias_is_constant() -> None:
    plain, biased = pair(table("accel_bias", x=500.0, y=-30.0, z=7.0))
    added = (biased.trial.sub.accel - plain.trial.sub.accel) / UG
    np.testing.assert_allclose(added, np.tile([500.0, -30.0, 7.0], (3000, 1)), atol=1e-6)


def test_accelerometer_scale_is_a_ratio() -> None:
    plain, scaled = pair(table("accel_scale_factor", x=100.0, y=-200.0, z=300.0), flexure=LIVELY)
    expected = plain.trial.sub.accel * [1.0001, 0.9998, 1.0003]
    np.testing.assert_allclose(scaled.trial.sub.accel, expected, atol=1e-12)


def test_lever_arm_error_adds_the_force_of_the_turning_ship() -> None:
    error = np.array([0.3, -0.5, 0.2])
    effect = table("lever_arm", x=0.3, y=-0.5, z=0.2)
    plain, moved = pair(effect, flexure=STIFF, mount=PLUMB, run={"rate": 200.0, "duration": 15.0})
    omega = plain.trial.main.gyro[1:-1]
    omega_dot = (plain.trial.main.gyro[2:] - plain.trial.main.gyro[:-2]) * 100.0
    force = np.cross(omega_dot, error) + np.cross(omega, np.cross(omega, error))
    added = (moved.trial.sub.accel - plain.trial.sub.accel)[1:-1]
    np.testing.assert_allclose(added, force, atol=2e-5)
    assert np.abs(force).max() > 0.05


def test_static_misalignment_adds_to_the_vector() -> None:
    mount = {"static_arcmin": [600.0, -300.0, 1200.0]}
    plain, turned = pair(table("static_misalignment", x=60.0, y=0.0, z=-30.0), mount=mount, flexure=LIVELY)
    R_m_s = Rotation.from_rotvec(turned.truth.dynamic_part) * Rotation.from_rotvec(
        np.array([660.0, -300.0, 1170.0]) * ARCMIN
    )
    np.testing.assert_allclose(turned.truth.total, R_m_s.as_rotvec(), atol=1e-12)
    np.testing.assert_array_equal(turned.truth.dynamic_part, plain.truth.dynamic_part)


def test_static_misalignment_turns_gyro_and_force_alike() -> None:
    plain, turned = pair(table("static_misalignment", x=60.0, y=10.0, z=-30.0), mount=PLUMB, flexure=STIFF)
    R_m_s = Rotation.from_rotvec(np.array([60.0, 10.0, -30.0]) * ARCMIN)
    for key in ("gyro", "accel"):
        expected = R_m_s.inv().apply(getattr(plain.trial.sub, key))
        np.testing.assert_allclose(getattr(turned.trial.sub, key), expected, atol=1e-11)


def test_a_step_turns_the_sub_imu_once_and_leaves_its_place() -> None:
    step = np.array([2.0, 0.0, -3.0]) * ARCMIN
    plain, slipped = pair(table("misalignment_step", x=2.0, z=-3.0, time=10.0), mount=PLUMB, flexure=STIFF)
    t = np.arange(3000) * 0.01
    np.testing.assert_allclose(slipped.truth.static_part, np.outer(t > 10.0, step), atol=1e-15)
    before, after = slice(0, 1001), slice(1002, None)
    R_s_m = Rotation.from_rotvec(step).inv()
    for key in ("gyro", "accel"):
        a, b = getattr(plain.trial.sub, key), getattr(slipped.trial.sub, key)
        np.testing.assert_allclose(b[before], a[before], atol=1e-12)
        np.testing.assert_allclose(b[after], R_s_m.apply(a[after]), atol=1e-11)
    jump = (slipped.trial.sub.gyro - plain.trial.sub.gyro)[1001] * 0.01
    np.testing.assert_allclose(jump, step, atol=2e-6)
