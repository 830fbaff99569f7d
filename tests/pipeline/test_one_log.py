from dataclasses import replace

import numpy as np
import pytest

from pipeline.one_log import Steps, _contradictions, _warnings
from schemas.products import Estimate, Score, Status
from tests.stages.synthetic_result import case

STAMP = np.zeros(0, np.int64)


def score(rmse, predicted, noise) -> Score:
    nothing = np.zeros((0, 3))
    errors = {"rmse": np.array(rmse), "predicted": np.array(predicted), "reference_noise": np.array(noise)}
    return Score(
        "smoother", "truth", duration=1.0, samples=0, stamp=STAMP, error=nothing, coverage=np.ones(3), **errors
    )


def test_an_error_far_beyond_the_covariance_is_told_with_axis_and_reference():
    told = _contradictions(score([1.0, 4.0, 4.0], [1.0, 1.0, 1.0], [0.0, 0.0, 3.0]))
    assert len(told) == 1
    assert told[0].startswith("roll y: the error against truth is 4.0 times")


def test_a_covariance_of_nothing_contradicts_nothing():
    assert not _contradictions(score([1.0, 1.0, 1.0], [0.0, np.nan, 0.0], [0.0, 0.0, 0.0]))


def test_every_weak_value_is_a_warning_with_its_reason():
    made = case(duration=20.0)
    deformation = made.result.deformation
    weak = Estimate(np.array(0.0), np.array(1.0), Status.NOT_OBSERVABLE, "the ship lay still")
    flexure = replace(deformation.flexure, status=(Status.WEAK,) * 3, reason=("too short",) * 3)
    doubtful = replace(
        deformation, alignment=replace(deformation.alignment, time_delay=weak), flexure=flexure, parameters={}
    )
    told = _warnings(made.trial, doubtful, ())
    assert "time delay not observable: the ship lay still" in told
    assert "flexure, pitch x, roll y, heading z: weak: too short" in told


def test_steps_are_timed_told_and_add_up():
    heard = []
    steps = Steps(lambda *what: heard.append(what))
    with steps.step("decode") as report:
        report(1, 2)
    with steps.step("decode"):
        pass
    assert heard == [("decode", 0, 0), ("decode", 1, 2), ("decode", 0, 0)]
    assert list(steps.seconds) == ["decode"]
    assert steps.seconds["decode"] >= 0.0


def test_a_step_that_fails_is_not_counted_as_done():
    steps = Steps()
    with pytest.raises(RuntimeError), steps.step("decode"):
        raise RuntimeError
    assert not steps.seconds
