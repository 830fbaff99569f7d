"""The page of an archive: what was found over many voyages, trends against date, the table behind them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.publish.axis import Axis, date_axis, span_of
from stages.publish.page.figure import PALETTE, Plot, Points, plot
from stages.publish.page.html import Html, bullets, join, section, table
from stages.publish.page.sheet import Sheet, render, verdict_box

MOST_ROWS = 500  # of a table on the page: a catalogue has them all


@dataclass(frozen=True)
class Trend:
    """One figure against date. stamp: (k,) ns UTC. values, std: (k, m), std None where there is none. names: m."""

    title: str
    label: str
    stamp: IntArray
    values: FloatArray
    std: FloatArray | None
    names: Sequence[str]


@dataclass(frozen=True)
class Listing:
    """A table under a heading; of more than MOST_ROWS rows the rest is counted."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[object]]


@dataclass(frozen=True)
class ArchiveReport:
    """grade: good, care or bad. headline, sentences: the answer in words. warnings: what to distrust."""

    title: str
    about: str
    grade: str
    headline: str
    sentences: Sequence[str] = ()
    trends: Sequence[Trend] = ()
    listings: Sequence[Listing] = ()
    warnings: Sequence[str] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)


def archive_page(report: ArchiveReport, made: str = "") -> str:
    """HTML of an archive. made: when the page was made, as text."""
    body = [
        verdict_box(report.grade, report.headline, report.sentences),
        section("Over the voyages", *trend_plots(report.trends)),
        *(_listed(listing) for listing in report.listings),
        section("What to distrust", bullets(report.warnings)),
    ]
    return render(Sheet("archive of trials", report.title, report.about, body, report.provenance, made))


def trend_plots(trends: Iterable[Trend]) -> list[Html]:
    """A figure for each trend that has anything to show, all over the same span of dates."""
    shown = [trend for trend in trends if np.isfinite(trend.values).any()]
    if not shown:
        return []
    stamps = np.concatenate([trend.stamp for trend in shown])
    x = date_axis(int(stamps.min()), int(stamps.max()))
    return [plot(_trend_plot(trend, x)) for trend in shown]


def _trend_plot(trend: Trend, x: Axis) -> Plot:
    std = np.zeros_like(trend.values) if trend.std is None else np.nan_to_num(trend.std)
    t = trend.stamp.astype(float)
    parts = [
        Points(t, trend.values[:, i], std[:, i], PALETTE[i % len(PALETTE)], name) for i, name in enumerate(trend.names)
    ]
    y = Axis(*span_of([trend.values - std, trend.values + std], zero=False), trend.label)
    return Plot(trend.title, x, y, parts, height=190.0)


def _listed(listing: Listing) -> Html:
    rest = len(listing.rows) - MOST_ROWS
    note = f"and {rest} more" if rest > 0 else ""
    made = table(listing.header, listing.rows[:MOST_ROWS]) if listing.rows else None
    return section(listing.title, join([made, note]))
