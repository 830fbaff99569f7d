"""Body and navigation conventions against drawings worked out by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.decode.attitude import from_angles
from stages.decode.axes import R_ENU_NAV, hull_from_log
from stages.decode.profile import Attitude

STARBOARD, BOW, UP = np.eye(3)


@pytest.mark.parametrize(
    ("code", "x", "y", "z"),
    [
        ("RFU", STARBOARD, BOW, UP),
        ("FLU", BOW, -STARBOARD, UP),
        ("FRD", BOW, STARBOARD, -UP),
        ("BLD", -BOW, -STARBOARD, -UP),
    ],
)
def test_letters_say_where_the_axes_of_the_log_point(code, x, y, z):
    R_hull_log = hull_from_log(code)
    np.testing.assert_array_equal(R_hull_log @ np.eye(3), np.column_stack([x, y, z]))


def test_signed_axes_and_matrix_say_the_same_as_letters():
    np.testing.assert_array_equal(hull_from_log(["-y", "x", "z"]), hull_from_log("FLU"))
    np.testing.assert_array_equal(hull_from_log(["y", "x", "-z"]), hull_from_log("FRD"))
    matrix = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
    np.testing.assert_allclose(hull_from_log(matrix.round(4).tolist()), matrix, atol=1e-4)
    exact = hull_from_log(matrix.round(4).tolist())
    np.testing.assert_allclose(exact @ exact.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("axes", ["RF", "RLU", "RBU", ["x", "y"], ["x", "y", "a"], [[1, 0, 0], [0, 1, 0]]])
def test_what_is_no_right_handed_frame_is_refused(axes):
    with pytest.raises(ValueError, match=r"axes|letters|is not"):
        hull_from_log(axes)


def test_navigation_frames():
    north_in_ned, down_in_ned = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    np.testing.assert_array_equal(R_ENU_NAV["NED"] @ north_in_ned, [0, 1, 0])
    np.testing.assert_array_equal(R_ENU_NAV["NED"] @ down_in_ned, [0, 0, -1])
    west_in_nwu = np.array([0, 1.0, 0])
    np.testing.assert_array_equal(R_ENU_NAV["NWU"] @ west_in_nwu, [-1, 0, 0])


@pytest.mark.parametrize(
    ("angles", "convention", "body", "expected"),
    [
        # compass heading 90 degrees: the bow points east
        ((90.0, 0.0, 0.0), Attitude(form="euler", unit="deg"), BOW, [1, 0, 0]),
        ((90.0, 0.0, 0.0), Attitude(form="euler", unit="deg", heading_positive="counter-clockwise"), BOW, [-1, 0, 0]),
        # bow up by 90 degrees: the bow points up; a driver that counts bow down means the opposite
        ((0.0, 90.0, 0.0), Attitude(form="euler", unit="deg"), BOW, [0, 0, 1]),
        ((0.0, 90.0, 0.0), Attitude(form="euler", unit="deg", pitch_positive="bow down"), BOW, [0, 0, -1]),
        # starboard down by 90 degrees: starboard points down
        ((0.0, 0.0, 90.0), Attitude(form="euler", unit="deg"), STARBOARD, [0, 0, -1]),
        ((0.0, 0.0, 90.0), Attitude(form="euler", unit="deg", roll_positive="port down"), STARBOARD, [0, 0, 1]),
        ((np.pi / 2, 0.0, 0.0), Attitude(form="euler"), BOW, [1, 0, 0]),
    ],
)
def test_angles_of_a_driver(angles, convention, body, expected):
    heading, pitch, roll = (np.array([angle]) for angle in angles)
    quaternion = from_angles(heading, pitch, roll, convention)
    np.testing.assert_allclose(Rotation.from_quat(quaternion).apply(body)[0], expected, atol=1e-12)
