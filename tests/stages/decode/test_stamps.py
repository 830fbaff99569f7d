"""Settling stamps: strictly increasing, nothing invented, everything told; with a slow reference for the facts."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.errors import DataError
from stages.decode import stamps

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
PERIOD = 10_000_000


def alike(i, j):
    return np.ones(len(i), dtype=bool)


def clean(count=2000):
    return START + PERIOD * np.arange(count)


def test_clean_stamps_pass_untouched():
    stamp = clean()
    settled = stamps.settle(stamp, stamp + 5, alike)
    np.testing.assert_array_equal(settled.stamp, stamp)
    np.testing.assert_array_equal(settled.keep, np.arange(2000))
    assert settled.notes == ()


@given(st.lists(st.integers(-3, 3 * SECOND), min_size=1, max_size=60), st.booleans())
def test_whatever_comes_in_comes_out_increasing_and_from_the_log(steps, recorder_runs_on):
    stamp = START + np.cumsum(np.array(steps, dtype=np.int64) - SECOND)
    log_time = START + PERIOD * np.arange(len(stamp)) if recorder_runs_on else np.full(len(stamp), START)
    try:
        settled = stamps.settle(stamp, log_time, alike)
    except DataError:
        return
    assert (np.diff(settled.stamp) > 0).all()
    np.testing.assert_array_equal(settled.stamp, stamp[settled.keep])
    left_out = len(stamp) - len(settled.stamp)
    assert left_out == 0 or settled.notes


@given(st.lists(st.integers(1, 50), min_size=2, max_size=80))
def test_facts_agree_with_a_slow_count(ticks):
    stamp = START + PERIOD * np.array(ticks, dtype=np.int64)
    found = stamps.facts(stamp)
    seen = sorted(set(stamp.tolist()))
    assert found.duplicates == len(ticks) - len(seen)
    assert found.out_of_order == sum(b < a for a, b in itertools.pairwise(ticks))
    distances = [b - a for a, b in itertools.pairwise(seen)]
    if distances:
        middle = sorted(distances)[(len(distances) - 1) // 2] + sorted(distances)[len(distances) // 2]
        assert found.gaps == sum(d > stamps.GAP_PERIODS * middle / 2 for d in distances)


def test_overlapping_chunks_are_put_in_order_not_taken_for_a_clock_step():
    stamp = clean()
    order = np.r_[0:500, 1000:1500, 500:1000, 1500:2000]
    settled = stamps.settle(stamp[order], stamp[order] + 3_000_000, alike)
    np.testing.assert_array_equal(settled.stamp, stamp)
    assert "out of order" in settled.notes[0]


def test_a_clock_set_back_leaves_the_longer_part():
    stamp = clean()
    stamp[600:] -= 1000 * SECOND
    settled = stamps.settle(stamp, clean(), alike)
    np.testing.assert_array_equal(settled.keep, np.arange(600, 2000))
    assert "jump back by 999.990 s" in settled.notes[0]


def test_a_real_gap_is_no_clock_step():
    stamp = np.r_[clean(1000), clean(1000) + 300 * SECOND]
    settled = stamps.settle(stamp, stamp, alike)
    assert len(settled.stamp) == 2000
    assert settled.notes == ("a gap of 290.010 s at t = 9.990 s",)


def test_one_wrong_stamp_costs_one_sample():
    for wrong in (-500 * SECOND, 500 * SECOND):
        stamp = clean()
        stamp[777] += wrong
        settled = stamps.settle(stamp, clean(), alike)
        np.testing.assert_array_equal(settled.keep, np.delete(np.arange(2000), 777))


def test_slow_channels_are_not_full_of_jumps():
    stamp = START + 10 * SECOND * np.arange(50)
    swapped = stamp[np.r_[0:10, 11, 10, 12:50]]
    settled = stamps.settle(swapped, swapped, alike)
    np.testing.assert_array_equal(settled.stamp, stamp)


def test_zero_stamps_fall_back_on_the_times_of_writing():
    settled = stamps.settle(np.zeros(100, dtype=np.int64), clean(100), alike)
    np.testing.assert_array_equal(settled.stamp, clean(100))
    with pytest.raises(DataError, match="no message has a stamp"):
        stamps.settle(np.zeros(100, dtype=np.int64), np.full(100, START), alike)


def test_random_stamps_cost_bounded_time():
    rng = np.random.default_rng(0)
    stamp = START + rng.integers(0, 10**6 * SECOND, 20_000)
    settled = stamps.settle(stamp, clean(20_000), alike)
    assert (np.diff(settled.stamp) > 0).all()
