"""The whales find what least squares finds."""

import numpy as np
import pytest

from stages.identify import autocorrelation as ac
from stages.identify.woa import WhaleOptimisation, search
from tests.stages.identify.synthetic import UNDERDAMPED, exact, misfit, sampled


def test_truth_is_found_in_an_exact_autocorrelation():
    assert misfit(search(exact(UNDERDAMPED), 30, 150, 1), UNDERDAMPED) < 0.02


def test_misfit_is_nearly_that_of_least_squares():
    record = sampled(UNDERDAMPED, 3600.0, np.random.default_rng(1), 125)
    found, best = search(record, 30, 150, 1), ac.fit(record)
    cost = [float(np.sum((ac._model(p, record) - record.value) ** 2)) for p in (found, best)]
    assert cost[0] < 1.01 * cost[1]


def test_same_seed_same_answer_and_another_seed_another():
    record = exact(UNDERDAMPED)
    once, again, other = (search(record, 12, 20, seed) for seed in (1, 1, 2))
    assert np.array_equal(once, again)
    assert not np.array_equal(once, other)


def test_the_seed_touches_no_global_state():
    np.random.seed(7)  # noqa: NPY002
    expected = np.random.random()  # noqa: NPY002
    np.random.seed(7)  # noqa: NPY002
    search(exact(UNDERDAMPED), 8, 5, 1)
    assert np.random.random() == expected  # noqa: NPY002


def test_on_a_trial(trial, alignment, twin):
    found = WhaleOptimisation(iterations=40).identify(trial, alignment)
    assert found.method == "woa"
    assert found.std[:2] == pytest.approx(np.radians(twin.flexure.std_arcmin[:2]) / 60.0, rel=0.6)
