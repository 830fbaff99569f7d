"""Recording of a published experiment: curves over time, curves over something else, and the table of figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.experiment import Panel
from stages.publish.axis import Axis, span_of
from stages.publish.recording import layout
from stages.publish.recording.chart import Chart, Curve, chart_view, log_chart
from stages.publish.recording.comparison import COLOURS
from stages.publish.recording.scene import GREY, Colour
from stages.publish.recording.stream import record, send_lines

REFERENCES = ("truth", "design")  # drawn in grey


def write_reproduction(name: str, text: str, panels: Sequence[Panel], path: Path) -> None:
    """Write the recording of an experiment. text: its tables in Markdown."""
    axis = layout.axis_over(_span(panels))

    def log(rec: rr.RecordingStream) -> None:
        for index, panel in enumerate(panels):
            _log_panel(rec, panel, _entity(index, panel))
        rec.log("figures", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    record(path, f"reproduction {name}", layout.blueprint(tabs(panels, axis), axis), log)


def tabs(panels: Sequence[Panel], axis: rrb.TimeAxis) -> list[rrb.Container]:
    """Curves over time, charts, the figures; those that are there."""
    views = [(panel.over_time, _view(panel, _entity(index, panel), axis)) for index, panel in enumerate(panels)]
    found: list[rrb.Container] = []
    for name, over_time in (("Curves", True), ("Charts", False)):
        chosen = [view for is_time, view in views if is_time is over_time]
        if chosen:
            found.append(rrb.Grid(*chosen, grid_columns=2, name=name))
    return [*found, rrb.Vertical(rrb.TextDocumentView(origin="figures", name="Figures"), name="Figures")]


def _span(panels: Sequence[Panel]) -> tuple[float, float]:
    ends = [curve.x[[0, -1]] for panel in panels if panel.over_time for curve in panel.curves if len(curve.x)]
    return (float(np.min(ends)), float(np.max(ends))) if ends else (0.0, 1.0)


def _entity(index: int, panel: Panel) -> str:
    return f"panel_{index:02d}_{_plain(panel.title)}"


def _plain(name: str) -> str:
    """A name that needs no escape in an entity's path."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "curve"


def _view(panel: Panel, entity: str, axis: rrb.TimeAxis) -> rrb.View:
    if not panel.over_time:
        return chart_view(entity, panel.title)
    legend = rrb.PlotLegend(rrb.Corner2D.RightTop)
    return rrb.TimeSeriesView(origin=entity, name=panel.title, axis_x=axis, plot_legend=legend)


def _log_panel(rec: rr.RecordingStream, panel: Panel, entity: str) -> None:
    colours = [GREY if c.name in REFERENCES else COLOURS[i % len(COLOURS)] for i, c in enumerate(panel.curves)]
    if not panel.over_time:
        _log_chart(rec, panel, entity, colours)
        return
    for curve, colour in zip(panel.curves, colours, strict=True):
        stamp = np.rint(curve.x * 1e9).astype(np.int64)
        send_lines(rec, f"{entity}/{_plain(curve.name)}", stamp, 0, curve.y[:, None], [curve.name], [colour])


def _log_chart(rec: rr.RecordingStream, panel: Panel, entity: str, colours: Sequence[Colour]) -> None:
    x = Axis(*_limits([curve.x for curve in panel.curves]), panel.x_label)
    y = Axis(*span_of([curve.y for curve in panel.curves]), panel.y_label)
    curves = [Curve(c.x, c.y, colour, c.name) for c, colour in zip(panel.curves, colours, strict=True)]
    log_chart(rec, entity, Chart(x, y, curves))


def _limits(values: Sequence[np.ndarray]) -> tuple[float, float]:
    every = np.concatenate(values)
    return float(np.nanmin(every)), float(np.nanmax(every))
