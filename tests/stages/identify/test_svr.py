"""Support vector regression smooths; least squares reads the parameters off."""

import numpy as np
import pytest

from stages.identify import autocorrelation as ac
from stages.identify.svr import SupportVectorRegression, smooth
from tests.stages.identify.synthetic import CRITICAL, UNDERDAMPED, exact, rms_from_truth, sampled


@pytest.mark.parametrize("axis", [UNDERDAMPED, CRITICAL])
def test_an_exact_autocorrelation_stays_within_the_tube(axis):
    record = exact(axis)
    assert rms_from_truth(lambda c: smooth(c, 0.01, 10.0), record, record.value) < 0.02


def test_white_errors_are_smoothed():
    record = exact(UNDERDAMPED)
    rng = np.random.default_rng(1)
    scale = np.max(np.abs(record.value))
    noisy = ac.AxisCorrelation(
        record.value + 0.05 * scale * rng.standard_normal(125), record.pairs, record.zero, record.T, record.length
    )
    assert rms_from_truth(lambda c: smooth(c, 0.05, 10.0), noisy, record.value) < 0.035


def test_parameters_are_near_those_of_plain_least_squares():
    record = sampled(UNDERDAMPED, 3600.0, np.random.default_rng(1), 125)
    assert SupportVectorRegression()._solve(record) == pytest.approx(ac.fit(record), abs=0.1)


def test_on_a_trial(trial, alignment, twin):
    found = SupportVectorRegression().identify(trial, alignment)
    assert found.method == "svr"
    assert found.std[:2] == pytest.approx(np.radians(twin.flexure.std_arcmin[:2]) / 60.0, rel=0.5)
