"""The figures of a run, as printed and as written."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from physics.units import ARCMIN
from stages.publish.document import accuracy_text, duration, number, summary_text
from stages.publish.summary import intervals, plain, summary
from tests.stages import synthetic_result as synthetic


@pytest.fixture(scope="module")
def case():
    return synthetic.case(duration=60.0)


def test_keys_are_those_of_the_contract(case):
    found = summary(case.result, log="a.mcap", wall_s=1.5)
    assert list(found)[:12] == [
        "log", "estimator", "identifier", "duration_s", "samples", "static_arcmin", "time_delay_s", "flexure",
        "rmse_arcmin", "deck_shape", "warnings", "wall_s",
    ]  # fmt: skip
    assert set(found["flexure"]) == {"damping", "frequency", "std_arcmin"}
    assert found["log"] == "a.mcap"
    assert found["wall_s"] == 1.5


def test_figures_are_in_the_stated_units(case):
    found = summary(case.result)
    np.testing.assert_allclose(found["static_arcmin"], [10.0, -8.0, 30.0])
    np.testing.assert_allclose(found["flexure"]["std_arcmin"], [3.0, 2.2, 4.0])
    np.testing.assert_allclose(found["rmse_arcmin"]["truth"], case.result.scores[0].rmse / ARCMIN)
    assert found["time_delay_s"] == 0.002
    assert found["samples"] == len(case.result.deformation.stamp)


def test_absent_reference_and_deck_are_null(case):
    found = summary(replace(case.result, scores=(), deck_shape=None))
    assert found["rmse_arcmin"] == {"truth": None, "phins": None}
    assert found["deck_shape"] is None


def test_it_is_strict_json_even_with_unknown_figures(case):
    d = case.result.deformation
    unknown = replace(d, covariance=np.full_like(d.covariance, np.nan))
    text = json.dumps(summary(replace(case.result, deformation=unknown)), allow_nan=False)
    assert json.loads(text)["details"]["predicted_std_arcmin"] == [None, None, None]


def test_deck_shape_says_where_the_limit_is_exceeded(case):
    deck = summary(case.result)["deck_shape"]
    shape = case.result.deck_shape
    beyond = shape.arc_length[shape.exceeds[:, 0]]
    assert deck["vertical"]["exceeds_limit_at_m"] == [[beyond[0], beyond[-1]]]
    assert deck["horizontal"]["exceeds_limit_at_m"] == []
    assert deck["passes"] == 3


def test_intervals_of_a_flag():
    flag = np.array([True, False, True, True, False, True])
    assert intervals(np.arange(6.0), flag) == [[0.0, 0.0], [2.0, 3.0], [5.0, 5.0]]
    assert intervals(np.arange(3.0), np.zeros(3, bool)) == []


def test_plain_leaves_only_what_json_knows():
    found = plain({"a": np.float64(1.5), "b": (np.int64(2), np.nan), "c": np.array([1.0, np.inf])})
    assert found == {"a": 1.5, "b": [2, None], "c": [1.0, None]}
    assert type(found["a"]) is float


def test_document_holds_the_warning_the_figures_and_no_strange_character(case):
    text = summary_text(case.result, "trial.mcap")
    assert "trial.mcap" in text
    assert "a warning to be read" in text
    assert "| static angle [′] | 10 | -8 | 30 |" in text
    assert max(map(ord, text)) < 0x2E80  # the viewer dies of a glyph it does not have
    assert "1σ" in accuracy_text(case.result)


@pytest.mark.parametrize(("value", "text"), [(None, "–"), (0.12345, "0.123"), (1234.5, "1230"), (0.0, "0")])
def test_numbers_have_three_digits(value, text):
    assert number(value) == text


@pytest.mark.parametrize(("seconds", "text"), [(400.0, "400 s"), (1200.0, "20.0 min"), (7200.0, "2.00 h")])
def test_durations_read_well(seconds, text):
    assert duration(seconds) == text
