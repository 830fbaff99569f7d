"""The relevance vector machine smooths; least squares reads the parameters off."""

import numpy as np
import pytest

from stages.identify import autocorrelation as ac
from stages.identify.rvm import RelevanceVectorMachine, dictionary, sparse_bayes
from tests.stages.identify.synthetic import CRITICAL, UNDERDAMPED, exact, misfit, rms_from_truth, sampled


def test_dictionary_holds_damped_sinusoids_of_unit_length():
    lag = 0.2 * np.arange(1, 101)
    columns = dictionary(lag, 5)
    assert columns.shape == (100, 50)
    assert np.linalg.norm(columns, axis=0) == pytest.approx(1.0)
    first = np.exp(-0.01 * lag) * np.cos(0.01 * lag)
    assert columns[:, 0] == pytest.approx(first / np.linalg.norm(first))


@pytest.mark.parametrize("axis", [UNDERDAMPED, CRITICAL])
def test_an_exact_autocorrelation_is_rebuilt(axis):
    record = exact(axis)
    assert rms_from_truth(lambda c: sparse_bayes(c, 8), record, record.value) < 0.01


def test_parameters_are_those_of_plain_least_squares():
    record = sampled(UNDERDAMPED, 3600.0, np.random.default_rng(1), 125)
    found = RelevanceVectorMachine(nodes=10)._solve(record)
    assert found == pytest.approx(ac.fit(record), abs=0.05)
    assert misfit(found, UNDERDAMPED) < 0.35


@pytest.mark.slow
def test_full_dictionary_on_a_trial(trial, alignment, twin):
    found = RelevanceVectorMachine().identify(trial, alignment)
    assert found.method == "rvm"
    assert found.std[:2] == pytest.approx(np.radians(twin.flexure.std_arcmin[:2]) / 60.0, rel=0.5)
