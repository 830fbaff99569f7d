"""Units, signs and axes are doubted when they should be, and not when the motion is merely unusual."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.trial import ImuSeries
from stages.decode import plausible
from tests.stages.decode import synthetic


def unit(seed=1, mounting=None, gyro=1.0, attitude=True):
    attitudes, rates, accel = synthetic.imu_data(seed, mounting)
    return ImuSeries(synthetic.stamps(), gyro * rates, accel, attitudes.as_quat() if attitude else None)


def test_a_sound_unit_raises_no_doubt():
    sound = unit()
    assert plausible.specific_force(sound.accel, "main") is None
    assert plausible.gyro_against_attitude(sound, "main") is None
    assert plausible.gyro_against_gravity(sound, "main") is None
    assert plausible.attitude_against_gravity(sound, "main") is None
    assert plausible.upright(sound.accel, "main") is None


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 179.0])
def test_a_sub_unit_may_be_mounted_at_any_angle(degrees):
    mounting = Rotation.from_rotvec(np.deg2rad(degrees) * np.array([0.6, 0.0, 0.8]))
    assert plausible.pair(unit(1), unit(2, mounting)) is None


def test_rates_in_degrees_are_seen_from_gravity_attitude_and_the_other_unit():
    wrong = unit(gyro=np.rad2deg(1.0))
    assert 'main.gyro_unit = "deg/s"' in plausible.gyro_against_gravity(wrong, "main")
    assert 'main.gyro_unit = "deg/s"' in plausible.gyro_against_attitude(wrong, "main")
    assert 'main.gyro_unit = "deg/s"' in plausible.pair(wrong, unit(2))
    assert 'sub.gyro_unit = "deg/s"' in plausible.pair(unit(2), wrong)
    assert "smaller" in plausible.gyro_against_attitude(unit(gyro=np.deg2rad(1.0)), "main")


def test_axes_turned_against_the_attitude_are_seen():
    attitudes, rates, accel = synthetic.imu_data(1)
    turned = ImuSeries(synthetic.stamps(), rates[:, [1, 2, 0]], accel, attitudes.as_quat())
    assert "turned by 120 degrees" in plausible.gyro_against_attitude(turned, "phins_main")
    mirrored = ImuSeries(synthetic.stamps(), rates * [1, -1, 1], accel, attitudes.as_quat())
    assert "mirror" in plausible.gyro_against_attitude(mirrored, "phins_main")


def test_units_at_rest_are_not_judged_by_their_noise():
    rng = np.random.default_rng(5)
    stamp = synthetic.stamps()
    up = np.array([0.0, 0.0, synthetic.G])

    def still(arw):
        noise = arw * np.sqrt(synthetic.RATE) * rng.standard_normal((len(stamp), 3))
        return ImuSeries(stamp, noise, up + 1e-4 * rng.standard_normal((len(stamp), 3)))

    fine, coarse = still(np.deg2rad(0.001) / 60), still(np.deg2rad(3.0) / 60)
    assert plausible.pair(fine, coarse) is None
    assert plausible.gyro_against_gravity(coarse, "sub") is None


def test_a_vehicle_that_only_yaws_is_not_judged_about_the_other_axes():
    rng = np.random.default_rng(6)
    stamp = synthetic.stamps()
    yaw = np.outer(0.5 * np.sin(0.3 * np.arange(len(stamp)) / synthetic.RATE), [0, 0, 1])
    main = ImuSeries(stamp, yaw + 1e-3 * rng.standard_normal(yaw.shape), np.tile([0, 0, 9.8], (len(stamp), 1)))
    sub = ImuSeries(stamp, yaw + 1e-3 * rng.standard_normal(yaw.shape), np.tile([0, 0, 9.8], (len(stamp), 1)))
    assert plausible.pair(main, sub) is None
    assert plausible.gyro_against_gravity(main, "main") is None


@pytest.mark.parametrize(
    ("scale", "words"),
    [(1.0 / synthetic.G, '"g"'), (1e3 / synthetic.G, '"mg"'), (3.28, "main.accel_unit"), (0.01, "gravity_removed")],
)
def test_specific_force_in_another_unit(scale, words):
    assert words in plausible.specific_force(scale * unit().accel, "main")


def test_hard_driving_is_plausible():
    rng = np.random.default_rng(7)
    accel = unit().accel + 6.0 * rng.standard_normal((synthetic.COUNT, 3))
    assert plausible.specific_force(accel, "main") is None
