"""Recording of a published experiment: published beside measured, curves over time or something else, the tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.experiment import Curve, Figure, Panel
from stages.publish.axis import Axis, decades_of, span_of
from stages.publish.recording import layout
from stages.publish.recording.chart import Chart, chart_view, key_view, log_chart, log_key
from stages.publish.recording.chart import Curve as Drawn
from stages.publish.recording.comparison import COLOURS
from stages.publish.recording.overview import KEY_SHARE
from stages.publish.recording.scene import AXIS_COLOURS, GREY, Colour
from stages.publish.recording.sheet import Row, bars_height, log_bars, sheet_view
from stages.publish.recording.stream import record, send_lines

REFERENCES: dict[str, Colour] = {"truth": GREY, "design": (205, 205, 160)}
WIDE = 4.0  # width of a reference: what is right lies upon it
NOTES = 1.3  # how much wider the axis is than the bars, for what stands beside them
MOST_ROWS = 16  # bars of one quantity
DECADES_APART = 1.5  # from which on bars stand over a logarithm
RARE = (0.5, 99.5)  # percentiles that curves without a reference are drawn between, as far as that is much less


def write_reproduction(
    name: str, text: str, panels: Sequence[Panel], path: Path, figures: Sequence[Figure] = ()
) -> None:
    """Write the recording of an experiment. text: its tables in Markdown. figures: measured, some with published."""
    axis, beside = layout.axis_over(_span(panels)), published(figures)
    panels = [replace(panel, curves=_references_first(panel.curves)) for panel in panels]

    def log(rec: rr.RecordingStream) -> None:
        for index, group in enumerate(beside):
            _log_published(rec, f"published/quantity_{index}", group)
        for index, panel in enumerate(panels):
            _log_panel(rec, panel, _entity(index, panel))
        log_key(rec, "key", _colours([panel for panel in panels if panel.over_time]))
        rec.log("figures", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    record(path, f"reproduction {name}", layout.blueprint(tabs(panels, axis, beside), axis), log)


def tabs(panels: Sequence[Panel], axis: rrb.TimeAxis, beside: Sequence[Sequence[Figure]]) -> list[rrb.Container]:
    """Published beside measured, curves over time, charts, the figures; those that are there."""
    found: list[rrb.Container] = []
    if beside:
        bars = [_published_view(f"published/quantity_{index}", group) for index, group in enumerate(beside)]
        heights = [_height(group) for group in beside]
        words = rrb.TextDocumentView(origin="figures", name="Claims and figures")
        stack = rrb.Vertical(*bars, row_shares=heights)
        found.append(rrb.Horizontal(stack, words, column_shares=[1.0, 1.0], name="Published and measured"))
    over_time = [_time_view(p, _entity(i, p), axis) for i, p in enumerate(panels) if p.over_time]
    if over_time:
        rows = [rrb.Horizontal(*over_time[i : i + 2]) for i in range(0, len(over_time), 2)]
        shares = [KEY_SHARE, *[9.0 / len(rows)] * len(rows)]
        found.append(rrb.Vertical(key_view("key", "Colours"), *rows, row_shares=shares, name="Curves"))
    charts = [chart_view(_entity(i, p), p.title) for i, p in enumerate(panels) if not p.over_time]
    if charts:
        found.append(rrb.Grid(*charts, grid_columns=2, name="Charts"))
    return [*found, rrb.Vertical(rrb.TextDocumentView(origin="figures", name="Figures"), name="Figures")]


def published(figures: Sequence[Figure]) -> list[list[Figure]]:
    """The figures that something was printed for, those of one quantity together."""
    groups: dict[tuple[str, str], list[Figure]] = {}
    for figure in figures:
        if figure.printed is not None:
            groups.setdefault((figure.quantity, figure.unit), []).append(figure)
    return list(groups.values())


def published_rows(group: Sequence[Figure]) -> list[Row]:
    """A bar an axis and method as measured, a mark where it was printed; figures that are not known are left out."""
    rows = []
    for figure in group:
        assert figure.printed is not None
        axes = "xyz" if len(figure.mean) > 1 else " "
        for axis, value, spread, printed in zip(axes, figure.mean, figure.spread, figure.printed.value):
            if np.isfinite(value) and np.isfinite(printed):
                name = " ".join(part for part in (figure.case, figure.method, axis) if part.strip())
                colour = AXIS_COLOURS["xyz".index(axis)] if axis.strip() else COLOURS[0]
                error = spread if np.isfinite(spread) else None
                rows.append(Row(name, value, colour, error, printed, f"{value:.3g} ({printed:.4g})"))
    return rows[:MOST_ROWS]


def _height(group: Sequence[Figure]) -> float:
    return bars_height(len(published_rows(group)))


def _published_view(entity: str, group: Sequence[Figure]) -> rrb.Spatial2DView:
    return sheet_view(entity, f"{_quantity(group)}: measured, in red and in brackets as published", _height(group))


def _quantity(group: Sequence[Figure]) -> str:
    return f"{group[0].quantity} [{group[0].unit}]" if group[0].unit else group[0].quantity


def _log_published(rec: rr.RecordingStream, entity: str, group: Sequence[Figure]) -> None:
    """Bars over their value, or over its logarithm where the largest is far above the smallest."""
    rows, label = published_rows(group), _quantity(group)
    sizes = np.array([size for row in rows for size in (row.value, row.mark) if size is not None])
    if not len(rows):
        return
    if sizes.min() <= 0 or np.log10(sizes.max() / sizes.min()) < DECADES_APART:
        log_bars(rec, entity, rows, label, (min(0.0, 1.1 * float(sizes.min())), NOTES * float(sizes.max())))
        return
    low, high = decades_of([sizes])
    logs = [replace(row, value=np.log10(row.value / low), mark=np.log10((row.mark or low) / low), error=None)
            for row in rows]  # fmt: skip
    decades = round(np.log10(high / low))
    ticks = [(float(k), f"{low * 10.0**k:g}") for k in range(decades + 1)]
    log_bars(rec, entity, logs, label, (0.0, NOTES * decades), ticks)


def _references_first(curves: Sequence[Curve]) -> tuple[Curve, ...]:
    """What is right, to be drawn below what was found."""
    return tuple(sorted(curves, key=lambda curve: curve.name not in REFERENCES))


def _colours(panels: Sequence[Panel]) -> list[tuple[str, Colour]]:
    """Each name of several panels once."""
    return list({c.name: colour for panel in panels for c, colour in zip(panel.curves, _of(panel.curves))}.items())


def _of(curves: Sequence[Curve]) -> list[Colour]:
    """Colours of curves, their references first."""
    first = sum(curve.name in REFERENCES for curve in curves)
    return [REFERENCES.get(c.name, COLOURS[(i - first) % len(COLOURS)]) for i, c in enumerate(curves)]


def _span(panels: Sequence[Panel]) -> tuple[float, float]:
    ends = [curve.x[[0, -1]] for panel in panels if panel.over_time for curve in panel.curves if len(curve.x)]
    return (float(np.min(ends)), float(np.max(ends))) if ends else (0.0, 1.0)


def _entity(index: int, panel: Panel) -> str:
    return f"panel_{index:02d}_{_plain(panel.title)}"


def _plain(name: str) -> str:
    """A name that needs no escape in an entity's path."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "curve"


