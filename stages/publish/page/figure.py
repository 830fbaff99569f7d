"""Figures as SVG: lines with bands over an axis, bars, maps of colour. Points are bounded, extremes are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from schemas.rig import FloatArray
from stages.publish.axis import Axis
from stages.publish.page.html import Html, join, tag

WIDTH = 720.0
LEFT, RIGHT, TOP, BOTTOM = 58.0, 10.0, 20.0, 38.0
LETTER = 6.0  # width of a digit below a figure
BUCKETS = 600  # of a line: no more than this many pairs of minimum and maximum are drawn
BLUE, GREEN, ORANGE, RED, GREY = "#1f6fbf", "#1d8a4b", "#d97a1e", "#c0352f", "#8a8f98"
PURPLE, TEAL, YELLOW = "#7d4fb0", "#178a94", "#a98600"
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, RED, TEAL, YELLOW, GREY)


@dataclass(frozen=True)
class Line:
    """A curve through x, y (n,), in data units; NaN breaks it, and so does a step of x longer than ``breaks``."""

    x: FloatArray
    y: FloatArray
    colour: str
    name: str = ""
    width: float = 1.3
    dashed: bool = False
    opacity: float = 1.0
    breaks: float = np.inf


@dataclass(frozen=True)
class Band:
    """The area between low and high (n,) over x; NaN breaks it."""

    x: FloatArray
    low: FloatArray
    high: FloatArray
    colour: str
    name: str = ""
    breaks: float = np.inf


@dataclass(frozen=True)
class Points:
    """Values y with their standard deviation std (n,) at x, as dots with whiskers of one sigma."""

    x: FloatArray
    y: FloatArray
    std: FloatArray
    colour: str
    name: str = ""


@dataclass(frozen=True)
class Plot:
    """Everything in one frame. zones: (x0, x1) stretches marked in red. alt: the figure in words."""

    title: str
    x: Axis
    y: Axis
    parts: Sequence[Line | Band | Points]
    zones: Sequence[tuple[float, float]] = field(default_factory=tuple)
    height: float = 210.0
    width: float = WIDTH
    zone_name: str = ""


def plot(one: Plot) -> Html:
    """The figure with its legend, ready for the page."""
    seen = [zone for zone in one.zones if zone[1] > one.x.low and zone[0] < one.x.high]
    one = replace(one, zones=seen)
    inner = tag("svg", _zones(one), *(_part(one, part) for part in one.parts), **_inner_frame(one))
    return tag("figure", _legend(one), drawing(one.title, one.width, one.height, _grid(one), inner, _frame(one)))


def plots(several: Sequence[Plot]) -> Html:
    """Figures beside each other as far as the page is wide."""
    return tag("div", *(plot(one) for one in several), class_="row")


def extremes(x: FloatArray, y: FloatArray, buckets: int = BUCKETS) -> tuple[FloatArray, FloatArray]:
    """At most two points a bucket, its minimum and maximum in their order; a bucket with NaN in it keeps one NaN."""
    n = len(x)
    if n <= 2 * buckets:
        return x, y
    edges = np.linspace(0, n, buckets + 1).astype(int)
    index: list[int] = []
    for a, b in pairwise(edges):
        part = y[a:b]
        bad = np.flatnonzero(~np.isfinite(part))
        good = np.flatnonzero(np.isfinite(part))
        picks = {int(good[part[good].argmin()]), int(good[part[good].argmax()])} if len(good) else set()
        index += sorted(a + k for k in picks | ({int(bad[0])} if len(bad) else set()))
    return x[index], y[index]


def envelope(x: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A band thinned to a bucket each, its lowest low and highest high; none holds both sides of what is unknown."""
    n = len(x)
    if n <= BUCKETS:
        return x, low, high
    unknown = ~np.isfinite(low + high)
    turns = np.flatnonzero(np.diff(unknown.astype(int))) + 1
    edges = np.union1d(np.linspace(0, n, BUCKETS + 1).astype(int)[:-1], turns)
    with np.errstate(invalid="ignore"):
        return x[edges], np.fmin.reduceat(low, edges), np.fmax.reduceat(high, edges)


def broken(x: FloatArray, breaks: float, *values: FloatArray) -> tuple[FloatArray, ...]:
    """x and values with a NaN after every step of x longer than ``breaks``."""
    gaps = np.flatnonzero(np.diff(x) > breaks) if np.isfinite(breaks) else np.zeros(0, int)
    middle = x[gaps] + 0.5 * breaks if len(gaps) else np.zeros(0)
    return np.insert(x, gaps + 1, middle), *(np.insert(v, gaps + 1, np.nan) for v in values)


def drawing(title: str, width: float, height: float, *parts: object) -> Html:
    """An SVG of that size in its own units, as wide as the page allows; the title is for readers by ear."""
    box = {"viewBox": f"0 0 {width:g} {height:g}", "role": "img", "aria_label": title}
    return tag("svg", tag("title", title), *parts, **box)


def _inner_frame(one: Plot) -> dict[str, object]:
    """A nested drawing the size of the frame: what leaves the axes' limits is cut there."""
    w, h = one.width - LEFT - RIGHT, one.height - TOP - BOTTOM
    return {"x": f"{LEFT:g}", "y": f"{TOP:g}", "width": f"{w:g}", "height": f"{h:g}", "viewBox": f"0 0 {w:g} {h:g}"}


