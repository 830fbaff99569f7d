"""Attitudes in a driver's convention come out as the one attitude of the hull in ENU."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas.trial import ImuSeries
from stages.decode import default_rig
from stages.decode.attitude import attitude, with_gravity
from stages.decode.profile import Attitude
from tests.stages.decode import synthetic
from tests.stages.decode.synthetic import changed, parts

NAV_FROM_ENU = {
    "ENU": np.eye(3),
    "NED": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    "NWU": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}
LOG_FROM_HULL = {"RFU": np.eye(3), "FLU": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], "FRD": [[0, 1, 0], [1, 0, 0], [0, 0, -1]]}


def unit_with(quaternion):
    table = synthetic.unit("/phins/main", 3, with_attitude=True)
    return changed(table, **{f"orientation__{k}": lambda q, v=v: v for k, v in zip("xyzw", quaternion.T)})


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("frame", NAV_FROM_ENU)
@pytest.mark.parametrize("axes", LOG_FROM_HULL)
def test_any_frame_and_axes_give_the_attitude_of_the_hull(frame, axes, inverse):
    truth = synthetic.motion(np.arange(1, synthetic.COUNT + 1) / synthetic.RATE)
    hull_from_log = Rotation.from_matrix(LOG_FROM_HULL[axes]).inv()
    published = Rotation.from_matrix(NAV_FROM_ENU[frame]) * truth * hull_from_log
    published = published.inv() if inverse else published
    channel = default_rig().phins_main.model_copy(
        update={"axes": axes, "attitude": Attitude(frame=frame, inverse=inverse)}
    )
    quaternion, given = attitude(unit_with(1.01 * published.as_quat()), channel)
    assert given.all()
    assert (Rotation.from_quat(quaternion).inv() * truth).magnitude().max() < 1e-12
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1.0, atol=1e-14)


def test_angles_in_degrees_with_pitch_positive_bow_down():
    truth = synthetic.motion(np.arange(1, synthetic.COUNT + 1) / synthetic.RATE)
    heading, pitch, roll = truth.as_euler("ZXY", degrees=True).T
    table = synthetic.unit("/phins/main", 3)
    columns = {"h": -heading, "p": -pitch, "r": roll}
    table = type(table)(**{**vars(table), "columns": table.columns | columns})
    channel = default_rig().phins_main.model_copy(
        update={
            "fields": {"heading": "h", "pitch": "p", "roll": "r"},
            "attitude": Attitude(form="euler", unit="deg", pitch_positive="bow down"),
        }
    )
    quaternion, _ = attitude(table, channel)
    assert (Rotation.from_quat(quaternion).inv() * truth).magnitude().max() < 1e-12


def test_restored_gravity_is_the_specific_force_of_the_interval():
    attitudes, gyro, accel = synthetic.imu_data(9)
    middle = synthetic.motion((np.arange(1, synthetic.COUNT + 1) - 0.5) / synthetic.RATE)
    compensated = accel - middle.inv().apply([0.0, 0.0, synthetic.G])
    unit = ImuSeries(synthetic.stamps(), gyro, compensated, attitudes.as_quat())
    restored = with_gravity(unit, unit, np.eye(3), synthetic.G)
    # the first interval starts before the first attitude
    assert len(restored) == synthetic.COUNT - 1
    assert np.abs(restored.accel - accel[1:]).max() < 1e-4


def test_mounting_of_the_phins_beside_the_unit_is_taken_into_account():
    attitudes, gyro, accel = synthetic.imu_data(9)
    middle = synthetic.motion((np.arange(1, synthetic.COUNT + 1) - 0.5) / synthetic.RATE)
    R_imu_phins = Rotation.from_rotvec([0.3, -0.1, 0.2])
    phins = ImuSeries(synthetic.stamps(), gyro, accel, (attitudes * R_imu_phins).as_quat())
    unit = ImuSeries(synthetic.stamps(), gyro, accel - middle.inv().apply([0.0, 0.0, synthetic.G]))
    restored = with_gravity(unit, phins, R_imu_phins.as_matrix(), synthetic.G)
    assert np.abs(restored.accel - accel[1:]).max() < 1e-4


def test_unavailable_attitude_is_none():
    channel = default_rig().main
    assert attitude(synthetic.unit("/imu/main", 1), channel) is None
    zero = synthetic.unit("/imu/main", 1, with_attitude=True)
    zero = changed(zero, **{f"orientation__{k}": np.zeros_like for k in "xyzw"})
    assert attitude(zero, channel) is None
    assert parts("orientation", np.eye(4)).keys() <= zero.columns.keys()
