"""The page of an archive: what was found over many voyages, trends against date, the table behind them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from stages.publish.archive import ArchiveReport, Fit, Listing, Relation, Trend
from stages.publish.axis import Axis, date_axis, span_of
from stages.publish.page.figure import BLUE, GREY, PALETTE, Band, Line, Plot, Points, plot
from stages.publish.page.html import Html, bullets, join, section, table
from stages.publish.page.sheet import Sheet, render, verdict_box

MOST_LETTERS = 28  # of a last column that is a figure
MOST_ROWS = 500  # of a table on the page: a catalogue has them all
MOST_POINTS = 1500  # of a figure: beyond that, every second, third, ... log is drawn, and it is said

__all__ = ["ArchiveReport", "Listing", "Trend", "archive_page", "trend_plots"]


def archive_page(report: ArchiveReport, made: str = "") -> str:
    """HTML of an archive. made: when the page was made, as text."""
    body = [
        verdict_box(report.grade, report.headline, report.sentences),
        section("Over the voyages", *trend_plots(report.trends)),
        section("Against the sea", *(plot(_relation_plot(relation)) for relation in report.relations)),
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
    some, said = _thinned(len(trend.stamp))
    values = trend.values[some]
    std = np.zeros_like(values) if trend.std is None else np.nan_to_num(trend.std[some])
    t = trend.stamp[some].astype(float)
    parts = [Points(t, values[:, i], std[:, i], PALETTE[i % len(PALETTE)], name) for i, name in enumerate(trend.names)]
    y = Axis(*span_of([values - std, values + std], zero=False), f"[{trend.label}]")
    return Plot(trend.title + said, x, y, [*_lines(trend.fits), *parts], height=190.0)


def _thinned(count: int) -> tuple[slice, str]:
    """Which of so many logs are drawn, and what is said of it."""
    every = -(-count // MOST_POINTS)
    return slice(None, None, max(every, 1)), f" (one log in {every} is drawn)" if every > 1 else ""


def _lines(fits: Iterable[Fit]) -> list[Line | Band | Points]:
    """The lines, each with the band of one sigma about it; the legend names what is alike once."""
    parts: list[Line | Band | Points] = []
    named: set[str] = set()
    for fit in fits:
        if not np.isfinite(fit.value).all():
            continue
        band, name = ("", "") if fit.name in named else ("± one sigma of the line", fit.name)
        parts.append(Band(fit.x, fit.value - fit.std, fit.value + fit.std, GREY, band))
        parts.append(Line(fit.x, fit.value, GREY, name, dashed=True))
        named.add(fit.name)
    return parts


def _relation_plot(relation: Relation) -> Plot:
    some, said = _thinned(len(relation.x))
    at, value, std = relation.x[some], relation.y[some], relation.std[some]
    x = Axis(*span_of([at], zero=False), relation.x_label)
    y = Axis(*span_of([value - std, value + std], zero=False), relation.y_label)
    dots = Points(at, value, std, BLUE, "a log")
    return Plot(relation.title + said, x, y, [*_lines([relation.fit] if relation.fit else []), dots], height=190.0)


def _listed(listing: Listing) -> Html:
    rest = len(listing.rows) - MOST_ROWS
    note = f"and {rest} more" if rest > 0 else ""
    wordy = any(len(str(row[-1])) > MOST_LETTERS for row in listing.rows)
    made = (
        table(listing.header, listing.rows[:MOST_ROWS], class_="listing" if wordy else None) if listing.rows else None
    )
    return section(listing.title, join([made, note]))
