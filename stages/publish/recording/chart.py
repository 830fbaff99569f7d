"""A chart of something against something other than time, drawn in a 2D view.

Time views know no other axis than time, so frame, grid, ticks and curves are drawn here in sheet units: WIDTH by
HEIGHT (unless a chart wants another), y downwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.rig import FloatArray
from stages.publish.axis import Axis
from stages.publish.recording.scene import Colour

WIDTH, HEIGHT = 160.0, 80.0
KEY_HEIGHT, KEY_LINE, KEY_LETTER, KEY_SPACE = 3.0, 6.0, 1.4, 4.0
MARGIN = (14.0, 7.0, 26.0, 12.0)  # left, top, right, bottom
FRAME: Colour = (120, 120, 125)
GRID: Colour = (58, 58, 62)
ZONE: Colour = (150, 40, 40)
TEXT: Colour = (200, 200, 205)


@dataclass(frozen=True)
class Curve:
    """Points x, y (n,) in data units; NaN breaks the line. name: legend, empty for none."""

    x: FloatArray
    y: FloatArray
    colour: Colour
    name: str = ""
    width: float = 1.5
    dashed: bool = False


@dataclass(frozen=True)
class Chart:
    """Everything on one sheet. zones: (x0, x1) stretches of x to mark in red. height of the sheet.

    low: the sheet is so low that the name of x stands beside its ticks, not below them.
    """

    x: Axis
    y: Axis
    curves: Sequence[Curve]
    zones: Sequence[tuple[float, float]] = field(default_factory=tuple)
    height: float = HEIGHT
    low: bool = False


def chart_view(entity: str, name: str, height: float = HEIGHT) -> rrb.Spatial2DView:
    """The view of a chart, whole sheet in sight."""
    bounds = rrb.VisualBounds2D(x_range=[0.0, WIDTH], y_range=[0.0, height])
    return rrb.Spatial2DView(
        origin=entity, name=name, visual_bounds=bounds, background=rrb.Background(color=[22, 22, 26])
    )


def log_chart(rec: rr.RecordingStream, entity: str, chart: Chart) -> None:
    """Draw a chart; static, so it stands at every time."""
    _log_frame(rec, entity, chart)
    if chart.zones:
        _log_zones(rec, entity, chart)
    for index, curve in enumerate(chart.curves):
        pieces = [piece for piece in _pieces(chart, curve) if len(piece) > 1]
        drawn = _dashes(pieces) if curve.dashed else pieces
        strips = rr.LineStrips2D(
            drawn,
            colors=[curve.colour] * len(drawn),
            radii=rr.Radius.ui_points(curve.width / 2),
            draw_order=10.0 + index,
        )
        rec.log(f"{entity}/curve_{index}", strips, static=True)
    _log_legend(rec, entity, chart)


def _log_zones(rec: rr.RecordingStream, entity: str, chart: Chart) -> None:
    """A thick red bar along the foot of the chart, and its edges carried up through it."""
    top, base = MARGIN[1], chart.height - MARGIN[3]
    ends = _sheet(chart, np.array(chart.zones, dtype=float), np.full((len(chart.zones), 2), chart.y.low))[..., 0]
    bars = [[[a + 1.0, base - 1.0], [max(b - 1.0, a + 1.1), base - 1.0]] for a, b in ends]
    edges = [[[x, top], [x, base]] for x in ends.ravel()]
    strips = rr.LineStrips2D(
        [*bars, *edges],
        colors=[ZONE] * (len(bars) + len(edges)),
        radii=[1.0] * len(bars) + [0.1] * len(edges),
        draw_order=4.0,
    )
    rec.log(f"{entity}/zones", strips, static=True)


def _sheet(chart: Chart, x: FloatArray, y: FloatArray) -> FloatArray:
    """Sheet positions (n, 2) of data points."""
    left, top, right, bottom = MARGIN
    u = left + chart.x.place(np.asarray(x, float)) * (WIDTH - left - right)
    v = chart.height - bottom - chart.y.place(np.asarray(y, float)) * (chart.height - top - bottom)
    return np.stack([u, v], axis=-1)


def _pieces(chart: Chart, curve: Curve) -> list[FloatArray]:
    """The curve's visible stretches: within the frame and finite."""
    points = _sheet(chart, curve.x, curve.y)
    inside = np.isfinite(points).all(axis=1)
    inside &= (points[:, 0] >= MARGIN[0] - 1e-6) & (points[:, 0] <= WIDTH - MARGIN[2] + 1e-6)
    inside &= (points[:, 1] >= MARGIN[1] - 1e-6) & (points[:, 1] <= chart.height - MARGIN[3] + 1e-6)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    return [points[a:b] for a, b in edges.reshape(-1, 2)]


