"""Figures that are not curves: bars with their uncertainty, and maps of colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from schemas.rig import FloatArray
from stages.publish.axis import Axis, span_of
from stages.publish.page.figure import BLUE, WIDTH, drawing, swatch
from stages.publish.page.html import Html, join, tag

NAME_WIDTH = 220.0
ROW = 20.0
NOTE = 45.0  # room of a note
MOST_COLUMNS = 160  # of a map: wider ones are summed together
STOPS = np.array([(247, 248, 250), (253, 219, 150), (240, 130, 60), (170, 25, 45)], dtype=float)


@dataclass(frozen=True)
class Bar:
    """One row. error: half the length of its whisker. mark: where a threshold stands. note: beside the bar."""

    name: str
    value: float
    colour: str = BLUE
    error: float | None = None
    mark: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Bars:
    """Bars to the right of their names, on one axis. keys: (colour, name) of the legend.

    ticks: (place, what stands there), instead of round ones.
    """

    title: str
    label: str
    rows: Sequence[Bar]
    keys: Sequence[tuple[str, str]] = field(default_factory=tuple)
    limits: tuple[float, float] | None = None
    ticks: Sequence[tuple[float, str]] = field(default_factory=tuple)


def bars(one: Bars) -> Html:
    """The figure with its legend."""
    axis = Axis(*(one.limits or _limits(one.rows)), one.label)
    height = ROW * len(one.rows) + 38.0
    rows = [_bar(axis, row, ROW * k + 4.0) for k, row in enumerate(one.rows)]
    svg = drawing(one.title, WIDTH, height, _ruler(axis, ROW * len(one.rows) + 4.0, one.ticks), *rows)
    keys = [swatch(colour, name, True, 1.0) for colour, name in one.keys]
    return tag("figure", tag("figcaption", tag("strong", one.title), *keys), svg)


def _limits(rows: Sequence[Bar]) -> tuple[float, float]:
    ends = [r.value + (r.error or 0.0) for r in rows] + [r.mark for r in rows if r.mark is not None]
    low, high = span_of([np.array(ends, dtype=float)])
    return (0.0 if min(ends, default=0.0) >= 0 else low), high


def _at(axis: Axis, value: float) -> float:
    place = float(axis.place(np.array(min(max(value, axis.low), axis.high))))
    return NAME_WIDTH + place * (WIDTH - NAME_WIDTH - 90.0)


def _bar(axis: Axis, row: Bar, top: float) -> Html:
    """Name, bar from zero, whisker, threshold and note."""
    zero, end = _at(axis, 0.0), _at(axis, row.value) if np.isfinite(row.value) else _at(axis, 0.0)
    parts = [
        tag("text", row.name, x=NAME_WIDTH - 8, y=top + 12, class_="end"),
        tag("rect", x=f"{min(zero, end):.1f}", y=top + 3, width=f"{abs(end - zero):.1f}", height=12, fill=row.colour),
    ]
    right = end
    if row.error is not None and np.isfinite(row.error):
        a, right = _at(axis, row.value - row.error), _at(axis, row.value + row.error)
        parts.append(tag("path", d=f"M{a:.1f} {top + 9}H{right:.1f}M{a:.1f} {top + 5}v8M{right:.1f} {top + 5}v8",
                         class_="whisker"))  # fmt: skip
    if row.mark is not None:
        parts.append(tag("path", d=f"M{_at(axis, row.mark):.1f} {top}v18", class_="mark"))
    beyond = max(right, zero)
    if row.mark is not None and 0.0 < _at(axis, row.mark) - beyond < NOTE:
        beyond = _at(axis, row.mark)
    note = tag("text", row.note, x=f"{beyond + 5:.1f}", y=top + 12) if row.note else None
    return join([*parts, note])


def _ruler(axis: Axis, height: float, ticks: Sequence[tuple[float, str]]) -> Html:
    ticks = [t for t in ticks if axis.low <= t[0] <= axis.high] or [(t, axis.text(t)) for t in axis.ticks()]
    xs = [(_at(axis, t), shown) for t, shown in ticks]
    lines = tag("path", d="".join(f"M{x:.1f} 2v{height:g}" for x, _ in xs), class_="grid")
    texts = [tag("text", shown, x=f"{x:.1f}", y=height + 14, class_="mid") for x, shown in xs]
    middle = 0.5 * (_at(axis, axis.low) + _at(axis, axis.high))
    return join([lines, *texts, tag("text", axis.label, x=middle, y=height + 29, class_="mid label")])


@dataclass(frozen=True)
class HeatMap:
    """Values (rows, columns), NaN left white. columns: names at the columns' middles, thinned to what fits."""

    title: str
    rows: Sequence[str]
    columns: Sequence[str]
    values: FloatArray
    unit: str
    label: str = ""


def heat_map(one: HeatMap) -> Html:
    """The figure with a scale of its colours."""
    values, columns = _narrowed(one.values, one.columns)
    width = (WIDTH - NAME_WIDTH - 10.0) / max(len(columns), 1)
    top = float(np.nanmax(values)) if np.isfinite(values).any() else 1.0
    cells = [_cell(values[i, k], top, i, k, width) for i in range(len(one.rows)) for k in range(len(columns))]
    names = [tag("text", n, x=NAME_WIDTH - 8, y=ROW * i + 14, class_="end") for i, n in enumerate(one.rows)]
    base = ROW * len(one.rows)
    every = max(1, int(np.ceil(65.0 / width)))
    feet = [
        tag("text", n, x=f"{NAME_WIDTH + (k + 0.5) * width:.1f}", y=base + 14, class_="mid")
        for k, n in enumerate(columns) if k % every == 0
    ]  # fmt: skip
    below = tag("text", one.label, x=0.5 * (NAME_WIDTH + WIDTH), y=base + 29, class_="mid label")
    frame = tag("rect", x=NAME_WIDTH, y=0.5, width=WIDTH - NAME_WIDTH - 10, height=base, class_="frame")
    svg = drawing(one.title, WIDTH, base + 36, *cells, *names, *feet, below, frame)
    return tag("figure", tag("figcaption", tag("strong", one.title), *_scale(top, one.unit)), svg)


def _narrowed(values: FloatArray, columns: Sequence[str]) -> tuple[FloatArray, Sequence[str]]:
    """Neighbouring columns summed until there are at most MOST_COLUMNS."""
    size = -(-values.shape[1] // MOST_COLUMNS)
    if size <= 1:
        return values, columns
    starts = np.arange(0, values.shape[1], size)
    return np.add.reduceat(values, starts, axis=1), [columns[k] for k in starts]


def _cell(value: float, top: float, row: int, column: int, width: float) -> Html | None:
    if not np.isfinite(value) or value <= 0:
        return None
    x, y, shade = NAME_WIDTH + column * width, ROW * row, colour(value / top)
    return tag("rect", x=f"{x:.1f}", y=f"{y:g}", width=f"{width + 0.3:.1f}", height=f"{ROW:g}", fill=shade)


def colour(share: float) -> str:
    """From near white through orange to dark red, as ``#rrggbb``."""
    at = np.linspace(0.0, 1.0, len(STOPS))
    red, green, blue = (round(float(np.interp(share, at, STOPS[:, i]))) for i in range(3))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _scale(top: float, unit: str) -> list[Html]:
    steps = [
        swatch(colour(share), f"{share * top:.0f}" if top >= 100 else f"{share * top:.2g}", True, 1.0)
        for share in (0.25, 0.5, 0.75, 1.0)
    ]
    return [tag("span", f"in {unit}:"), *steps] if unit else steps
