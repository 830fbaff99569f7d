"""Recording of an archive: every voyage as a point over its date, the lines through them, flexure against the sea."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.publish.archive import AGAINST_THE_SEA, ArchiveReport, Fit, Listing, Relation, Trend
from stages.publish.axis import Axis, span_of
from stages.publish.document import plain_markdown, table
from stages.publish.recording import layout
from stages.publish.recording.chart import Chart, Curve, chart_view, key_view, log_chart, log_key
from stages.publish.recording.comparison import COLOURS
from stages.publish.recording.overview import KEY_SHARE
from stages.publish.recording.scene import AXIS_COLOURS, BLUE, GREEN, GREY, ORANGE, Colour
from stages.publish.recording.stream import SLICE, UTC, record

DOT, WHISKER = 3.5, 1.2  # radius of markers and width of lines, points of the screen
MOST_ROWS = 60  # of a table in the document
MOST_LETTERS = 28  # of a cell
SEA = "sea"
KNOWN: dict[str, Colour] = {"RMSE against truth": GREEN, "RMSE against PHINS": ORANGE, "predicted σ": BLUE}
MARKER = rr.components.MarkerShape
EDGES = ("one sigma above", "one sigma below")


def write_archive(report: ArchiveReport, path: Path) -> None:
    """Write the recording of an archive."""
    trends = [trend for trend in report.trends if np.isfinite(trend.values).any()]
    span = _span(trends)
    axis = layout.axis_over(span)
    entities = [f"trend_{index:02d}_{_plain(trend.title)}" for index, trend in enumerate(trends)]
    charts = [f"relation_{index:02d}_{_plain(one.title)}" for index, one in enumerate(report.relations)]

    def log(rec: rr.RecordingStream) -> None:
        _send(rec, "span", np.rint(1e9 * np.array(span)).astype(np.int64), np.full(2, np.nan))  # for the cursor's start
        for trend, entity in zip(trends, entities):
            _log_trend(rec, trend, entity)
        for name, entity in _keys(trends).items():
            log_key(rec, entity, _colours_of([trend for trend in trends if trend.tab == name]))
        for relation, entity in zip(report.relations, charts):
            log_chart(rec, entity, _chart(relation))
        for entity, text in (("summary", archive_text(report)), (SEA, _sea_text(report))):
            rec.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    tabs = _tabs(report, list(zip(trends, entities)), charts, axis)
    record(path, f"archive {report.title}", layout.blueprint(tabs, axis, UTC), log)


def archive_text(report: ArchiveReport) -> str:
    """The summary in words and tables, Markdown."""
    parts = [
        f"# {plain_markdown(report.headline)}",
        *map(plain_markdown, report.sentences),
        *map(_listed, report.listings),
    ]
    if report.warnings:
        parts += ["## What to distrust", "\n".join(f"- {plain_markdown(line)}" for line in report.warnings)]
    stated = [[plain_markdown(name), plain_markdown(value)] for name, value in report.provenance.items() if value]
    return "\n\n".join([*parts, table(["where from", ""], stated)] if stated else parts)


def _listed(listing: Listing) -> str:
    """A table; where its last column holds sentences, which no narrow view shows whole, they follow it as a list."""
    rows = [[plain_markdown(str(cell)) for cell in row] for row in listing.rows[:MOST_ROWS]]
    rest = len(listing.rows) - MOST_ROWS
    parts, header = [f"## {listing.title}"], list(listing.header)
    wordy = any(len(row[-1]) > MOST_LETTERS for row in rows)
    if wordy:
        sentences = [f"- {row[0]}: {row[-1]}" for row in rows if row[-1]]
        header, rows = header[:-1], [row[:-1] for row in rows]
    if len(header) > 1:
        parts.append(table(header, rows))
    if wordy:
        parts.append("\n".join(sentences))
    return "\n\n".join([*parts, f"and {rest} more"] if rest > 0 else parts)


def _sea_text(report: ArchiveReport) -> str:
    """The table that stands beside the charts of flexure against the sea."""
    return "\n\n".join(_listed(listing) for listing in report.listings if listing.title == AGAINST_THE_SEA)


def _tabs(
    report: ArchiveReport, trends: Sequence[tuple[Trend, str]], charts: Sequence[str], axis: rrb.TimeAxis
) -> list[rrb.Container]:
    """The summary beside the first kind of trend, a tab for each other kind, the sea last."""
    words = rrb.TextDocumentView(origin="summary", name="Summary")
    names = list(dict.fromkeys(trend.tab for trend, _ in trends))
    stacks = [_stack(name, [(trend, entity) for trend, entity in trends if trend.tab == name], axis) for name in names]
    if not stacks:
        return [rrb.Vertical(words, name="Summary")]
    first = rrb.Horizontal(stacks[0], words, column_shares=[1.5, 1.0], name=names[0])
    tabs: list[rrb.Container] = [first, *stacks[1:]]
    if charts:
        views = [chart_view(entity, relation.title) for entity, relation in zip(charts, report.relations)]
        beside = rrb.TextDocumentView(origin=SEA, name="The lines in figures")
        tabs.append(rrb.Grid(*views, beside, grid_columns=2, name="Against the sea"))
    return tabs


def _stack(name: str, trends: Sequence[tuple[Trend, str]], axis: rrb.TimeAxis) -> rrb.Vertical:
    """The figures of a tab below each other, above them what their colours mean."""
    views = [_view(trend, entity, axis) for trend, entity in trends]
    key = key_view(_keys([trend for trend, _ in trends])[name], "Colours")
    return rrb.Vertical(key, *views, row_shares=[KEY_SHARE, *[9.0 / len(views)] * len(views)], name=name)


def _keys(trends: Sequence[Trend]) -> dict[str, str]:
    """The entity of each tab's key."""
    return {trend.tab: f"key_{_plain(trend.tab)}" for trend in trends}