def _xy(one: Plot, x: FloatArray, y: FloatArray) -> FloatArray:
    """Places (n, 2) within the frame, y downwards, far-off ones brought near so that numbers stay short."""
    w, h = one.width - LEFT - RIGHT, one.height - TOP - BOTTOM
    u = one.x.place(np.asarray(x, float)) * w
    v = (1.0 - one.y.place(np.asarray(y, float))) * h
    return np.stack([np.clip(u, -w, 2 * w), np.clip(v, -h, 2 * h)], axis=1)


def _part(one: Plot, part: Line | Band | Points) -> Html:
    if isinstance(part, Points):
        return _points(one, part)
    return _line(one, part) if isinstance(part, Line) else _band(one, part)


def _points(one: Plot, points: Points) -> Html:
    good = np.isfinite(points.x) & np.isfinite(points.y)
    x, y, std = points.x[good], points.y[good], points.std[good]
    places, low, high = _xy(one, x, y), _xy(one, x, y - std), _xy(one, x, y + std)
    whiskers = "".join(f"M{u:.1f} {a:.1f}V{b:.1f}" for (u, a), b in zip(low, high[:, 1]))
    dots = [tag("circle", cx=f"{u:.1f}", cy=f"{v:.1f}", r=2.6, fill=points.colour) for u, v in places]
    return join([tag("path", d=whiskers, stroke=points.colour, stroke_width=1, fill="none"), *dots])


def _line(one: Plot, line: Line) -> Html:
    x, y = broken(line.x, line.breaks, line.y)
    x, y = extremes(x, y)
    points = _xy(one, x, y)
    d = "".join(_path(points[run]) for run in finite_runs(points))
    dash = "5 3" if line.dashed else None
    faint = line.opacity if line.opacity < 1 else None
    style = {"stroke_width": line.width, "stroke_dasharray": dash, "stroke_opacity": faint}
    return tag("path", d=d, fill="none", stroke=line.colour, **style)


def _band(one: Plot, band: Band) -> Html:
    x, low, high = broken(band.x, band.breaks, band.low, band.high)
    x, low, high = envelope(x, low, high)
    below, above = _xy(one, x, low), _xy(one, x, high)
    runs = finite_runs(below + above)
    d = "".join(_path(np.vstack([above[run], below[run][::-1]])) + "Z" for run in runs)
    return tag("path", d=d, fill=band.colour, fill_opacity=0.22, stroke="none")


def finite_runs(points: FloatArray) -> list[slice]:
    """The stretches of points (n, 2) that are finite."""
    good = np.asarray(np.isfinite(points).all(axis=1))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _path(points: FloatArray) -> str:
    """``Mx y L x y ...`` to a tenth of a unit; a lone point becomes a dot."""
    if len(points) == 1:
        points = np.vstack([points, points + np.array([0.6, 0.0])])
    words = [f"{x:.1f} {y:.1f}" for x, y in points]
    return f"M{words[0]}L" + " ".join(words[1:])


def _grid(one: Plot) -> Html:
    w, h = one.width - LEFT - RIGHT, one.height - TOP - BOTTOM
    across = [LEFT + float(one.x.place(np.array(t))) * w for t in one.x.ticks()]
    down = [TOP + (1 - float(one.y.place(np.array(t)))) * h for t in one.y.ticks()]
    d = "".join(f"M{x:.1f} {TOP:g}v{h:g}" for x in across) + "".join(f"M{LEFT:g} {y:.1f}h{w:g}" for y in down)
    words = [one.x.text(t) for t in one.x.ticks()]
    inside = [min(x, one.width - 0.5 * LETTER * len(word)) for x, word in zip(across, words)]
    below = [tag("text", word, x=f"{x:.1f}", y=f"{TOP + h + 13:g}", class_="mid") for x, word in zip(inside, words)]
    beside = [
        tag("text", one.y.text(t), x=f"{LEFT - 5:g}", y=f"{y + 3.5:.1f}", class_="end")
        for y, t in zip(down, one.y.ticks())
    ]
    return join([tag("path", d=d, class_="grid"), *below, *beside])


def _frame(one: Plot) -> Html:
    w, h = one.width - LEFT - RIGHT, one.height - TOP - BOTTOM
    return join(
        [
            tag("rect", x=LEFT, y=TOP, width=w, height=h, class_="frame"),
            tag("text", one.x.label, x=LEFT + 0.5 * w, y=one.height - 7, class_="mid label"),
            tag("text", one.y.label, x=6, y=TOP - 8, class_="label"),
        ]
    )


def _zones(one: Plot) -> Html:
    w, h = one.width - LEFT - RIGHT, one.height - TOP - BOTTOM
    ends = [[float(one.x.place(np.array(x))) * w for x in zone] for zone in one.zones]
    return join(
        tag("rect", x=f"{a:.1f}", y=0, width=f"{max(b - a, 1.5):.1f}", height=h, class_="zone") for a, b in ends
    )


def _legend(one: Plot) -> Html:
    """Title, and what each colour is."""
    keys = [swatch(part.colour, part.name, isinstance(part, Band)) for part in one.parts if part.name]
    keys += [swatch(RED, one.zone_name, True)] if one.zones and one.zone_name else []
    return tag("figcaption", tag("strong", one.title), *keys)


def swatch(colour: str, name: str, area: bool = False, opacity: float = 0.3) -> Html:
    """A key of the legend: a stroke or an area of that colour, and its name."""
    mark = (
        tag("rect", x=0, y=1, width=16, height=8, fill=colour, fill_opacity=opacity)
        if area
        else tag("path", d="M0 5h16", stroke=colour, stroke_width=2.2)
    )
    return tag("span", tag("svg", mark, viewBox="0 0 16 10", class_="key", aria_hidden="true"), name)
