"""Reports held against the truth, case by case."""

import pytest

from pipeline.blind.matching import Case, look_alike_names, relative_error
from pipeline.blind.places import is_right


def truth(kind="single", *effects, severity=10.0):
    return {"name": "001", "kind": kind, "severity": severity, "effects": list(effects)}


def effect(name, parameters, effective=None):
    return {"name": name, "parameters": parameters, "effective": effective or parameters}


def report(verdict, *named, where=(), **more):
    return {"verdict": verdict, "effects": list(named), "where": list(where), **more}


def finding(name, parameters=None, alike=(), nats=100.0):
    return {"name": name, "parameters": parameters or {}, "ambiguous_with": list(alike), "evidence_nats": nats}


DELAY = effect("time_delay", {"delay": 0.004})


def test_a_right_name():
    case = Case(truth("single", DELAY), report("explained", finding("time_delay"), finding("outliers")))
    assert case.right_first
    assert case.right_group
    assert case.detected
    assert case.spurious == ["outliers"]


def test_a_stated_look_alike_counts_for_the_group_only():
    case = Case(truth("single", DELAY), report("explained", finding("clock_drift", alike=["time_delay"])))
    assert not case.right_first
    assert case.right_group
    assert case.candidates == {"clock_drift", "time_delay"}


def test_a_failure_is_a_miss():
    case = Case(truth("single", DELAY), {"failure": "boom"})
    assert case.failed
    assert not any((case.detected, case.right_first, case.right_group, case.not_explained))
    assert case.first == "failure"
    assert case.parameters() == []


def test_silence_on_a_null_is_no_alarm():
    assert not Case(truth("null", severity=0.0), report("no_gap")).detected
    assert Case(truth("null", severity=0.0), report("unknown_effect")).detected


def test_an_effect_that_the_library_was_denied_is_a_case_of_its_own():
    case = Case(truth("single", DELAY), report("unknown_effect", without=["time_delay"]))
    assert case.kind == "removed"
    assert case.not_explained
    assert Case(truth("single", DELAY), report("no_gap", without=["outliers"])).kind == "single"


@pytest.mark.parametrize(
    ("verdict", "name", "wrong"),
    [
        ("explained", "lever_arm", True),
        ("partly_explained", "lever_arm", False),
        ("explained", "time_delay", False),
        ("unknown_effect", None, False),
    ],
)
def test_confident_and_outside_the_group(verdict, name, wrong):
    foreign = effect("sinusoidal_clock", {"amplitude": 1e-3, "period": 100.0})
    named = [finding(name)] if name else []
    assert Case(truth("foreign", foreign), report(verdict, *named)).confidently_wrong is wrong


def test_look_alikes_come_from_the_library():
    assert "phins_latency" not in look_alike_names("time_delay") or "clock_drift" in look_alike_names("time_delay")
    assert "gyro_bias" in look_alike_names("gyro_g_sensitivity")


def test_errors_of_parameters_are_against_what_reality_departs_by():
    bias = effect("gyro_bias", {"x": 2.0, "y": 0.0, "z": 0.0}, {"x": 2.01, "y": 0.02, "z": 0.0})
    found = {axis: {"value": value, "std": 0.05} for axis, value in zip("xyz", (2.11, 0.02, -0.1))}
    numbers = Case(truth("single", bias), report("explained", finding("gyro_bias", found))).parameters()
    assert [p.z for p in numbers] == pytest.approx([2.0, 0.0, -2.0])


def test_parameters_per_axis_and_words():
    second = effect("second_mode", {"damping": 0.1, "frequency": 4.0, "std_arcmin": 2.0, "axis": "y"})
    values = {
        "damping": {"value": 0.1, "std": 0.01}, "frequency": {"value": 4.2, "std": 0.1},
        "std_arcmin": {"value": 2.2, "std": 0.1}, "axis": {"value": "y", "std": None},
    }  # fmt: skip
    case = Case(truth("single", second), report("explained", finding("second_mode", values)))
    assert len(case.parameters()) == 3
    assert relative_error(case) == pytest.approx(0.1)  # of the size alone
    warm = effect("gyro_temperature", {"slope": [0.0, 0.5, 0.0]})
    slopes = {"slope": {axis: {"value": v, "std": 0.1} for axis, v in zip("xyz", (0.0, 0.4, 0.0))}}
    case = Case(truth("single", warm), report("explained", finding("gyro_temperature", slopes)))
    assert relative_error(case) == pytest.approx(0.2)


def test_only_the_axes_that_changed_count_for_flexure():
    deck = effect(
        "flexure_parameters",
        {"damping": [0.4, None, None]},
        {"damping": [0.4, 0.11, 0.12]},
    )
    values = {"damping": {axis: {"value": 0.44, "std": 0.1} for axis in "xyz"}}
    case = Case(truth("single", deck), report("explained", finding("flexure_parameters", values)))
    assert [p.key for p in case.parameters()] == ["damping.x"]
    assert relative_error(case) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("effect_", "channel", "axis", "right"),
    [
        (effect("gyro_bias", {"x": 1.0, "y": 0.0, "z": 0.0}), "sub.gyro", "x", True),
        (effect("gyro_bias", {"x": 1.0, "y": 0.0, "z": 0.0}), "sub.gyro", "y", False),
        (effect("gyro_bias", {"x": 1.0, "y": 0.0, "z": 0.0}), "sub.accel", "x", False),
        (effect("gyro_nonorthogonality", {"xy": 0.0, "zx": 5.0}), "sub.gyro", "z", True),
        (effect("heel_bending", {"x": 4.0, "y": 0.0, "z": 0.0}), "sub.accel", "y", True),
        (effect("heel_bending", {"x": 4.0, "y": 0.0, "z": 0.0}), "sub.accel", "x", False),
        (effect("thermal_bending", {"amplitude": [0.0, 5.0, 0.0], "period": 9.0}), "phins_sub.attitude", "y", True),
        (effect("thermal_bending", {"amplitude": [0.0, 5.0, 0.0], "period": 9.0}), "sub.gyro", "x", False),
        (effect("second_mode", {"std_arcmin": 1.0, "axis": "z"}), "sub.gyro", "z", True),
        (effect("slamming", {"rate": 1.0}), "sub.gyro", "x", True),
        (effect("sample_dropout", {"rate": 1.0}), "sub.stamp", "", True),
        (effect("phins_latency", {"delay": 1.0}), "phins_main.attitude", "y", True),
        (effect("phins_latency", {"delay": 1.0}), "sub.gyro", "y", False),
    ],
)
def test_where_an_effect_may_be_found(effect_, channel, axis, right):
    assert is_right(effect_, channel, axis) is right
