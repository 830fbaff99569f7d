"""Recordings read back: what is in them, in which units, broken where the data are."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from physics.units import ARCMIN
from stages.publish.page.run import run_page
from stages.publish.recording.layout import SHARED_TIME
from stages.publish.recording.overview import lanes_told
from stages.publish.recording.scene import REFERENCE_COLOURS, REFERENCE_NAMES, Scene
from stages.publish.rerun_bridge import write_recording
from stages.publish.verdict import verdict
from tests.stages import synthetic_result as synthetic


@pytest.fixture(scope="module")
def case():
    return synthetic.case(duration=120.0, rate=50.0, gap=(50.0, 62.0))


@pytest.fixture(scope="module")
def path(case, tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "run.rrd"
    write_recording(case.result, case.trial, case.truth, path)
    return path


def chunks(path, blueprint=False):
    """Record batches of a store by entity path."""
    reader = RrdReader(path)
    stream = reader.stream(store=reader.blueprints()[0]) if blueprint else reader.stream()
    found: dict[str, list] = {}
    for chunk in stream:
        found.setdefault(str(chunk.entity_path), []).append(chunk.to_record_batch())
    return found


def column(batches, name):
    """All rows of one component that is temporal, lists flattened, and their trial times in s."""
    parts = [b for b in batches if name in b.schema.names and "trial_time" in b.schema.names]
    values = np.concatenate([b.column(name).flatten().to_numpy(zero_copy_only=False) for b in parts])
    times = np.concatenate([b.column("trial_time").cast("int64").to_numpy() for b in parts]) * 1e-9
    return times, values


def column_text(path, entity):
    """The words of a document."""
    batch = next(b for b in chunks(path)[entity] if "TextDocument:text" in b.schema.names)
    return batch.column("TextDocument:text")[0][0].as_py()


def bar_lengths(path, entity):
    """From end to end, round caps included."""
    batch = chunks(path)[entity][0]
    strips, radii = (batch.column(f"LineStrips2D:{part}")[0].as_py() for part in ("strips", "radii"))
    return [abs(strip[1][0] - strip[0][0]) + 2 * radius for strip, radius in zip(strips, radii)]


def view_names(path):
    names = []
    for entity, batches in chunks(path, blueprint=True).items():
        if entity.startswith("/view/") and entity.count("/") == 2:
            names += [b.column("ViewBlueprint:display_name")[0][0].as_py() for b in batches]
    return names


def test_verify_finds_no_fault(path):
    rerun = Path(sys.executable).with_name("rerun")
    assert subprocess.run([rerun, "rrd", "verify", path], capture_output=True).returncode == 0


def test_estimate_is_at_full_rate_with_its_three_sigma(case, path):
    d = case.result.deformation
    batches = chunks(path)["/deformation/estimate/z"]
    times, values = column(batches, "Measurements:values")
    variances = column(batches, "Measurements:variances")[1]
    good = np.isfinite(values)
    np.testing.assert_allclose(times[good], (d.stamp - case.trial.epoch) * 1e-9, atol=1e-9)
    np.testing.assert_allclose(values[good], d.total[:, 2] / ARCMIN, rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(variances[good]), 3 * np.sqrt(d.covariance[:, 2, 2]) / ARCMIN, rtol=1e-6)


@pytest.mark.parametrize(
    ("entity", "name"),
    [
        ("/deformation/estimate/x", "Measurements:values"),
        ("/deformation/phins/x", "Scalars:scalars"),
        ("/error/truth/y", "Scalars:scalars"),
        ("/sensors/gyro/main", "Scalars:scalars"),
        ("/innovations", "Scalars:scalars"),
    ],
)
def test_lines_break_in_the_gap(path, entity, name):
    times, values = column(chunks(path)[entity], name)
    values = values.reshape(len(times), -1)
    broken = times[~np.isfinite(values).all(axis=1)]
    assert len(broken) == 1
    assert 49.9 < broken[0] < 62.0


def test_reference_drawn_is_the_truth(case, path):
    times, values = column(chunks(path)["/deformation/truth/y"], "Scalars:scalars")
    good = np.isfinite(values)
    t = (case.truth.stamp - case.trial.epoch) * 1e-9
    expected = np.interp(times[good], t, case.truth.total[:, 1] / ARCMIN)
    np.testing.assert_allclose(values[good], expected, atol=1e-4)


def test_both_timelines_agree(case, path):
    batch = next(b for b in chunks(path)["/error/truth/x"] if "utc" in b.schema.names)
    trial = batch.column("trial_time").cast("int64").to_numpy()
    utc = batch.column("utc").cast("int64").to_numpy()
    np.testing.assert_array_equal(utc - trial, case.trial.epoch)


def test_views_say_their_units(path):
    names = view_names(path)
    for unit in ("[arcmin]", "[deg/s]", "[m/s²]", "[ms]", "[1e-5 rad/m]", "[arcmin²/Hz]"):
        assert any(unit in name for name in names), unit
    unitless = {"Summary", "Accuracy in figures", "Deck shape in figures", "Phases and gaps", "Gaps",
                "Data, gaps and phases"}  # fmt: skip
    unitless |= {name for name in names if name.startswith("Colours")}
    assert [name for name in names if "[" not in name and name not in unitless] == []


def test_no_legend_hides_the_end_of_a_plot(path):
    legends = [b for e, bs in chunks(path, blueprint=True).items() if e.endswith("/PlotLegend") for b in bs]
    visible = [b.column(name)[0][0].as_py() for b in legends for name in b.schema.names if "visible" in name]
    assert len(visible) > 10
    assert not any(visible)


def test_tabs_are_there_in_order(path):
    containers = [b for e, bs in chunks(path, blueprint=True).items() if e.startswith("/container/") for b in bs]
    name = "ContainerBlueprint:display_name"
    names = {b.column(name)[0][0].as_py() for b in containers if name in b.schema.names}
    assert names >= {"Overview", "Accuracy", "Deck shape", "Sensors", "Spectra"}


def test_time_axes_open_on_the_whole_trial(case, path):
    shared = chunks(path, blueprint=True)[f"/view/{SHARED_TIME}/TimeAxis"][0]
    text = str(shared.column("TimeAxis:view_range")[0].as_py())
    numbers = [abs(int(word)) for word in "".join(c if c.isdigit() else " " for c in text).split()]
    assert any(118e9 < n < 123e9 for n in numbers), text


def test_static_pictures_are_there(path):
    entities = set(chunks(path))
    for entity in ("/ship/deck", "/ship/imu", "/ship/path/curvature", "/ship/bent_line", "/track/curve_0", "/summary",
                   "/accuracy", "/deck/vertical/frame", "/spectra/density_x/frame", "/lanes/main_imu"):  # fmt: skip
        assert entity in entities, entity


def test_lanes_mark_the_gap(path):
    batch = next(b for b in chunks(path)["/lanes/main_imu"] if "StateChange:state" in b.schema.names)
    states = [row[0] for row in batch.column("StateChange:state").to_pylist()]
    assert states == ["data", "gap", "data", ""]


def test_overview_opens_with_the_verdict_and_what_speaks_against(case, path):
    text = column_text(path, "/summary")
    judged = verdict(case.result, case.trial)
    assert text.startswith(f"## {judged.headline}")
    assert judged.reasons
    assert "have no estimate: data are missing" in text


def test_nothing_in_a_recording_is_fetched_from_elsewhere(path):
    classes = {b.column("ViewBlueprint:class_identifier")[0][0].as_py()
               for e, bs in chunks(path, blueprint=True).items() if e.count("/") == 2 and e.startswith("/view/")
               for b in bs if "ViewBlueprint:class_identifier" in b.schema.names}  # fmt: skip
    assert "Map" not in classes
    assert "TimeSeries" in classes


def test_key_names_every_line_in_its_colour(case, path):
    batch = chunks(path)["/key"][0]
    words = batch.column("Points2D:labels")[0].as_py()
    colours = dict(zip(words, batch.column("Points2D:colors")[0].as_py()))
    assert words[:3] == ["estimate ±3σ", "truth", "PHINS"]
    assert {"RMSE so far, truth", "RMSE so far, PHINS"} <= set(words)
    for reference, rgb in REFERENCE_COLOURS.items():
        assert colours[REFERENCE_NAMES[reference]] >> 8 == rgb[0] << 16 | rgb[1] << 8 | rgb[2]


def test_rms_is_shown_in_units_of_what_was_expected(case, path):
    score = next(s for s in case.result.scores if s.reference == "truth")
    values = column(chunks(path)["/rms/over_budget"], "Scalars:scalars")[1].reshape(-1, 3)
    overall = np.sqrt(np.nanmean(values**2, axis=0))
    np.testing.assert_allclose(overall, score.rmse / np.hypot(score.predicted, score.reference_noise), rtol=0.15)


def test_surprise_has_a_lane_and_stays_within_the_innovations(case, tmp_path):
    innovations = case.result.deformation.innovations
    values = innovations.values.copy()
    values[len(values) // 4 + 1, 0] = 25.0
    d = replace(case.result.deformation, innovations=replace(innovations, values=values))
    write_recording(replace(case.result, deformation=d), case.trial, case.truth, tmp_path / "a.rrd", rate=1.0)
    found = chunks(tmp_path / "a.rrd")
    assert "/lanes/unexpected" in found
    assert np.nanmax(column(found["/innovations"], "Scalars:scalars")[1]) == 25.0


def test_glance_at_the_lanes_tells_of_the_gap_alone(case):
    scene = Scene(case.result, case.trial, case.truth)
    assert lanes_told(scene) == ["estimate", "main_imu", "sliding"]


def test_colours_are_the_same_in_every_view(path):
    def colour(entity):
        batch = next(b for b in chunks(path)[entity] if "SeriesLines:colors" in b.schema.names)
        return batch.column("SeriesLines:colors")[0][0].as_py() >> 8

    for reference, rgb in REFERENCE_COLOURS.items():
        expected = rgb[0] << 16 | rgb[1] << 8 | rgb[2]
        assert colour(f"/deformation/{reference}/x") == colour(f"/error/{reference}/z") == expected


def test_what_a_log_names_is_no_markup_and_kills_no_viewer(case, tmp_path):
    nasty = "![x](http://a.example/b.png) `code` <b>bold</b> | cell \U0001f600"
    result = replace(case.result, warnings=(nasty,), provenance={"log": nasty})
    write_recording(result, replace(case.trial, source=nasty), case.truth, tmp_path / "a.rrd")
    text = column_text(tmp_path / "a.rrd", "/summary")
    assert "![" not in text
    assert "<b>" not in text
    assert "\U0001f600" not in text


def test_rate_thins_everything(case, path, tmp_path):
    thin = tmp_path / "thin.rrd"
    write_recording(case.result, case.trial, case.truth, thin, rate=2.0)
    times, _ = column(chunks(thin)["/deformation/estimate/x"], "Measurements:values")
    assert 190 < len(times) < 240
    assert thin.stat().st_size < 0.6 * path.stat().st_size


def test_nothing_is_left_behind_when_writing_fails(case, tmp_path):
    broken = replace(case.result, provenance=None)
    with pytest.raises(AttributeError):
        write_recording(broken, case.trial, case.truth, tmp_path / "run.rrd")
    assert list(tmp_path.iterdir()) == []


def test_bare_trial_is_recorded_too(tmp_path):
    bare = synthetic.case(duration=20.0, gap=None, with_phins=False, with_deck=False)
    d = replace(
        bare.result.deformation, innovations=None, covariance=np.full_like(bare.result.deformation.covariance, np.nan)
    )
    result = replace(bare.result, deformation=d, scores=(), warnings=())
    path = tmp_path / "bare.rrd"
    write_recording(result, replace(bare.trial, gnss=None), None, path)
    assert "Deck shape" not in str(view_names(path))
    assert len(column(chunks(path)["/deformation/estimate/x"], "Measurements:values")[0]) == len(d.stamp)


def test_layout_is_the_same_for_the_same_result(case, path, tmp_path):
    again = tmp_path / "again.rrd"
    write_recording(case.result, case.trial, case.truth, again)
    assert set(chunks(again, blueprint=True)) == set(chunks(path, blueprint=True))
    assert [e.recording_id for e in RrdReader(again).recordings()] == [
        e.recording_id for e in RrdReader(path).recordings()
    ]


@pytest.mark.slow
def test_a_quarter_of_an_hour_at_full_rate_stays_small(tmp_path):
    case = synthetic.case(duration=900.0, rate=100.0)
    path = tmp_path / "long.rrd"
    write_recording(case.result, case.trial, case.truth, path)
    assert path.stat().st_size < 75e6 / 4
    assert len(run_page(case.result, case.trial).encode()) < 2e6


@pytest.mark.parametrize("kind", ["zero", "nan", "fast", "short"])
def test_odd_records_are_shown_all_the_same(kind, tmp_path):
    """No flexure at all, none known, a record too short for its rate, and one of a few samples."""
    duration, rate = {"fast": (1.0, 1000.0), "short": (2.0, 20.0)}.get(kind, (30.0, 20.0))
    odd = synthetic.case(duration=duration, rate=rate, gap=None, with_phins=False, with_deck=False)
    d = odd.result.deformation
    value = {"zero": 0.0, "nan": np.nan}.get(kind)
    if value is not None:
        d = replace(d, dynamic_part=np.full_like(d.dynamic_part, value))
    result = replace(odd.result, deformation=d)
    trial = replace(odd.trial, gnss=None)
    write_recording(result, trial, odd.truth, tmp_path / "odd.rrd")
    assert "/deformation/estimate/x" in chunks(tmp_path / "odd.rrd")
    page = run_page(result, trial)
    assert not re.search(r'="[^"]*\bnan\b', page)
