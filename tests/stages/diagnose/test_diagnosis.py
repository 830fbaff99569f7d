"""Diagnosis of simulated logs end to end: what is in them is named with its size, what is not is not.

A trial carries no truth; the diagnosis has nothing but the log and its twin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import pytest

from schemas.diagnosis import Diagnosis, Finding, Verdict
from schemas.errors import DataError
from schemas.trial import Trial
from stages.diagnose import diagnose
from stages.diagnose.diagnosis import _unstated
from stages.diagnose.judgement import judged, named_of
from tests.stages.diagnose import simulated
from tests.stages.diagnose.simulated import part, with_gap, without_aids
from twin import effects, parse_twin, with_run

TWIN = with_run(simulated.TWIN, duration=180.0)
log = partial(simulated.log, of=TWIN)

DELAY = ("time_delay", {"delay": 0.001})
SCALE = ("gyro_scale_factor", {"x": 400.0, "z": -600.0})
LEVER = ("lever_arm", {"x": 0.1, "z": -0.05})
MODE = ("second_mode", {"damping": 0.3, "frequency": 4.0, "std_arcmin": 0.4, "axis": "y"})
STEP = ("misalignment_step", {"x": 1.0, "z": 2.0, "time": 125.0})


@lru_cache
def told(case: str) -> Diagnosis:
    return diagnose(CASES[case](), TWIN, shrink=False, library=LIBRARY.get(case))


CASES = {
    "nothing": lambda: log(),
    "delay": lambda: log(DELAY),
    "delay and scale": lambda: with_gap(log(DELAY, ("gyro_scale_factor", {"y": 500.0})), 100.0, 130.0),
    "lever": lambda: log(LEVER),
    "mode": lambda: log(MODE),
    "gyros": lambda: without_aids(log(DELAY)),
    "not in the library": lambda: log(DELAY),
    "step": lambda: log(STEP),
}
FEW = ("time_delay", "gyro_scale_factor", "accel_bias", "lever_arm", "heel_bending")
LIBRARY = {"not in the library": [name for name in effects.names() if name != "time_delay"]}


def part_of(trial: Trial, length: float) -> Trial:
    """The first seconds of both IMUs."""
    main, sub = (part(unit, trial.seconds(unit.stamp) < length) for unit in (trial.main, trial.sub))
    return replace(trial, main=main, sub=sub)


def named(case: str) -> dict[str, Finding]:
    return {finding.name: finding for finding in told(case).effects}


def assert_sizes(finding: Finding, given: Mapping[str, Any], sigmas: float = 3.0) -> None:
    """Every number within so many standard deviations; axes that were not given are zero."""
    for name, estimate in finding.parameters.items():
        parts = {name: estimate} if not isinstance(estimate, Mapping) else estimate
        for key, item in parts.items():
            true = given.get(key, 0.0)
            if item.std is None:
                assert item.value == true
            else:
                assert abs(float(item.value) - true) < sigmas * item.std, (key, item)


def test_a_log_without_a_gap_has_none() -> None:
    found = told("nothing")
    assert found.verdict == Verdict.NO_GAP
    assert found.effects == found.where == ()
    assert found.gap.closed == 0.0
    assert 0.0 <= found.gap.after <= found.gap.before < 1e-3
    assert not any(row.named for row in found.tested)
    assert parse_twin(found.augmented_twin).effect == ()


def test_a_delay_is_named_with_its_size_and_closes_the_gap() -> None:
    found = told("delay")
    assert found.verdict == Verdict.EXPLAINED
    assert list(named("delay")) == ["time_delay"]
    assert_sizes(found.effects[0], {"delay": 0.001})
    assert found.gap.before > 0.01
    assert found.gap.closed > 0.95
    assert found.gap.closed_ci95[0] <= found.gap.closed <= found.gap.closed_ci95[1] <= 1.0
    assert found.where[0].channel == "sub.stamp"
    assert found.tested[0].name == "time_delay"


def test_two_effects_at_once_are_both_named_and_a_gap_of_half_a_minute_hides_neither() -> None:
    found = named("delay and scale")
    assert set(found) == {"time_delay", "gyro_scale_factor"}
    assert_sizes(found["time_delay"], {"delay": 0.001})
    assert_sizes(found["gyro_scale_factor"], {"y": 500.0})
    twin = parse_twin(told("delay and scale").augmented_twin)
    assert {effect.name for effect in twin.effect} == set(found)


def test_a_lever_arm_is_named_with_its_size() -> None:
    found = named("lever")
    assert list(found) == ["lever_arm"]
    assert_sizes(found["lever_arm"], LEVER[1])
    assert found["lever_arm"].places[0].channel == "sub.accel"


def test_a_second_mode_is_named_first_with_its_parameters() -> None:
    found = told("mode").effects[0]
    assert found.name == "second_mode"
    assert_sizes(found, MODE[1])


def test_the_runner_up_and_a_placebo_close_less() -> None:
    found = told("delay")
    roles = {item.role: item.gap.closed for item in found.comparisons}
    assert set(roles) == {"runner-up", "placebo"}
    assert roles["runner-up"] < 0.8 * found.gap.closed
    assert roles["placebo"] < 0.1


def test_pictures_show_the_residual_before_and_after() -> None:
    found = told("delay")
    before, after = (
        np.nansum([np.nansum(getattr(trace, when)[trace.good] ** 2) for trace in found.traces])
        for when in ("before", "after")
    )
    assert after < 0.9 * before
    for trace in found.traces:
        assert len(trace.t) == len(trace.before) == len(trace.after) == len(trace.regressor) == len(trace.good)
        assert 0.9 < np.std(trace.after[trace.good]) < 1.1
    place = found.localisation
    assert place.score.shape == (len(place.channels), len(place.bands_hz), len(place.edges_s) - 1)
    assert (place.score >= 0.0).all()
    assert place.score.sum() > 5.0 * told("nothing").localisation.score.sum()


def test_two_units_alone_are_enough_for_a_delay_and_what_is_untestable_is_said() -> None:
    found = told("gyros")
    assert list(named("gyros")) == ["time_delay"]
    assert_sizes(found.effects[0], {"delay": 0.001}, sigmas=4.0)
    assert {"phins_latency", "phins_attitude_error", "gyro_temperature"} <= set(found.untestable)


@pytest.mark.slow
def test_what_is_not_in_the_library_is_not_taken_for_something_else() -> None:
    found = told("not in the library")
    alike = {item.name for item in effects.look_alikes("time_delay", ["sub.accel", "phins_sub.attitude"])}
    assert found.verdict == Verdict.UNKNOWN_EFFECT or set(named("not in the library")) <= alike
    assert found.verdict != Verdict.NO_GAP
    assert "time_delay" not in {row.name for row in found.tested}
    assert found.where
    assert found.advice


@pytest.mark.slow
def test_a_step_of_the_mounting_is_seen() -> None:
    found = told("step")
    assert found.verdict != Verdict.NO_GAP
    rows = {row.name: row for row in found.tested}
    assert (rows["misalignment_step"].evidence_nats or 0.0) > 100.0
    assert not set(named("step")) - {"misalignment_step"}


def short(trial: Trial) -> Trial:
    t = trial.seconds(trial.main.stamp)
    return replace(trial, main=part(trial.main, t < 40.0), sub=part(trial.sub, trial.seconds(trial.sub.stamp) < 40.0))


def test_a_short_log_is_refused_in_a_sentence() -> None:
    with pytest.raises(DataError, match="a diagnosis needs 60 s"):
        diagnose(short(log()), TWIN, shrink=False)


def test_a_ship_that_lies_still_is_refused_in_a_sentence() -> None:
    trial = part_of(log(), 60.0)  # 6000 samples, which span 59.99 s and are enough
    noise = 1e-6 * np.random.default_rng(0).standard_normal(trial.main.gyro.shape)
    with pytest.raises(DataError, match="lies still"):
        diagnose(replace(trial, main=replace(trial.main, gyro=noise)), TWIN, shrink=False)


def test_gyros_alone_are_diagnosed_and_what_needs_forces_is_said_to_be_untestable() -> None:
    trial = without_aids(part_of(log(SCALE), 80.0))
    main, sub = (replace(series, accel=np.zeros_like(series.accel)) for series in (trial.main, trial.sub))
    found = diagnose(replace(trial, main=main, sub=sub), TWIN, shrink=False, library=FEW)
    assert {"accel_bias", "lever_arm", "heel_bending"} <= set(found.untestable)
    assert np.isfinite([row.evidence_nats for row in found.tested]).all()
    assert {finding.name for finding in found.effects} <= {"gyro_scale_factor"}


def test_sections_that_a_twin_leaves_out_are_told() -> None:
    assert "[mount], [imu]" in _unstated(parse_twin("[flexure]\n"))[0]
    assert not _unstated(parse_twin("[flexure]\n[mount]\n[imu]\n"))


def test_a_rate_that_is_not_the_twins_is_refused_in_a_sentence() -> None:
    slow = TWIN.model_copy(update={"run": TWIN.run.model_copy(update={"rate": 50.0})})
    with pytest.raises(DataError, match="runs at 50 Hz, the main IMU of the log at 100 Hz"):
        diagnose(log(), slow, shrink=False)


def test_what_stamps_and_values_show_stays_named_where_the_rest_may_not_be() -> None:
    clipped, bent = (Finding(name, 50.0, {}) for name in ("gyro_saturation", "thermal_bending"))
    doubted = judged(100.0, 60.0, 9.0, True)
    assert named_of(doubted, (clipped, bent), (clipped,)) == (Verdict.PARTLY_EXPLAINED, (clipped,))
    assert named_of(doubted, (bent,), ()) == (Verdict.UNKNOWN_EFFECT, ())
    assert named_of(judged(100.0, 0.0, 0.0, True), (clipped, bent), (clipped,)) == (Verdict.EXPLAINED, (clipped, bent))


@pytest.mark.parametrize(
    ("evidence", "left", "agree", "found", "verdict", "names"),
    [
        (0.0, 0.0, 0.0, False, Verdict.NO_GAP, False),
        (0.0, 300.0, 0.0, False, Verdict.UNKNOWN_EFFECT, False),
        (500.0, 3.0, 100.0, True, Verdict.EXPLAINED, True),
        (5000.0, 60.0, 1.0, True, Verdict.PARTLY_EXPLAINED, True),
        (5000.0, 60.0, 9.0, True, Verdict.UNKNOWN_EFFECT, False),
        (500.0, 500.0, 1.0, True, Verdict.UNKNOWN_EFFECT, False),
    ],
)
def test_the_verdict_follows_from_what_is_found_what_is_left_and_whether_halves_agree(
    evidence: float, left: float, agree: float, found: bool, verdict: Verdict, names: bool
) -> None:
    said = judged(evidence, left, agree, found)
    assert (said.verdict, said.named) == (verdict, names)
    assert bool(said.reason) == (found and not names)