def _time_view(panel: Panel, entity: str, axis: rrb.TimeAxis) -> rrb.View:
    limits, cut = shown_range(panel)
    name = f"{panel.title}, peaks beyond the picture" if cut else panel.title
    return layout.lines_view(axis, name, [f"{entity}/**"], limits)


def shown_range(panel: Panel) -> tuple[tuple[float, float], bool]:
    """Limits of values, and whether peaks are beyond them: a few outliers shall not flatten all the rest."""
    whole = span_of([curve.y for curve in panel.curves], zero=False)
    most = [np.nanpercentile(c.y, RARE) for c in panel.curves if np.isfinite(c.y).any()]
    usual = span_of([*most, *(c.y for c in panel.curves if c.name in REFERENCES)], 0.5, zero=False)
    cut = usual[1] - usual[0] < 0.5 * (whole[1] - whole[0])
    return (usual if cut else whole), cut


def _log_panel(rec: rr.RecordingStream, panel: Panel, entity: str) -> None:
    colours = _of(panel.curves)
    if not panel.over_time:
        _log_chart(rec, panel, entity, colours)
        return
    lines = sorted(zip(panel.curves, colours, strict=True), key=_below)
    for order, (curve, colour) in enumerate(lines):
        stamp, width = np.rint(curve.x * 1e9).astype(np.int64), WIDE if curve.name in REFERENCES else 1.5
        where = f"{entity}/{order}_{_plain(curve.name)}"  # the viewer draws in the order of names
        send_lines(rec, where, stamp, 0, curve.y[:, None], [curve.name], [colour], width)


def _below(line: tuple[Curve, Colour]) -> tuple[bool, float]:
    """What is right lies below all; of the others the widest, which would hide the rest."""
    curve = line[0]
    return curve.name not in REFERENCES, -float(np.nan_to_num(np.nanstd(curve.y)))


def _log_chart(rec: rr.RecordingStream, panel: Panel, entity: str, colours: Sequence[Colour]) -> None:
    x = Axis(*_limits([curve.x for curve in panel.curves]), panel.x_label)
    y = Axis(*span_of([curve.y for curve in panel.curves]), panel.y_label)
    curves = [
        Drawn(c.x, c.y, colour, c.name, WIDE if c.name == "truth" else 1.5, dashed=c.name == "design")
        for c, colour in zip(panel.curves, colours, strict=True)
    ]
    log_chart(rec, entity, Chart(x, y, curves))


def _limits(values: Sequence[np.ndarray]) -> tuple[float, float]:
    every = np.concatenate(values)
    return float(np.nanmin(every)), float(np.nanmax(every))
