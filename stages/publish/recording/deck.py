"""Deck shape: curvature and torsion along the path, each run and all runs, limits, and the line they bend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from schemas.products import DeckPass, DeckShape
from schemas.rig import FloatArray
from stages.publish.axis import Axis, span_of
from stages.publish.deck_line import design_line, measured_line
from stages.publish.document import deck_text
from stages.publish.recording.chart import FRAME, Chart, Curve, chart_view, log_chart
from stages.publish.recording.scene import BLUE, GREEN, RED, Colour, Scene
from stages.publish.summary import intervals

CURVES = (("vertical", "Vertical curvature (about x)"), ("torsion", "Torsion (about y)"),
          ("horizontal", "Horizontal curvature (about z)"))  # fmt: skip
LINES = (("sideways", "sideways"), ("height", "upwards"))
UNIT = 1e-5  # rad/m, of the axis
RUN_COLOURS: tuple[Colour, ...] = (
    (100, 190, 140), (215, 165, 95), (175, 130, 225), (100, 190, 215), (225, 120, 165), (180, 205, 95),
)  # fmt: skip
BAND: Colour = (90, 120, 170)
MAX_RUNS_NAMED = 6
MAX_POINTS = 1500  # per run and curve


def log(rec: rr.RecordingStream, shape: DeckShape) -> None:
    """The curves, how far each run departs from them, and the bent line."""
    for axis, (name, _) in enumerate(CURVES):
        log_chart(rec, f"deck/{name}", curve_chart(shape, axis))
        log_chart(rec, f"deck/{name}_runs", runs_chart(shape, axis))
    for axis, (entity, _) in enumerate(LINES):
        log_chart(rec, f"deck/{entity}", line_chart(shape, axis))
    rec.log("deck/figures", rr.TextDocument(deck_text(shape), media_type=rr.MediaType.MARKDOWN), static=True)


def tab(scene: Scene) -> rrb.Container:
    """Curves above, the runs against them below, the line they bend and the figures at the foot."""
    curves = [chart_view(f"deck/{name}", f"{title} [1e-5 rad/m]") for name, title in CURVES]
    runs = [chart_view(f"deck/{name}_runs", f"Each run minus all, {name} [1e-5 rad/m]") for name, _ in CURVES]
    shape = scene.result.deck_shape
    against = "straight" if shape is None or shape.design is None else "design and straight"
    titles = [(entity, f"Deformed line against {against}, {way} [mm]") for entity, way in reversed(LINES)]
    lines = [chart_view(f"deck/{entity}", title) for entity, title in titles]
    figures = rrb.TextDocumentView(origin="deck/figures", name="Deck shape in figures")
    rows = (rrb.Horizontal(*curves), rrb.Horizontal(*runs), rrb.Horizontal(*lines, figures))
    return rrb.Vertical(*rows, name="Deck shape")


def runs_chart(shape: DeckShape, axis: int) -> Chart:
    """How far each run departs from all runs together, within their +-3 sigma."""
    s, k, sigma = shape.arc_length, shape.curvature[:, axis], shape.std[:, axis]
    curves = [Curve(s, sign * 3 * sigma, BAND, "±3σ, all" if sign > 0 else "", 1.0) for sign in (1, -1)]
    for run in shape.passes:
        curve = _run_curve(run, axis)
        curves.append(replace(curve, y=curve.y - np.interp(curve.x, s, k), width=1.0))
    low, high = span_of([curve.y for curve in curves])
    x = Axis(float(s[0]), float(s[-1]), "arc length [m]")
    return Chart(x, Axis(low, high, "run minus all [1e-5 rad/m]", scale=UNIT), curves)


def curve_chart(shape: DeckShape, axis: int) -> Chart:
    """Runs in quiet colours, all runs in blue with +-3 sigma, design and limits dashed, danger zones in red."""
    s, k, sigma = shape.arc_length, shape.curvature[:, axis], shape.std[:, axis]
    limit = float(shape.limit[axis])
    design = shape.design[:, axis] if shape.design is not None else np.zeros_like(k)
    shown = [k - 3 * sigma, k + 3 * sigma, design]
    curves = [_run_curve(run, axis) for run in shape.passes]
    curves += [Curve(s, k + sign * 3 * sigma, BAND, "all runs ±3σ" if sign > 0 else "", 1.0) for sign in (1, -1)]
    curves.append(Curve(s, k, BLUE, "all runs", 2.5))
    if shape.design is not None:
        curves.append(Curve(s, design, GREEN, "design", 1.5, dashed=True))
    if np.isfinite(limit):
        curves += [Curve(s, design + sign * limit, RED, "limit" if sign > 0 else "", 1.5, True) for sign in (1, -1)]
        shown += [design + 1.1 * limit, design - 1.1 * limit]
    low, high = span_of(shown)
    x = Axis(float(s[0]), float(s[-1]), "arc length [m]")
    zones = [(a, b) for a, b in intervals(s, shape.exceeds[:, axis])]
    return Chart(
        x, Axis(low, high, "curvature [1e-5 rad/m]" if axis != 1 else "torsion [1e-5 rad/m]", scale=UNIT), curves, zones
    )


def _run_curve(run: DeckPass, axis: int) -> Curve:
    """A run's samples averaged to at most MAX_POINTS places, so that the chart stays light."""
    s, k = averaged(run.arc_length, run.curvature[:, axis], MAX_POINTS)
    name = f"run {run.index}" if run.index < MAX_RUNS_NAMED else ""
    return Curve(s, k, RUN_COLOURS[run.index % len(RUN_COLOURS)], name, 0.7)


def averaged(s: FloatArray, k: FloatArray, points: int) -> tuple[FloatArray, FloatArray]:
    """Means of consecutive samples in order of s, at most ``points`` of them."""
    order = np.argsort(s, kind="stable")
    size = -(-len(s) // points)
    starts = np.arange(0, len(s), size)
    counts = np.diff(np.append(starts, len(s)))
    return np.add.reduceat(s[order], starts) / counts, np.add.reduceat(k[order], starts) / counts


def line_chart(shape: DeckShape, axis: int) -> Chart:
    """The line over its chord in mm, sideways (axis 0) or upwards (1); the design beside it where one is stated."""
    s, measured, design = shape.arc_length, 1e3 * measured_line(shape)[:, axis], design_line(shape)
    curves = [Curve(s, np.zeros_like(s), FRAME, "straight", 1.0, True)]
    if design is not None:
        curves.append(Curve(s, 1e3 * design[:, axis], GREEN, "design", 1.5, dashed=True))
    curves.append(Curve(s, measured, BLUE, "measured", 2.5))
    low, high = span_of([curve.y for curve in curves])
    label = "above the chord [mm]" if axis else "to starboard of the chord [mm]"
    over = shape.exceeds[:, (2, 0)[axis]]  # curvature about z bends sideways, about x upwards
    x = Axis(float(s[0]), float(s[-1]), "arc length [m]")
    return Chart(x, Axis(low, high, label), curves, [(a, b) for a, b in intervals(s, over)])
