"""Evidence over many logs, against sums done by hand and by least squares."""

import numpy as np
import pytest
from scipy.stats import chi2

from stages.archive.repetition import Observation, Standing, combined, repetition


def named(log, nats, **parameters):
    return Observation(log, nats, 6.0, True, parameters)


def quiet(log, nats):
    return Observation(log, nats, 6.0, False, {})


def test_parameters_are_combined_as_least_squares_would():
    values = [(4.1, 0.2), (3.8, 0.1), (4.4, 0.4)]
    y, s = np.array(values).T
    found = combined(values)
    solution, residue, *_ = np.linalg.lstsq((1 / s)[:, None], y / s, rcond=None)
    assert found.value == pytest.approx(solution[0])
    assert found.chi2 == pytest.approx(residue[0])
    assert found.p_value == pytest.approx(chi2.sf(residue[0], 2))
    assert found.std == pytest.approx(np.sqrt(1 / np.sum(s**-2) * max(1.0, residue[0] / 2)))


def test_evidence_of_logs_that_agree_adds_up():
    logs = [named("a", 10.0, delay=(4.0, 0.1)), named("b", 20.0, delay=(4.1, 0.1)), quiet("c", -1.5), quiet("d", None)]
    found = repetition("time_delay", logs)
    assert found.standing is Standing.REPEATS
    assert found.nats == pytest.approx(28.5)
    assert (found.pointing, found.against, found.silent) == (("a", "b"), ("c",), ("d",))
    assert found.parameters["delay"].value == pytest.approx(4.05)
    assert found.named == 2


def test_a_log_that_points_the_other_way_speaks_against():
    logs = [named("a", 10.0, x=(4.0, 0.1), y=(1.0, 1.0)), named("b", 9.0, x=(3.9, 0.1), y=(-1.0, 1.0)),
            named("c", 50.0, x=(-2.0, 0.5), y=(0.0, 1.0))]  # fmt: skip
    found = repetition("gyro_bias", logs)
    assert found.against == ("c",)
    assert found.nats == pytest.approx(19.0)
    assert found.standing is Standing.VARIES
    assert not found.parameters["x"].agrees
    assert found.parameters["y"].agrees


def test_disagreement_widens_the_common_standard_deviation():
    found = combined([(1.0, 0.1), (2.0, 0.1)])
    assert found.value == pytest.approx(1.5)
    assert found.std == pytest.approx(0.1 / np.sqrt(2) * np.sqrt(50.0))
    assert not found.agrees


def test_one_log_is_no_repetition_and_silence_is_none():
    assert repetition("e", [named("a", 30.0, x=(1.0, 0.1)), quiet("b", 0.0)]).standing is Standing.ONCE
    assert repetition("e", [named("a", 7.0, x=(1.0, 0.1)), quiet("b", -4.0)]).standing is Standing.CONTRADICTED
    assert repetition("e", [quiet("a", 1.0), quiet("b", 2.0)]).standing is Standing.ABSENT
    assert repetition("e", [quiet("a", 4.0), quiet("b", 3.0)]).standing is Standing.HINT


def test_combined_values_are_as_wrong_as_they_say():
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(400):
        s = rng.uniform(0.1, 1.0, 8)
        found = combined(list(zip(2.0 + s * rng.normal(size=8), s)))
        errors.append((found.value - 2.0) / found.std)
    assert 0.75 < np.std(errors) < 1.05
