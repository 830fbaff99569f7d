"""What the tabs compute before they draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from physics.units import ARCMIN
from stages.publish.axis import Axis, legible, round_step, span_of
from stages.publish.deck_line import design_line, measured_line
from stages.publish.recording.accuracy import data_lane, event_lane, phase_lane, windowed_rms
from stages.publish.recording.chart import Chart, Curve, _pieces
from stages.publish.recording.deck import averaged
from stages.publish.recording.overview import running_rmse
from stages.publish.recording.scene import Scene
from stages.publish.recording.ship import SHOWN_SHARE, bending_factor, bent_line, curvature_colours, outline, round_down
from stages.publish.recording.stream import SLICE, pieces, thin_extremes
from stages.publish.spectrum import (
    measured_autocorrelation,
    measured_spectrum,
    model_autocorrelation,
    model_spectrum,
)
from tests.stages import synthetic_result as synthetic

MODEL = synthetic.case(duration=5.0, gap=None, with_phins=False, with_deck=False).result.deformation.flexure


def test_thinning_keeps_every_spike():
    stamp = np.arange(1000, dtype=np.int64) * 10_000_000
    values = np.zeros((1000, 2))
    values[503, 0], values[211, 1] = 9.0, -7.0
    at, thin = thin_extremes(stamp, values, 5)
    assert len(at) == 200
    assert thin[:, 0].max() == 9.0
    assert thin[:, 1].min() == -7.0
    assert np.all(np.diff(at) > 0)


def test_thinning_does_not_reach_across_a_gap():
    stamp = np.concatenate([np.arange(95), 200 + np.arange(100)]).astype(np.int64) * 10_000_000
    at, _ = thin_extremes(stamp, np.zeros((195, 1)), 10)
    assert np.sum(np.diff(at) > 5e8) == 1


def test_a_break_comes_right_after_the_last_sample():
    stamp = np.array([0, 10, 20, 100, 110], dtype=np.int64)
    values = np.arange(5.0)[:, None]
    ((at, values),) = pieces(stamp, lambda part: values[part])
    np.testing.assert_array_equal(at, [0, 10, 20, 30, 100, 110])
    np.testing.assert_array_equal(np.isnan(values[:, 0]), [False, False, False, True, False, False])


def test_pieces_of_a_long_line_are_all_of_it_and_a_gap_at_their_seam_breaks_it():
    values = np.arange(2.0 * SLICE + 3)[:, None]
    stamp = 10 * np.arange(len(values), dtype=np.int64)
    stamp[SLICE:] += 500
    parts = list(pieces(stamp, lambda part: values[part]))
    at, drawn = (np.concatenate(together) for together in zip(*parts))
    assert len(parts) == 3
    assert at[SLICE] == stamp[SLICE - 1] + 10
    assert np.flatnonzero(np.isnan(drawn[:, 0])).tolist() == [SLICE]
    np.testing.assert_array_equal(np.delete(drawn, SLICE, axis=0), values)
    np.testing.assert_array_equal(np.delete(at, SLICE), stamp)


def test_running_rmse_ends_at_the_rmse():
    error = np.random.default_rng(1).standard_normal((500, 3))
    np.testing.assert_allclose(running_rmse(error)[-1], np.sqrt((error**2).mean(axis=0)))
    np.testing.assert_allclose(running_rmse(error)[0], np.abs(error[0]))


def test_running_rmse_of_a_long_record_is_that_of_all_before(monkeypatch):
    error = np.random.default_rng(1).standard_normal((1000, 2))
    whole = np.sqrt(np.cumsum(error**2, axis=0) / np.arange(1, 1001)[:, None])
    monkeypatch.setattr("stages.publish.recording.overview.SLAB", 100)
    np.testing.assert_allclose(running_rmse(error, 7), whole[::7], rtol=1e-12)


def test_autocorrelation_of_a_long_record_is_that_of_all_products(monkeypatch):
    theta = np.random.default_rng(2).standard_normal((1000, 3)).cumsum(axis=0)
    monkeypatch.setattr("stages.publish.spectrum.SLAB", 128)
    x = theta - theta.mean(axis=0)
    direct = np.array([(x[: 1000 - lag] * x[lag:]).sum(axis=0) for lag in range(60)])
    np.testing.assert_allclose(measured_autocorrelation(theta, 60), direct / direct[0], rtol=0, atol=1e-12)


def test_windowed_rms_leaves_empty_windows_out():
    t = np.concatenate([np.arange(0, 10, 0.1), np.arange(30, 40, 0.1)])
    error = np.where(t[:, None] < 20, 1.0, 3.0) * np.ones(3)
    stamp, rms = windowed_rms((t * 1e9).astype(np.int64), error, 10.0)
    np.testing.assert_allclose(rms, [[1, 1, 1], [3, 3, 3]])
    np.testing.assert_allclose(stamp * 1e-9, [5.0, 35.0])


def test_lanes_of_data_and_phases():
    at, states = data_lane(np.array([0, 1, 2, 9, 10], dtype=np.int64))
    assert list(at) == [0, 2, 9, 10]
    assert states == ["data", "gap", "data", ""]
    assert data_lane(np.array([0, 1, 2, 9, 10], dtype=np.int64), "")[1] == ["data", "", "data", ""]
    times, states = phase_lane(np.array([[10.0, 20.0]]), (0.0, 30.0))
    assert list(times) == [0.0, 10.0, 20.0, 30.0]
    assert states == ["under way", "lying still", "under way", ""]


def test_model_spectrum_integrates_to_the_variance():
    f = np.linspace(1e-4, 20.0, 400_001)
    area = np.trapezoid(model_spectrum(f, MODEL), f, axis=0)
    np.testing.assert_allclose(area, MODEL.std**2, rtol=0.01)


def test_model_autocorrelation_is_the_transform_of_the_spectrum():
    f = np.linspace(1e-4, 10.0, 100_001)
    lag = np.array([0.0, 2.0, 7.5])
    kernel = np.cos(2 * np.pi * f[:, None] * lag)
    spectrum = model_spectrum(f, MODEL)
    expected = [np.trapezoid(kernel[:, [k]] * spectrum, f, axis=0) / MODEL.std**2 for k in range(3)]
    np.testing.assert_allclose(model_autocorrelation(lag, MODEL), expected, atol=0.01)


@pytest.mark.parametrize("n", [1000, 1003])
def test_measured_spectrum_is_welchs(n: int) -> None:
    theta = np.random.default_rng(3).standard_normal((n, 3)) + np.linspace(0.0, 5.0, n)[:, None]
    f, density = measured_spectrum(theta, 10.0)
    expected, powers = welch(theta[:, 1], 10.0, nperseg=n // 4, detrend="linear")
    np.testing.assert_allclose(f, expected[1:])
    np.testing.assert_allclose(density[:, 1], powers[1:], rtol=1e-9)


def test_measured_spectrum_and_correlation_follow_the_model_on_a_long_record():
    t = np.arange(0, 20_000, 0.1)
    theta = synthetic.flexure(t, np.random.default_rng(2))
    f, density = measured_spectrum(theta, 10.0)
    band = (f > 0.02) & (f < 0.3)
    ratio = density[band].sum(axis=0) / model_spectrum(f[band], MODEL).sum(axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)
    measured = measured_autocorrelation(theta, 100)
    np.testing.assert_allclose(measured, model_autocorrelation(np.arange(100) * 0.1, MODEL), atol=0.15)


def test_bent_line_is_clamped_at_m_and_its_slope_at_s_is_the_flexure():
    lever, theta = np.array([0.0, 30.0, 0.0]), np.array([[3.0, 0.0, 0.0]]) * ARCMIN
    line = bent_line(theta, lever, 1.0)[0]
    np.testing.assert_allclose(line[0], 0.0)
    slope = (line[-1, 2] - line[-2, 2]) / (line[-1, 1] - line[-2, 1])
    assert slope == pytest.approx(theta[0, 0], rel=0.06)  # chord of the last twelfth, not tangent
    assert line[-1, 2] > 0  # positive pitch of s lifts it: bow up


def test_exaggeration_is_round_and_fills_its_share():
    lever, theta = np.array([0.0, 30.0, 0.0]), np.array([[3.0, 0.0, 0.0]]) * ARCMIN
    factor = bending_factor(theta, lever)
    shown = np.abs(bent_line(theta, lever, factor)[0, -1, 2])
    assert 0.4 * SHOWN_SHARE * 30.0 <= shown <= SHOWN_SHARE * 30.0
    assert round_down(779.0) == 500.0
    assert bending_factor(np.zeros((1, 3)), lever) == 1.0


def test_outline_holds_all_instruments_and_closes():
    points = np.array([[0.0, 0.0, 0.0], [-4.2, 36.0, 3.1]])
    hull = outline(points)
    np.testing.assert_array_equal(hull[0], hull[-1])
    assert hull[:, 1].min() < 0 < 36.0 < hull[:, 1].max()
    assert hull[:, 0].min() < -4.2 < 0 < hull[:, 0].max()


def test_largest_curvature_is_red_and_none_is_blue():
    colours = curvature_colours(np.array([0.0, 1e-4, np.nan]))
    assert colours[0, 2] > colours[0, 0]
    assert colours[1, 0] > 200 > colours[1, 2]


def test_axis_places_and_labels_round_numbers():
    axis = Axis(-1.2e-4, 2.1e-4, "curvature", scale=1e-5)
    assert [axis.text(t) for t in axis.ticks()] == ["-10", "0", "10", "20"]
    log = Axis(0.005, 2.0, "frequency [Hz]", log=True)
    np.testing.assert_allclose(log.ticks(), [0.01, 0.1, 1.0])
    np.testing.assert_allclose(log.place(np.array([0.005, 0.1, 2.0])), [0.0, 0.5, 1.0], atol=1e-12)
    assert np.isnan(log.place(np.array([0.0]))[0])


def test_curves_are_cut_at_the_frame_and_at_nan():
    chart = Chart(Axis(0, 10, "x"), Axis(0, 1, "y"), ())
    y = np.array([0.5, 0.5, np.nan, 0.5, 0.5, 7.0, 0.5, 0.5])
    assert [len(piece) for piece in _pieces(chart, Curve(np.arange(8.0), y, (0, 0, 0)))] == [2, 2, 2]


def test_steps_and_spans_are_fit_to_be_read():
    assert round_step(0.37) == 0.5
    assert round_step(0.0) == 1.0
    low, high = span_of([np.array([1.0, np.nan, 3.0])])
    assert low < 0.0 < 3.0 < high


def test_averaging_a_run_keeps_its_mean():
    s = np.linspace(100.0, 0.0, 1001)
    k = np.random.default_rng(3).standard_normal(1001)
    place, value = averaged(s, k, 91)
    assert len(place) <= 91
    assert np.all(np.diff(place) > 0)
    np.testing.assert_allclose(
        np.average(value, weights=np.append(np.full(len(value) - 1, 11), 1001 % 11 or 11)), k.mean()
    )


@pytest.mark.parametrize("limits", [(-0.7, 0.6), (-28.0, -14.0), (0.2, 9.0), (3.0, 20.0), (0.0, 0.0), (-1e4, 1e4)])
def test_two_marks_of_a_time_view_are_always_in_sight(limits):
    low, high = legible(*limits)
    assert low <= limits[0]
    assert high >= limits[1]
    marks = [10.0**k for k in range(-13, 6) if (high - low) / 10.0**k <= 10.0]
    assert any(np.floor(high / m + 1e-6) - np.ceil(low / m - 1e-6) >= 1 for m in marks)


def test_thinning_passes_over_what_is_unknown():
    values = np.zeros((100, 1))
    values[::3], values[50] = np.nan, 9.0
    assert np.nanmax(thin_extremes(np.arange(100, dtype=np.int64) * 10_000_000, values, 5)[1]) == 9.0


def test_constant_curvature_bends_a_line_by_its_sagitta():
    """k L^2 / 8 in the middle; about x below the chord, about z to starboard of it."""
    s, k = np.linspace(0.0, 100.0, 401), 1e-5
    flat = np.stack([0 * s, s, 0 * s], axis=1)
    shape = synthetic.deck_shape(np.random.default_rng(1))
    shape = replace(shape, arc_length=s, line=flat, design=np.tile([k, 0.0, 0.5 * k], (len(s), 1)))
    np.testing.assert_allclose(measured_line(shape), 0.0, atol=1e-12)
    np.testing.assert_allclose(design_line(shape)[200], [0.5 * k * 1e4 / 8, -k * 1e4 / 8], rtol=1e-4)
    assert design_line(replace(shape, design=None)) is None


def test_events_close_together_are_one_in_their_lane():
    case = synthetic.case(duration=100.0, gap=None, with_phins=False, with_deck=False)
    scene = Scene(case.result, case.trial, case.truth)
    stamp, states = event_lane(np.array([20.0, 20.4, 60.0]), scene)
    assert states == ["unexpected", "", "unexpected", ""]
    np.testing.assert_allclose((stamp - synthetic.EPOCH) * 1e-9, [20.0, 21.4, 60.0, 61.0], atol=0.02)
