"""The recording of an archive read back: every voyage at its date, the line through them, what a reader is told."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stages.publish.page.archive import archive_page
from stages.publish.recording.archive import write_archive
from stages.publish.recording.scene import AXIS_COLOURS
from tests.stages.publish.page.reading import loads_from_elsewhere, read
from tests.stages.publish.test_rerun_bridge import chunks, column_text, view_names
from tests.stages.publish.voyages import STAMP, archive_report, static_trend

STATIC = "/trend_00_static_angle_about_z_heading"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("archive") / "archive.rrd"
    write_archive(archive_report(), path)
    return path


def dated(batches):
    """Values with their dates, ns UTC."""
    batch = next(b for b in batches if "Scalars:scalars" in b.schema.names)
    values = batch.column("Scalars:scalars").flatten().to_numpy(zero_copy_only=False)
    return batch.column("utc").cast("int64").to_numpy(), values


def test_verify_finds_no_fault(path):
    rerun = Path(sys.executable).with_name("rerun")
    assert subprocess.run([rerun, "rrd", "verify", path], capture_output=True).returncode == 0


def test_every_voyage_stands_at_its_date_with_its_sigma(path):
    found, trend = chunks(path), static_trend()
    stamp, values = dated(found[f"{STATIC}/z_heading"])
    np.testing.assert_array_equal(stamp, STAMP)
    np.testing.assert_allclose(values, trend.values[:, 0])
    at, ends = dated(found[f"{STATIC}/z_heading_sigma"])
    np.testing.assert_array_equal(at[::3], STAMP)
    np.testing.assert_allclose(ends.reshape(-1, 3)[:, :2], trend.values + np.array([-0.4, 0.4]))
    assert np.isnan(ends[2::3]).all()
    np.testing.assert_allclose(dated(found[f"{STATIC}/fit_0/fitted"])[1], trend.fits[0].value)
    errors = dated(found["/trend_01_rmse_against_truth/y_roll"])
    assert len(errors[0]) == 23  # the one that is not known is no point
    assert not any("nothing" in entity for entity in found)


def test_the_cursor_starts_before_the_first_voyage(path):
    first = dated(chunks(path)["/span"])[0][0]
    assert first < STAMP[0] - 86_400_000_000_000


def test_axes_keep_their_colours(path):
    style = next(b for b in chunks(path)[f"{STATIC}/z_heading"] if "SeriesPoints:colors" in b.schema.names)
    red, green, blue = AXIS_COLOURS[2]
    assert style.column("SeriesPoints:colors")[0][0].as_py() == (red << 24) + (green << 16) + (blue << 8) + 255


def test_each_tab_says_what_its_colours_mean(path):
    words = chunks(path)["/key_static_angle"][0].column("Points2D:labels")[0].as_py()
    assert words == ["z (heading)", "upright line: ±σ", "line fitted, ±σ"]
    words = chunks(path)["/key_accuracy"][0].column("Points2D:labels")[0].as_py()
    assert words == ["x (pitch)", "y (roll)", "z (heading)"]


def test_views_say_their_units_and_tabs_are_there(path):
    names = view_names(path)
    assert "Static angle about z (heading) [arcmin]" in names
    assert "Flexure against the sea" in names
    containers = [b for e, bs in chunks(path, blueprint=True).items() if e.startswith("/container/") for b in bs]
    name = "ContainerBlueprint:display_name"
    tabs = {b.column(name)[0][0].as_py() for b in containers if name in b.schema.names}
    assert tabs >= {"Static angle", "Accuracy", "Against the sea"}
    assert "Nowhere" not in tabs


def test_summary_says_the_answer_and_escapes_what_comes_from_logs(path):
    text = column_text(path, "/summary")
    assert text.startswith("# The static angle drifts about z (heading).")
    assert "voyage\\_59" in text
    assert "\\*odd\\*" in text
    assert "and 10 more" in text
    assert "voyage\\_3 is far off" in text


def test_an_archive_without_results_is_still_drawn(tmp_path):
    from stages.publish.archive import ArchiveReport

    write_archive(ArchiveReport("empty", "no log", "bad", "No log has a result."), tmp_path / "empty.rrd")
    assert column_text(tmp_path / "empty.rrd", "/summary").startswith("# No log has a result.")


def test_the_page_draws_line_band_and_points():
    html = archive_page(archive_report(), "now")
    page = read(html)
    assert page.count("circle") == 24 + 71 + 24
    assert "± one sigma of the line" in page.texts["figcaption"]
    assert "Against the sea" in page.texts["h2"]
    assert loads_from_elsewhere(page) == []
    assert not page.unbalanced


def test_the_page_of_a_huge_archive_stays_small():
    n = 100_000
    stamp = STAMP[0] + np.arange(n) * 3_600_000_000_000
    trend = replace(static_trend(), stamp=stamp, values=np.ones((n, 1)), std=np.ones((n, 1)), fits=())
    html = archive_page(replace(archive_report(), trends=(trend,), relations=()))
    assert read(html).count("circle") <= 1500
    assert "(one log in 67 is drawn)" in html
    assert len(html) < 1_000_000