def _colours_of(trends: Sequence[Trend]) -> list[tuple[str, Colour]]:
    """What a tab's points, whiskers and lines are, each once."""
    named = {name: colour for trend in trends for name, colour in zip(trend.names, _colours(trend))}
    spread = [("upright line: ±σ", GREY)] if any(trend.std is not None for trend in trends) else []
    lines = dict.fromkeys(f"line {fit.name}, ±σ" for trend in trends for fit in trend.fits)
    return [*named.items(), *spread, *((line, GREY) for line in lines)]


def _colours(trend: Trend) -> list[Colour]:
    """Of each name: an axis keeps its colour, a reference its own."""
    return [
        AXIS_COLOURS["xyz".index(axis)] if (axis := _axis_in(name)) else KNOWN.get(name, COLOURS[i % len(COLOURS)])
        for i, name in enumerate(trend.names)
    ]


def _axis_in(name: str) -> str:
    """The axis that ``x``, ``x (pitch)`` and ``damping.x`` are about; empty where a name tells of none."""
    found = re.fullmatch(r"(?:.*\.)?([xyz])(?: .*)?", name)
    return found[1] if found else ""


def _view(trend: Trend, entity: str, axis: rrb.TimeAxis) -> rrb.View:
    """Points whose standard deviation is not beyond the picture."""
    ends = [trend.values] if trend.std is None else [trend.values - trend.std, trend.values + trend.std]
    name, limits = f"{trend.title} [{trend.label}]", span_of(ends, zero=False)
    return layout.lines_view(axis, name, [f"{entity}/**"], limits)


def _span(trends: Sequence[Trend]) -> tuple[float, float]:
    """Seconds UTC that all points lie in, with a day of room for a single one."""
    if not trends:
        return 0.0, 1.0
    stamps = np.concatenate([trend.stamp for trend in trends])
    start, end = float(stamps.min()) * 1e-9, float(stamps.max()) * 1e-9
    room = 0.02 * (end - start) or 43200.0
    return start - room, end + room


