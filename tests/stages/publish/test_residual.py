"""Residuals of a diagnosis: the channels that tell most come first, and white noise has the spectrum of white noise."""

import numpy as np
import pytest

from schemas.diagnosis import Trace
from stages.publish.residual import telling, whitened_spectra
from stages.publish.rows import known_rows

STEP = 0.2


def trace(name, size, n=4096, good=None):
    t = STEP * np.arange(n)
    values = size * np.random.default_rng(3).standard_normal(n)
    good = np.ones(n, dtype=bool) if good is None else good
    return Trace(name, "x", t, np.where(good, values, np.nan), np.where(good, values, 0.0), np.zeros(n), good)


def test_what_departs_most_comes_first_and_what_is_wholly_masked_not_at_all():
    traces = [trace("calm", 1.0), trace("loud", 5.0), trace("masked", 9.0, good=np.zeros(4096, bool)), trace("b", 2.0)]
    assert [one.channel for one in telling(traces, 2)] == ["loud", "b"]
    assert len(telling(traces, 9)) == 3


@pytest.mark.parametrize("masked", [0, 2000])
def test_white_noise_of_unit_variance_is_flat_at_its_expected_level(masked):
    good = np.arange(4096) >= masked
    (found,) = whitened_spectra([trace("a", 1.0, good=good)])
    inner = (found.frequency > 0) & (found.frequency < 0.5 / STEP)
    np.testing.assert_allclose(found.expected, 2 * STEP)
    assert np.mean(found.before[inner]) == pytest.approx(2 * STEP, rel=0.06)
    assert np.mean(found.after[inner]) == pytest.approx(2 * STEP, rel=0.06)


def test_a_line_stands_at_its_frequency():
    one = trace("a", 1.0)
    line = Trace("a", "x", one.t, one.before + 5 * np.sin(2 * np.pi * 0.3 * one.t), one.after, one.regressor, one.good)
    (found,) = whitened_spectra([line])
    assert found.frequency[np.argmax(found.before)] == pytest.approx(0.3, abs=1 / (512 * STEP))


def test_too_short_a_trace_has_no_spectrum():
    assert whitened_spectra([trace("a", 1.0, n=40)]) == []


def test_known_rows_leaves_out_what_is_not_finite_and_copies_nothing_else():
    values = np.arange(12.0).reshape(4, 3)
    assert known_rows(values) is values
    holed = values.copy()
    holed[1, 2], holed[2, 0] = np.nan, np.inf
    np.testing.assert_array_equal(known_rows(holed), values[[0, 3]])
