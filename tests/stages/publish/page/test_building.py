"""Markup that cannot be broken, and figures that keep what they show."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stages.publish.axis import Axis, date_axis, decades_of, span_of, time_axis
from stages.publish.page.archive import ArchiveReport, Listing, Trend, archive_page
from stages.publish.page.charts import Bar, Bars, HeatMap, bars, colour, heat_map
from stages.publish.page.figure import BUCKETS, Band, Line, Plot, envelope, extremes, plot
from stages.publish.page.html import Html, section, table, tag, text
from tests.stages.publish.page.reading import loads_from_elsewhere, read

X, Y = Axis(0.0, 10.0, "time [s]"), Axis(-1.0, 1.0, "angle [arcmin]")


def test_whatever_is_no_markup_is_escaped():
    made = tag("p", "<script>", Html("<b>x</b>"), title='"><script>')
    assert made == '<p title="&quot;&gt;&lt;script&gt;">&lt;script&gt;<b>x</b></p>'


def test_characters_that_cannot_be_printed_or_encoded_are_replaced():
    assert text("a\x00b\ud800c\u202ed") == "a\ufffdb\ufffdc\ufffdd"
    text("a\ud800").encode()


def test_tables_escape_their_cells_and_empty_sections_vanish():
    assert "&lt;x&gt;" in table(["<x>"], [["<y>", 1.5]])
    assert section("Title", "", None) == ""


def test_a_line_is_thinned_but_keeps_its_peaks_and_its_gap():
    y = np.zeros(1_000_000)
    y[123_456], y[654_321], y[400_000:410_000] = 7.0, -9.0, np.nan
    kept_x, kept = extremes(np.arange(1e6), y)
    assert len(kept) <= 3 * BUCKETS
    assert np.nanmax(kept) == 7.0
    assert np.nanmin(kept) == -9.0
    assert np.isnan(kept).any()
    assert (np.diff(kept_x) >= 0).all()


def test_a_band_is_thinned_to_what_encloses_it():
    low, high = -np.ones(100_000), np.ones(100_000)
    high[77] = 5.0
    x, below, above = envelope(np.arange(1e5), low, high)
    assert len(x) == len(below) == len(above) == BUCKETS
    assert above.max() == 5.0


def test_a_band_breaks_where_samples_stop_however_long_the_record():
    """A gap within a bucket was bridged: the band ran across stretches without an estimate."""
    x = np.concatenate([np.arange(0.0, 101.0, 0.01), np.arange(140.0, 300.0, 0.01)])
    html = plot(
        Plot("t", Axis(0, 300, "x"), Axis(-2, 2, "y"), [Band(x, -np.ones(len(x)), np.ones(len(x)), "#000", "", 0.1)])
    )
    paths = re.search(r'<path d="([^"]*Z)"', html).group(1).split("Z")[:-1]
    assert len(paths) == 2
    ends = [[float(word) for word in re.split("[ML ]", path) if word][::2] for path in paths]
    assert max(ends[0]) < min(ends[1]) - 50


def test_line_breaks_where_samples_stop():
    x = np.concatenate([np.arange(0.0, 3.0, 0.1), np.arange(6.0, 9.0, 0.1)])
    one = Plot("t", X, Y, [Line(x, np.zeros_like(x), "red", breaks=0.5)])
    drawn = re.search(r'<path d="([^"]*)" fill="none" stroke="red"', plot(one))[1]
    assert drawn.count("M") == 2


def test_a_point_stands_where_its_axes_put_it():
    """At (5, 0) of axes 0..10 and -1..1: the middle of the frame."""
    one = Plot("t", X, Y, [Line(np.array([5.0, 10.0]), np.array([0.0, 1.0]), "red")], height=258.0, width=668.0)
    drawn = re.search(r'<path d="M([0-9. ]+)L([0-9. ]+)" fill="none" stroke="red"', plot(one))
    assert drawn[1] == "300.0 100.0"
    assert drawn[2] == "600.0 0.0"


def test_a_figure_says_its_units_and_what_is_what():
    band = Band(np.arange(3.0), -np.ones(3), np.ones(3), "blue", "±3σ")
    page = read(plot(Plot("Roll <y>", X, Y, [band, Line(np.arange(3.0), np.zeros(3), "red", "truth")])))
    assert "time [s]" in page.texts["svg"]
    assert "angle [arcmin]" in page.texts["svg"]
    assert {"±3σ", "truth"} <= set(re.findall(r"±3σ|truth", page.texts["figcaption"]))
    assert "Roll <y>" in page.texts["strong"]
    assert not page.unbalanced


def test_bars_are_as_long_as_their_values():
    rows = [Bar("a", 1.0), Bar("b", 2.0, error=0.5, mark=1.5, note="two")]
    drawn = bars(Bars("t", "x [1]", rows, limits=(0.0, 4.0)))
    one, two = (float(w) for w in re.findall(r'<rect x="[^"]*" y="[^"]*" width="([^"]*)" height="12"', drawn))
    assert two == pytest.approx(2 * one, rel=1e-3)
    assert 'class="whisker"' in drawn
    assert 'class="mark"' in drawn


def test_a_map_is_darkest_where_it_is_largest_and_stays_small():
    values = np.ones((3, 5000))
    values[1, 2500:2532] = 9.0
    drawn = heat_map(HeatMap("t", ["a", "b", "c"], [str(k) for k in range(5000)], values, "nats"))
    assert drawn.count(f'fill="{colour(1.0)}"') >= 1
    assert drawn.count("<rect") < 600


def test_time_is_told_in_the_unit_that_suits():
    assert "[s]" in time_axis(0.0, 400.0).label
    assert "[min]" in time_axis(0.0, 7200.0).label
    assert "[h]" in time_axis(0.0, 86400.0).label
    assert time_axis(0.0, 7200.0).text(1800.0) == "30"
    assert [time_axis(0.0, 7200.0).text(t) for t in time_axis(0.0, 7200.0).ticks()][:3] == ["0", "20", "40"]


def test_limits_hold_what_they_are_made_from():
    low, high = span_of([np.array([3.0, 5.0])], zero=False)
    assert low < 3.0 < 5.0 < high
    assert low > 0.0
    assert span_of([np.array([np.nan])], zero=False) == (-1.0, 1.0)
    assert decades_of([np.array([0.0, 0.02, 30.0])]) == (0.01, 100.0)
    assert decades_of([np.array([1e-30, 1.0])]) == pytest.approx((1e-9, 1.0), rel=1e-6)
    assert decades_of([np.array([1.0])]) == (1.0, 10.0)


@pytest.mark.parametrize(
    ("start", "end", "first"),
    [
        ("2020-03-01", "2026-05-01", "2021-01-01"),
        ("2026-01-10", "2026-06-20", "2026-02-01"),
        ("2026-01-10", "2026-01-15", "2026-01-10"),
        ("2026-01-10T00:00", "2026-01-10T09:00", "2026-01-10 00:00"),
    ],
)
def test_dates_stand_at_whole_calendar_steps(start, end, first):
    axis = date_axis(*(int(np.datetime64(text, "ns").astype(np.int64)) for text in (start, end)))
    ticks = axis.ticks()
    assert 2 <= len(ticks) <= 8
    assert axis.text(ticks[0]) == first
    assert (np.diff(ticks) > 0).all()


def test_archive_page_shows_every_trend_and_every_voyage():
    stamp = np.array(["2026-01-01", "2026-03-01", "2026-06-01"], "datetime64[ns]").astype(np.int64)
    values = np.array([[1.0, 2.0], [1.5, np.nan], [9.0, 2.5]])
    trends = (Trend("Static angle <x>", "[arcmin]", stamp, values, 0.1 * np.ones((3, 2)), ("x", "y")),
              Trend("Nothing", "[1]", stamp, np.full((3, 1), np.nan), None, ("z",)))  # fmt: skip
    rows = [[f"voyage {k}", k] for k in range(600)]
    report = ArchiveReport("ship", "3 trials", "care", "The static angle drifts.", ("By 8′.",), trends,
                           (Listing("Voyages", ("log", "n"), rows),), ("<b>odd</b>",), {"a": "b"})  # fmt: skip
    html = archive_page(report, "now")
    page = read(html)
    assert page.count("circle") == 5
    assert "Static angle <x>" in page.texts["figcaption"]
    assert "Nothing" not in page.texts["body"]
    assert "voyage 499" in page.texts["table"]
    assert "and 100 more" in page.texts["body"]
    assert "<b>odd</b>" in page.texts["li"]
    assert loads_from_elsewhere(page) == []
    assert not page.unbalanced