def _dashes(pieces: Sequence[FloatArray], dash: float = 1.5) -> list[FloatArray]:
    """Straight stretches cut into dashes; curved ones into their odd segments."""
    out: list[FloatArray] = []
    for piece in pieces:
        count = max(1, int(np.abs(np.diff(piece, axis=0)).sum() / dash))
        along = np.linspace(0, len(piece) - 1, 2 * count)
        points = np.stack([np.interp(along, np.arange(len(piece)), piece[:, i]) for i in (0, 1)], axis=1)
        out += list(points.reshape(-1, 2, 2))
    return out


def _log_frame(rec: rr.RecordingStream, entity: str, chart: Chart) -> None:
    left, top, right, bottom = MARGIN
    low, high, base = left, WIDTH - right, chart.height - bottom
    xs = [_sheet(chart, np.array([t]), np.array([chart.y.low]))[0, 0] for t in chart.x.ticks()]
    ys = [_sheet(chart, np.array([chart.x.low]), np.array([t]))[0, 1] for t in chart.y.ticks()]
    grid = [[[x, top], [x, base]] for x in xs] + [[[low, y], [high, y]] for y in ys]
    frame = [[[low, top], [low, base], [high, base], [high, top], [low, top]]]
    thin = rr.Radius.ui_points(0.5)
    rec.log(f"{entity}/grid", rr.LineStrips2D(grid, colors=[GRID] * len(grid), radii=thin, draw_order=0.0), static=True)
    rec.log(f"{entity}/frame", rr.LineStrips2D(frame, colors=[FRAME], radii=thin, draw_order=5.0), static=True)
    below, beside = [(x, base - 0.5) for x in xs], [(low - 6.0, y - 2.5) for y in ys]
    write_texts(rec, f"{entity}/ticks_x", below, [chart.x.text(t) for t in chart.x.ticks()])
    write_texts(rec, f"{entity}/ticks_y", beside, [chart.y.text(t) for t in chart.y.ticks()])
    name = (WIDTH - 0.4 * right, base - 0.5) if chart.low else (0.5 * (low + high), chart.height - 6.5)
    labels = [name, (low + 0.5 * len(chart.y.label), 0.5)]
    write_texts(rec, f"{entity}/labels", labels, [chart.x.label, chart.y.label])


def _log_legend(rec: rr.RecordingStream, entity: str, chart: Chart) -> None:
    named = [curve for curve in chart.curves if curve.name]
    places = [(WIDTH - 0.5 * MARGIN[2], MARGIN[1] + 5.5 * row) for row in range(len(named))]
    if named:
        write_texts(rec, f"{entity}/legend", places, [c.name for c in named], [c.colour for c in named])


def key_view(entity: str, name: str, lines: int = 1) -> rrb.Spatial2DView:
    """The view of a key: so many rows of words."""
    bounds = rrb.VisualBounds2D(x_range=[0.0, WIDTH], y_range=[0.0, KEY_HEIGHT + KEY_LINE * (lines - 1)])
    return rrb.Spatial2DView(
        origin=entity, name=name, visual_bounds=bounds, background=rrb.Background(color=[22, 22, 26])
    )


def log_key(rec: rr.RecordingStream, entity: str, names: Sequence[tuple[str, Colour]], lines: int = 1) -> None:
    """What the colours of the lines mean, in words of those colours: a legend within a plot would hide its end."""
    places: list[tuple[float, float]] = []
    for line, row in enumerate(np.array_split(np.arange(len(names)), lines)):
        widths = np.array([KEY_LETTER * len(names[k][0]) + KEY_SPACE for k in row])
        widths *= min(1.0, WIDTH / max(float(widths.sum()), 1.0))
        places += [(float(x), KEY_LINE * line) for x in np.cumsum(widths) - 0.5 * widths]
    write_texts(rec, entity, places, [name for name, _ in names], [colour for _, colour in names])


def write_texts(
    rec: rr.RecordingStream,
    entity: str,
    places: Sequence[tuple[float, float]],
    texts: Sequence[str],
    colours: Sequence[Colour] = (TEXT,),
) -> None:
    """Words at places of the sheet, each just below its place and centred on it."""
    points = rr.Points2D(
        list(places),
        labels=list(texts),
        colors=list(colours) * (len(places) if len(colours) == 1 else 1),
        radii=rr.Radius.ui_points(0.01),
        show_labels=True,
        draw_order=50.0,
    )
    rec.log(entity, points, static=True)
