"""Bars and maps of colour, drawn in a 2D view: Rerun's own bar chart knows no names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.rig import FloatArray
from stages.publish.axis import Axis, span_of
from stages.publish.recording.chart import GRID, TEXT, WIDTH, write_texts
from stages.publish.recording.scene import RED, Colour

NAMES = 52.0  # sheet units for the names on the left
RIGHT = 18.0
ROW = 7.0
FOOT = 14.0
HALF_BAR = 1.7
LETTER = 1.2  # half the room of a letter beside a bar
BACKGROUND: Colour = (22, 22, 26)
STOPS = np.array([(34, 36, 46), (60, 80, 150), (90, 190, 170), (240, 210, 80), (220, 50, 40)], dtype=float)
TOP_PIXELS = 12  # left free above a map
PIXELS = 8  # of a map's picture per sheet unit


@dataclass(frozen=True)
class Row:
    """A bar: value and, beside it, note. error: half its whisker. mark: where a threshold stands."""

    name: str
    value: float
    colour: Colour
    error: float | None = None
    mark: float | None = None
    note: str = ""


def bars_height(rows: int) -> float:
    """Height of the sheet of so many bars."""
    return ROW * max(rows, 1) + FOOT


def sheet_view(entity: str, name: str, height: float) -> rrb.Spatial2DView:
    """The view of a sheet, all of it in sight."""
    bounds = rrb.VisualBounds2D(x_range=[0.0, WIDTH], y_range=[0.0, height])
    back = rrb.Background(color=list(BACKGROUND))
    return rrb.Spatial2DView(origin=entity, name=name, visual_bounds=bounds, background=back)


def log_bars(
    rec: rr.RecordingStream,
    entity: str,
    rows: Sequence[Row],
    label: str,
    limits: tuple[float, float] | None = None,
    ticks: Sequence[tuple[float, str]] = (),
) -> None:
    """Bars to the right of their names over one axis; ticks (place, text) instead of round ones."""
    axis = Axis(*(limits or _limits(rows)), label)
    foot = ROW * len(rows) + 1.0
    shown = [t for t in ticks if axis.low <= t[0] <= axis.high] or [(t, axis.text(t)) for t in axis.ticks()]
    _log_ruler(rec, entity, axis, foot, shown)
    middles = [ROW * (k + 0.5) + 1.0 for k in range(len(rows))]
    _log_strips(rec, f"{entity}/bars", axis, rows, middles)
    _log_whiskers(rec, entity, axis, rows, middles)
    write_texts(rec, f"{entity}/names", [(0.5 * NAMES, y - 2.0) for y in middles], [row.name for row in rows])
    notes = [(row, _right(axis, row), y) for row, y in zip(rows, middles) if row.note]
    beside = [(x + 2.0 + 0.5 * _room(row), y - 2.0) for row, x, y in notes]
    write_texts(rec, f"{entity}/notes", beside, [row.note for row, _, _ in notes])


def _log_strips(
    rec: rr.RecordingStream, entity: str, axis: Axis, rows: Sequence[Row], middles: Sequence[float]
) -> None:
    """Bars from zero to their values; a strip's round ends reach beyond it, so it is shorter by their radius."""
    zero = _at(axis, 0.0)
    ends = [_at(axis, row.value) for row in rows]
    radii = [min(HALF_BAR, 0.5 * abs(end - zero)) for end in ends]
    inset = [radius * (1.0 if end >= zero else -1.0) for end, radius in zip(ends, radii)]
    strips = [[[zero + d, y], [end - d, y]] for end, d, y in zip(ends, inset, middles)]
    colours = [row.colour for row in rows]
    rec.log(entity, rr.LineStrips2D(strips, colors=colours, radii=radii, draw_order=10.0), static=True)


def _limits(rows: Sequence[Row]) -> tuple[float, float]:
    ends = [row.value + (row.error or 0.0) for row in rows] + [row.mark for row in rows if row.mark is not None]
    low, high = span_of([np.array(ends, dtype=float)])
    return (0.0 if min(ends, default=0.0) >= 0 else low), high


def _at(axis: Axis, value: float) -> float:
    value = min(max(value if np.isfinite(value) else 0.0, axis.low), axis.high)
    return NAMES + float(axis.place(np.array(value))) * (WIDTH - NAMES - RIGHT)


def _right(axis: Axis, row: Row) -> float:
    """Where the bar ends, its whisker too, and a mark that its note would cover."""
    end = max(_at(axis, row.value + (row.error or 0.0)), _at(axis, 0.0))
    mark = end if row.mark is None else _at(axis, row.mark)
    return mark if 0.0 < mark - end < 2.0 + _room(row) else end


