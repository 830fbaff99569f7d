"""The channels written back, field by field as in the log contract."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics.units import ARCMIN
from schemas.products import Estimate
from schemas.wire import read_log, write_log
from stages.publish.tables import flat_covariance, result_tables
from tests.stages import synthetic_result as synthetic


@pytest.fixture(scope="module")
def case():
    return synthetic.case(duration=60.0, gap=(20.0, 25.0))


@pytest.fixture(scope="module")
def tables(case):
    return {table.topic: table for table in result_tables(case.result, case.trial)}


def test_topics_and_types_are_those_of_the_contract(tables):
    assert {topic: table.schema for topic, table in tables.items()} == {
        "/deckflex/deformation": "deckflex_msgs/msg/Deformation",
        "/deckflex/attitude": "geometry_msgs/msg/QuaternionStamped",
        "/deckflex/alignment": "deckflex_msgs/msg/Alignment",
        "/deckflex/flexure_model": "deckflex_msgs/msg/FlexureModel",
        "/deckflex/deck_shape": "deckflex_msgs/msg/DeckShape",
        "/deckflex/score": "deckflex_msgs/msg/Score",
    }


def test_every_channel_survives_the_wire(tables, tmp_path):
    path = tmp_path / "out.mcap"
    write_log(path, list(tables.values()))
    back = read_log(path).tables
    for topic, table in tables.items():
        assert set(back[topic].columns) == set(table.columns), topic
        for name, column in table.columns.items():
            np.testing.assert_array_equal(back[topic].columns[name], column, err_msg=f"{topic} {name}")


def test_deformation_has_a_row_per_sample_used(case, tables):
    table, d = tables["/deckflex/deformation"], case.result.deformation
    np.testing.assert_array_equal(table.columns["header.stamp"], d.stamp)
    np.testing.assert_array_equal(table.log_time, d.stamp)
    np.testing.assert_array_equal(table.vector("total"), d.total)
    np.testing.assert_array_equal(table.vector("dynamic_part"), d.dynamic_part)
    np.testing.assert_array_equal(table.columns["covariance"], d.covariance.reshape(-1, 9))
    assert set(table.columns["header.frame_id"]) == {"imu_main"}


def test_unknown_covariance_is_told_by_minus_one():
    covariance = np.stack([np.eye(3), np.full((3, 3), np.nan)])
    flat = flat_covariance(covariance)
    np.testing.assert_array_equal(flat[0], np.eye(3).ravel())
    np.testing.assert_array_equal(flat[1], [-1, 0, 0, 0, 0, 0, 0, 0, 0])
    assert np.isnan(covariance[1]).all()


def test_attitude_is_the_truth_within_the_phins_noise(case, tables):
    table = tables["/deckflex/attitude"]
    at = np.searchsorted(case.truth.attitude_stamp, table.columns["header.stamp"])
    truth = Rotation.from_quat(case.truth.attitude[at])
    error = (Rotation.from_quat(table.quaternion("quaternion")) * truth.inv()).magnitude()
    assert error.max() < 2.5 * ARCMIN
    assert set(table.columns["header.frame_id"]) == {"enu"}


def test_alignment_tells_the_refined_delay_and_the_static_angle(tables):
    table = tables["/deckflex/alignment"]
    assert len(table) == 1
    np.testing.assert_allclose(table.vector("static_angle")[0], synthetic.PHI)
    assert table.columns["time_delay"][0] == 0.002
    assert table.columns["time_delay_std"][0] == 3e-5


def test_static_angle_of_the_estimator_comes_with_its_own_covariance(case):
    own = Estimate(np.array([1.0, 2.0, 3.0]) * ARCMIN, np.array([0.1, 0.2, 0.3]) * ARCMIN)
    d = case.result.deformation
    refined = replace(d, parameters={**d.parameters, "static_angle": own})
    tables = {t.topic: t for t in result_tables(replace(case.result, deformation=refined), case.trial)}
    table = tables["/deckflex/alignment"]
    np.testing.assert_array_equal(table.vector("static_angle")[0], own.value)
    np.testing.assert_allclose(table.columns["covariance"][0].reshape(3, 3), np.diag(own.std**2))


def test_flexure_model_is_zero_frequency_for_a_critically_damped_axis(case):
    critical = replace(case.result.deformation.flexure, stiffness=synthetic.DAMPING**2)
    d = replace(case.result.deformation, flexure=critical)
    table = next(t for t in result_tables(replace(case.result, deformation=d), case.trial) if "flexure" in t.topic)
    np.testing.assert_array_equal(table.vector("frequency")[0], 0.0)
    np.testing.assert_array_equal(table.vector("damping")[0], synthetic.DAMPING)
    assert list(table.columns["method"]) == ["synthetic"]


def test_deck_shape_puts_each_axis_under_its_name(case, tables):
    table, run = tables["/deckflex/deck_shape"], case.result.deck_shape.passes[1]
    rows = table.columns["pass_index"] == 1
    np.testing.assert_array_equal(table.columns["vertical_curvature"][rows], run.curvature[:, 0])
    np.testing.assert_array_equal(table.columns["torsion"][rows], run.curvature[:, 1])
    np.testing.assert_array_equal(table.columns["horizontal_curvature"][rows], run.curvature[:, 2])
    np.testing.assert_array_equal(table.columns["std"][rows], run.std[:, [0, 2, 1]])
    np.testing.assert_array_equal(table.columns["exceeds_limit"][rows], run.exceeds.any(axis=1))
    assert np.all(np.diff(table.columns["header.stamp"]) >= 0)


def test_score_has_a_row_per_reference(case, tables):
    table = tables["/deckflex/score"]
    assert list(table.columns["reference"]) == ["truth", "phins"]
    np.testing.assert_array_equal(table.vector("rmse")[0], case.result.scores[0].rmse)


def test_no_deck_and_no_score_give_no_such_channel(case):
    bare = replace(case.result, deck_shape=None, scores=())
    topics = {t.topic for t in result_tables(bare, case.trial)}
    assert topics == {f"/deckflex/{n}" for n in ("deformation", "attitude", "alignment", "flexure_model")}
