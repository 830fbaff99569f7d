"""Attitude of the deck: from a PHINS where there is one, from the main gyro where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.products import Estimate, Status
from schemas.trial import ImuSeries
from stages.publish.attitude import ENU, START, deck_attitude, running_product
from tests.stages import synthetic_result as synthetic


def test_running_product_equals_the_obvious_loop():
    steps = Rotation.from_rotvec(0.3 * np.random.default_rng(1).standard_normal((23, 3)))
    expected = [steps[0]]
    for k in range(1, len(steps)):
        expected.append(expected[-1] * steps[k])
    error = (Rotation.from_quat(running_product(steps.as_quat())) * Rotation.concatenate(expected).inv()).magnitude()
    assert error.max() < 1e-14


def test_without_attitude_of_m_it_is_carried_by_the_gyro_from_the_first_stamp():
    case = synthetic.case(duration=60.0, gap=None, with_phins=False, with_deck=False, error_std=1e-12)
    found = deck_attitude(case.result.deformation, case.trial)
    truth = Rotation.from_quat(case.truth.attitude)
    R_n_m0 = truth[0] * Rotation.from_rotvec(case.truth.total[0]).inv()
    error = (Rotation.from_quat(found.quaternion) * (R_n_m0.inv() * truth).inv()).magnitude()
    assert found.frame == START
    assert error.max() < 1e-9


def test_gap_of_the_main_imu_is_bridged_without_a_jump_of_frame():
    case = synthetic.case(duration=60.0, gap=(30.0, 30.4), with_phins=False, with_deck=False, error_std=1e-12)
    found = deck_attitude(case.result.deformation, case.trial)
    at = np.searchsorted(case.truth.attitude_stamp, found.stamp)
    truth = Rotation.from_quat(case.truth.attitude[at])
    R_n_m0 = truth[0] * Rotation.from_rotvec(case.truth.total[0]).inv()
    error = (Rotation.from_quat(found.quaternion) * (R_n_m0.inv() * truth).inv()).magnitude()
    assert error.max() < 2e-3


def test_stamps_in_a_gap_of_the_phins_are_left_out():
    case = synthetic.case(duration=60.0, gap=None, with_deck=False)
    phins = case.trial.phins_main
    t = (phins.stamp - synthetic.EPOCH) * 1e-9
    kept = (t < 20) | (t > 30)
    holed = ImuSeries(phins.stamp[kept], phins.gyro[kept], phins.accel[kept], phins.attitude[kept])
    found = deck_attitude(case.result.deformation, replace(case.trial, phins_main=holed))
    assert found.frame == ENU
    np.testing.assert_array_equal(found.stamp, case.result.deformation.stamp[kept])


def test_phins_of_unknown_installation_is_not_taken_for_the_attitude_of_m():
    case = synthetic.case(duration=20.0, gap=None, with_deck=False)
    unknown = Estimate(np.zeros(3), np.full(3, np.inf), Status.NOT_OBSERVABLE, "calm sea")
    alignment = replace(case.result.deformation.alignment, installation_main=unknown)
    assert deck_attitude(replace(case.result.deformation, alignment=alignment), case.trial).frame == START


def test_attitude_of_the_main_unit_itself_comes_first():
    case = synthetic.case(duration=20.0, gap=None, with_deck=False, error_std=1e-12)
    R_n_m = Rotation.from_quat(case.truth.attitude) * Rotation.from_rotvec(case.truth.total).inv()
    main = replace(case.trial.main, attitude=R_n_m.as_quat())
    found = deck_attitude(case.result.deformation, replace(case.trial, main=main))
    error = (Rotation.from_quat(found.quaternion) * Rotation.from_quat(case.truth.attitude).inv()).magnitude()
    assert found.frame == ENU
    assert error.max() < 1e-10