def _room(row: Row) -> float:
    """Width of a row's note."""
    return 2.0 * LETTER * max(len(row.note), 4)


def _log_ruler(
    rec: rr.RecordingStream, entity: str, axis: Axis, foot: float, ticks: Sequence[tuple[float, str]]
) -> None:
    xs = [_at(axis, t) for t, _ in ticks]
    grid = [[[x, 0.0], [x, foot]] for x in xs]
    thin = rr.Radius.ui_points(0.5)
    rec.log(f"{entity}/grid", rr.LineStrips2D(grid, colors=[GRID] * len(grid), radii=thin, draw_order=0.0), static=True)
    write_texts(rec, f"{entity}/ticks", [(x, foot) for x in xs], [shown for _, shown in ticks])
    write_texts(rec, f"{entity}/label", [(0.5 * (NAMES + WIDTH - RIGHT), foot + 5.5)], [axis.label])


def _log_whiskers(
    rec: rr.RecordingStream, entity: str, axis: Axis, rows: Sequence[Row], middles: Sequence[float]
) -> None:
    whiskers = [
        [[_at(axis, row.value - row.error), y], [_at(axis, row.value + row.error), y]]
        for row, y in zip(rows, middles)
        if row.error is not None and np.isfinite(row.error)
    ]
    marks = [
        [[_at(axis, row.mark), y - 3.0], [_at(axis, row.mark), y + 3.0]]
        for row, y in zip(rows, middles)
        if row.mark is not None
    ]
    for name, strips, colour in (("whiskers", whiskers, TEXT), ("marks", marks, RED)):
        if strips:
            drawn = rr.LineStrips2D(
                strips, colors=[colour] * len(strips), radii=rr.Radius.ui_points(1.2), draw_order=20
            )
            rec.log(f"{entity}/{name}", drawn, static=True)


def log_map(
    rec: rr.RecordingStream,
    entity: str,
    values: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    label: str,
    height: float,
) -> None:
    """Values (rows, columns) as colours between names, each cell as large as the sheet allows."""
    rec.log(f"{entity}/cells", rr.Image(_picture(values, height)), static=True)
    scale, across = float(PIXELS), (WIDTH - NAMES - 2.0) / max(len(columns), 1)
    down = (height - FOOT) / max(len(rows), 1)
    names = [(0.5 * NAMES * scale, ((k + 0.5) * down - 2.0) * scale + TOP_PIXELS) for k in range(len(rows))]
    write_texts(rec, f"{entity}/names", names, rows)
    every = max(1, round(16.0 / across))
    feet = [
        ((NAMES + (k + 0.5) * across) * scale, (height - FOOT) * scale + TOP_PIXELS)
        for k in range(0, len(columns), every)
    ]
    write_texts(rec, f"{entity}/ticks", feet, list(columns)[::every])
    middle = 0.5 * (NAMES + WIDTH)
    write_texts(rec, f"{entity}/label", [(middle * scale, (height - FOOT + 6.0) * scale + TOP_PIXELS)], [label])


def map_view(entity: str, name: str, height: float) -> rrb.Spatial2DView:
    """The view of a map of colours."""
    bounds = rrb.VisualBounds2D(x_range=[0.0, WIDTH * PIXELS], y_range=[0.0, height * PIXELS])
    back = rrb.Background(color=list(BACKGROUND))
    return rrb.Spatial2DView(origin=entity, name=name, visual_bounds=bounds, background=back)


def _picture(values: FloatArray, height: float) -> np.ndarray:
    """The sheet as a picture (rows, columns, 3), cells in colour, all else background."""
    picture = np.full((int(height * PIXELS), int(WIDTH * PIXELS), 3), BACKGROUND, dtype=np.uint8)
    top = float(np.nanmax(values)) if np.isfinite(values).any() else 0.0
    share = np.nan_to_num(np.clip(values / (top or 1.0), 0.0, 1.0))
    colours = np.stack([np.interp(share, np.linspace(0, 1, len(STOPS)), STOPS[:, i]) for i in range(3)], axis=2)
    across, down = int((WIDTH - NAMES - 2.0) * PIXELS), int((height - FOOT) * PIXELS)
    column = np.arange(across) * values.shape[1] // across
    row = np.arange(down) * values.shape[0] // down
    left = int(NAMES * PIXELS)
    picture[TOP_PIXELS : TOP_PIXELS + down, left : left + across] = colours[row][:, column].astype(np.uint8)
    return picture