def _log_trend(rec: rr.RecordingStream, trend: Trend, entity: str) -> None:
    """The fitted lines with their bands, and the points, each with a whisker of one sigma."""
    for index, fit in enumerate(trend.fits):
        if np.isfinite(fit.value).all():
            _log_fit(rec, fit, f"{entity}/fit_{index}")
    order = np.argsort(trend.stamp, kind="stable")
    for i, (name, colour) in enumerate(zip(trend.names, _colours(trend))):
        value = trend.values[order, i]
        _points(rec, f"{entity}/{_plain(name)}", trend.stamp[order], value, name, colour, DOT, MARKER.Circle)
        if trend.std is not None:
            _whiskers(
                rec, f"{entity}/{_plain(name)}_sigma", trend.stamp[order], value, trend.std[order, i], name, colour
            )


def _whiskers(
    rec: rr.RecordingStream, entity: str, stamp: IntArray, value: FloatArray, std: FloatArray, name: str, colour: Colour
) -> None:  # fmt: skip
    """An upright line a point, from one sigma below to one above; NaN after each keeps them apart."""
    good = np.isfinite(value) & np.isfinite(std)
    at = (stamp[good][:, None] + np.arange(3)).ravel()
    ends = np.stack([value - std, value + std, np.full(len(value), np.nan)], axis=1)[good].ravel()
    whole = rr.components.AggregationPolicy.Off  # else the viewer draws the mean of both ends
    style = rr.SeriesLines(names=[f"{name} ±σ"], colors=[colour], widths=[WHISKER], aggregation_policy=whole)
    rec.log(entity, style, static=True)
    _send(rec, entity, at, ends)


def _points(
    rec: rr.RecordingStream, entity: str, stamp: IntArray, value: FloatArray, name: str, colour: Colour, size: float,
    marker: rr.components.MarkerShape,
) -> None:  # fmt: skip
    style = rr.SeriesPoints(names=[name], colors=[colour], markers=[marker], marker_sizes=[size])
    rec.log(entity, style, static=True)
    good = np.isfinite(value)
    _send(rec, entity, stamp[good], value[good])


def _log_fit(rec: rr.RecordingStream, fit: Fit, entity: str) -> None:
    stamp = np.rint(fit.x).astype(np.int64)
    names = (fit.name, *EDGES)
    for name, value, width in zip(names, (fit.value, fit.value + fit.std, fit.value - fit.std), (1.8, 0.8, 0.8)):
        where = f"{entity}/{_plain(name)}"
        rec.log(where, rr.SeriesLines(names=[name], colors=[GREY], widths=[width]), static=True)
        _send(rec, where, stamp, value)


def _send(rec: rr.RecordingStream, entity: str, stamp: IntArray, value: FloatArray) -> None:
    """On the timeline of dates alone: voyages have no common start."""
    for start in range(0, len(stamp), SLICE):
        part = slice(start, start + SLICE)
        times = [rr.TimeColumn(UTC, timestamp=np.ascontiguousarray(stamp[part]).view("datetime64[ns]"))]
        rr.send_columns(entity, times, rr.Scalars.columns(scalars=value[part]), recording=rec)


def _chart(relation: Relation) -> Chart:
    """A cross a log, as high as its standard deviation, and the fitted line."""
    x = Axis(*span_of([relation.x], zero=False), relation.x_label)
    y = Axis(*span_of([relation.y - relation.std, relation.y + relation.std], zero=False), relation.y_label)
    curves = [Curve(*_crosses(relation, 0.004 * (x.high - x.low)), COLOURS[0], "a log", 2.0)]
    if relation.fit is not None and np.isfinite(relation.fit.value).all():
        curves.append(Curve(relation.fit.x, relation.fit.value, GREY, "fitted", 1.5, dashed=True))
    return Chart(x, y, curves)


def _crosses(relation: Relation, reach: float) -> tuple[FloatArray, FloatArray]:
    """Two strokes a point, each ended by NaN."""
    x, y, s, gap = relation.x, relation.y, relation.std, np.full(len(relation.x), np.nan)
    across = np.stack([x - reach, x + reach, gap, x, x, gap], axis=1)
    up = np.stack([y, y, gap, y - s, y + s, gap], axis=1)
    return across.ravel(), up.ravel()


def _plain(name: str) -> str:
    """A name that needs no escape in an entity's path."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "series"
