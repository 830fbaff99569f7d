"""A diagnosis in sentences, and its recording read back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rerun.chunk import RrdReader

from schemas.diagnosis import Finding, Gap, ParameterEstimate
from schemas.diagnosis import Tested as Row
from stages.publish import diagnosis_words as words
from stages.publish.page.diagnosis import diagnosis_page
from stages.publish.recording.diagnosis import diagnosis_text, write_diagnosis_recording
from tests.stages.publish import diagnosed
from tests.stages.publish.test_rerun_bridge import bar_lengths, chunks, column, column_text, view_names


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "diagnosis.rrd"
    write_diagnosis_recording(diagnosed.diagnosis(), path)
    return path


@pytest.mark.parametrize(
    ("value", "std", "unit", "told"),
    [
        (0.0153021, 2.1e-5, "s", "0.015302 ± 2.1e-05 s"),
        (-3.0, 1.0, "arcmin", "-3 ± 1 arcmin"),
        (0.001, 5.0, "1", "0.001 ± 5"),
        ("x", None, "", "x"),
        (2.5, None, "m", "2.5 m"),
    ],
)
def test_a_parameter_has_the_digits_its_uncertainty_leaves_it(value, std, unit, told):
    assert words.value_text(ParameterEstimate(value, std, unit)) == told


def test_sentence_names_cause_and_shrinkage():
    told = words.sentence(diagnosed.diagnosis())
    assert told.startswith("time_delay (delay_s 0.015302 ± 2.1e-05 s")
    assert told.endswith("with it the gap shrinks by 98 % (95 % interval 95 to 99 %).")


def test_sentence_without_a_cause_says_where_it_is_strongest():
    told = words.sentence(diagnosed.unknown())
    assert told.startswith("None of 2 effects tested explains it")
    assert "gyro of the sub-IMU, x, 0.1 to 0.2 Hz" in told
    assert words.sentence(diagnosed.no_gap()) == "Over 30 min, none of 2 effects tested reaches its threshold."


def test_look_alikes_say_what_would_tell_them_apart():
    finding = Finding("a", {}, 1.0, ("b", "c"), ("a turn",))
    told = words.look_alikes(diagnosed.diagnosis(effects=(finding,)))
    assert told == ["a looks the same in this log as b (told apart by a turn), c"]


@pytest.mark.parametrize(
    ("band", "told"), [((0.1, 0.2), "0.1 to 0.2 Hz"), ((0.0, 0.05), "below 0.05 Hz"), ((5.0, np.inf), "above 5 Hz")]
)
def test_bands_read_well(band, told):
    assert words.band_text(*band) == told


def test_channels_are_named_for_people_and_strange_ones_stand_as_they_are():
    assert words.channel_text("sub.accel", "z") == "accelerometer of the sub-IMU, z"
    assert words.channel_text("phins_main.attitude") == "attitude of the PHINS at main"
    assert words.channel_text("odd") == "odd"


def test_every_row_tells_why_it_was_not_named():
    assert words.judged(Row("a", 3.0, 14.0, False)) == "below its threshold"
    assert words.judged(Row("a", None, 14.0, False)) == "not tested"
    assert words.judged(Row("a", 300.0, 14.0, False, "halves disagree")) == "halves disagree"


def test_recording_has_its_tabs_units_and_answer(path):
    names = view_names(path)
    for unit in ("[nats]", "[%]", "[arcmin]", "[(rad/s)²/Hz]", "[1]"):
        assert any(unit in name for name in names), unit
    text = column_text(path, "/answer")
    for part in ("the cause is found", "one pulse per second", "phins\\_latency", "0.015302 ± 2.1e-05 s"):
        assert part in text
    layout = chunks(path, blueprint=True)
    containers = str(
        [batch.to_pydict() for entity, found in layout.items() if "/container/" in entity for batch in found]
    )
    for tab in ("Diagnosis", "Where", "Spectra", "In time"):
        assert tab in containers


def test_residual_is_in_time_whole_and_broken_where_masked(path):
    trace = diagnosed.diagnosis().traces[0]
    times, values = column(chunks(path)["/residual/0"], "Scalars:scalars")
    values = values.reshape(len(times), 3)
    np.testing.assert_allclose(times, trace.t, atol=1e-9)
    good = np.isfinite(values).all(axis=1)
    np.testing.assert_array_equal(good, trace.good)
    expected = np.stack([trace.before, trace.after, trace.regressor], axis=1)
    np.testing.assert_allclose(values[good], expected[trace.good], atol=1e-5)


def test_bars_end_where_their_values_are(path):
    lengths = bar_lengths(path, "/shrinkage/bars")
    assert lengths[1] == pytest.approx(lengths[0] * 55 / 98, rel=1e-4)
    assert lengths[2] == pytest.approx(0.0, abs=1e-4)


def test_map_is_bright_where_the_deficit_is(path):
    batch = next(b for b in chunks(path)["/where/bands/cells"] if "Image:buffer" in b.schema.names)
    form = batch.column("Image:format")[0][0].as_py()
    picture = np.array(batch.column("Image:buffer")[0][0].as_py(), dtype=np.uint8)
    picture = picture.reshape(form["height"], form["width"], 3).astype(int)
    red = np.argwhere((picture == [220, 50, 40]).all(axis=2))
    assert len(red)
    down, across = red.mean(axis=0) / [form["height"], form["width"]]
    assert down < 0.2  # first channel
    assert 0.5 < across < 0.8  # third band of six, right of the names


def test_a_diagnosis_with_nothing_to_draw_is_recorded_too(tmp_path):
    for index, one in enumerate((diagnosed.no_gap(), diagnosed.diagnosis(tested=()), diagnosed.unknown())):
        path = tmp_path / f"{index}.rrd"
        write_diagnosis_recording(one, path)
        assert RrdReader(path).recordings()
        assert "/answer" in chunks(path)


def test_how_what_has_no_name_follows_the_ship_is_said_and_drawn(tmp_path):
    told = words.transfer_text(diagnosed.transfer())
    assert "gyro of the sub-IMU, z" in told
    assert "follows the gyro of the main IMU, y (84.0 nats held out): gain 0.002 ± 0.0002" in told
    weak = replace(diagnosed.transfer(), evidence_nats=3.0)
    assert "follows no motion of the ship" in words.transfer_text(weak)
    path = tmp_path / "unknown.rrd"
    write_diagnosis_recording(diagnosed.unknown(), path)
    assert {"gain, gyro of the main IMU, y → gyro of the sub-IMU, z"} <= set(view_names(path))
    assert any(name.startswith("/transfer/phase") for name in chunks(path))
    assert "How it follows the ship" in diagnosis_text(diagnosed.unknown())
    assert "How it follows the ship" not in diagnosis_text(diagnosed.diagnosis())
    assert "follows the gyro of the main IMU, y" in diagnosis_page(diagnosed.unknown(), {})


def test_nothing_from_outside_is_markup_in_the_document():
    nasty = "![x](http://a.example) <b> \U0001f600"
    text = diagnosis_text(diagnosed.diagnosis(advice=(nasty,), notes=(nasty,)))
    assert "![" not in text
    assert "<b>" not in text
    assert "\U0001f600" not in text


def test_shrinkage_without_a_cause_is_that_of_nothing():
    rows = words.shrinkage(replace(diagnosed.unknown(), comparisons=()))
    assert rows == [("answer: nothing named", Gap(1.42, 1.42, 0.0, (0.0, 0.1)))]
