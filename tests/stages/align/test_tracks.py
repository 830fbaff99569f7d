from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import median_filter

from schemas.trial import ImuSeries
from stages.align.tracks import (
    GRID,
    cell_length,
    cells,
    despiked,
    finite_rows,
    long_run_variance,
    shared_spans,
    taper,
    tracks,
)


def _series(t: np.ndarray) -> ImuSeries:
    """Exact means of sin(t), cos(2 t), 1 over the intervals that end at t."""
    before = t - np.diff(t, prepend=2.0 * t[0] - t[1])
    width = t - before
    means = [(np.cos(before) - np.cos(t)) / width, (np.sin(2 * t) - np.sin(2 * before)) / 2 / width, np.ones_like(t)]
    return ImuSeries(np.round(t * 1e9).astype(np.int64), np.stack(means, 1), np.zeros((len(t), 3)))


def test_a_record_read_with_a_fractional_delay_is_exact_at_any_grid() -> None:
    first, second = (tracks(_series(np.arange(0.01, 30.0, step)), 0, "x") for step in (0.02, 0.013))
    delay = 0.12345
    pair = cells(shared_spans(first, second, 5.0, (0.0, 0.2)), 0.1, delay)
    start, end = pair.time + delay - 0.05, pair.time + delay + 0.05
    assert np.abs(pair.second[:, 0] - (np.cos(start) - np.cos(end)) / 0.1).max() < 1e-7
    assert np.abs(pair.slope[:, 0] - (np.sin(end) - np.sin(start)) / 0.1).max() < 1e-4
    assert np.abs(pair.first[:, 2] - 1.0).max() < 1e-9


def test_a_long_hole_splits_and_a_short_one_is_bridged() -> None:
    t = np.arange(0.02, 40.0, 0.02)
    short = np.delete(t, slice(500, 505))
    assert len(tracks(_series(short), 0, "x")) == 1
    assert len(tracks(_series(np.delete(short, slice(1000, 1100))), 0, "x")) == 2


def test_despiking_touches_the_spike_alone() -> None:
    values = np.random.default_rng(1).standard_normal((1000, 3)) * 1e-3
    spiky = values.copy()
    spiky[500, 1] += 1.0
    cleaned = despiked(spiky)
    assert np.count_nonzero(cleaned != spiky) == 1
    assert abs(cleaned[500, 1]) < 3e-3


def test_taper_is_one_in_the_middle_and_falls_to_nothing() -> None:
    window = taper(1000, 0.1)
    assert window[500] == 1.0
    assert window[[0, -1]].max() < 1e-3


def test_long_run_variance_of_a_coloured_series() -> None:
    rng = np.random.default_rng(4)
    white = rng.standard_normal((200_000, 1))
    coloured = np.convolve(white[:, 0], np.ones(10), "valid")[:, None]
    expected = 100.0 * len(coloured)
    assert np.isclose(long_run_variance(coloured, 0.1)[0, 0], expected, rtol=0.25)


def test_despiking_equals_a_median_filter_with_a_gate_everywhere() -> None:
    rng = np.random.default_rng(5)
    values = np.cumsum(rng.standard_normal((3000, 3)), axis=0) + 30.0 * rng.standard_t(1.5, (3000, 3))
    median = median_filter(values, (5, 1), mode="nearest")
    off = np.abs(values - median)
    gate = 8.0 * np.maximum(1.4826 * np.median(off[:-1], axis=0), np.median(np.abs(np.diff(values, axis=0)), axis=0))
    expected = np.where(off > gate, median, values)
    assert np.count_nonzero(expected != values) > 100
    assert np.array_equal(despiked(values), expected)


def test_rows_with_anything_not_finite_are_told_without_a_warning() -> None:
    rows = np.array([[0.0, 1.0, 2.0], [np.inf, -np.inf, 0.0], [0.0, np.nan, 0.0], [-np.inf, 0.0, 0.0]])
    assert finite_rows(rows).tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("interval", "length"), [(0.005, 0.1), (0.1, 0.1), (0.1001, 0.1), (0.13, 0.2), (0.2, 0.2), (1.0, 1.0)]
)
def test_cells_are_whole_multiples_of_the_grid_no_shorter_than_an_interval(interval: float, length: float) -> None:
    series = _series(np.arange(1, 100) * interval)
    assert np.isclose(cell_length(series, _series(np.arange(1, 100) * 0.01)), length)
    assert np.isclose(length / GRID, round(length / GRID))


def test_rates_are_means_over_any_cells_of_a_jittered_record() -> None:
    rng = np.random.default_rng(6)
    (track,) = tracks(_series(np.arange(1, 4000) * 0.01 + rng.uniform(-2e-3, 2e-3, 3999)), 0, "x")
    start = 3.1234 + 0.5 * np.arange(50)
    found = track.rate(start[0], 0.5, 50)
    assert np.abs(found[:, 0] - 2.0 * (np.cos(start) - np.cos(start + 0.5))).max() < 1e-6
    assert np.abs(found[:, 1] - (np.sin(2.0 * (start + 0.5)) - np.sin(2.0 * start))).max() < 1e-5
