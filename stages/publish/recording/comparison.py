"""Comparison: several estimators of one trial overlaid, their errors beside, their RMSE as bars and in a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from physics.units import ARCMIN
from schemas.products import Result, Score
from schemas.rig import FloatArray
from schemas.trial import Trial, Truth
from stages.publish.axis import span_of
from stages.publish.document import number, plain_markdown, table
from stages.publish.recording import layout
from stages.publish.recording.chart import log_key
from stages.publish.recording.overview import KEY_SHARE, key, of_axis
from stages.publish.recording.scene import (
    AXES,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    REFERENCE_NAMES,
    SENSOR_RATE,
    Colour,
    Scene,
    stride,
)
from stages.publish.recording.sheet import Row, bars_height, log_bars, sheet_view
from stages.publish.recording.stream import record, send_axes, thin_extremes
from stages.publish.reference import reference_angles
from stages.publish.verdict import closest

RARE = (2.0, 98.0)  # percentiles
COLOURS: tuple[Colour, ...] = (BLUE, ORANGE, GREEN, PURPLE, RED, (90, 190, 190), (225, 200, 100))


def write_comparison(
    results: Sequence[Result], trial: Trial, truth: Truth | None, path: Path, rate: float | None = None
) -> None:
    """Write the recording of several estimators on one trial; everything is thinned to rate Hz (default 20)."""
    scenes = [Scene(result, trial, truth, rate or SENSOR_RATE, rate or SENSOR_RATE) for result in results]
    name = f"{Path(trial.source).name} {' '.join(scene.deformation.estimator for scene in scenes)}"
    record(path, name, layout.blueprint(tabs(scenes), layout.time_axis(scenes[0])), lambda rec: _log(rec, scenes))


def _log(rec: rr.RecordingStream, scenes: Sequence[Scene]) -> None:
    _log_reference(rec, scenes[0])
    named = [(REFERENCE_NAMES[score.reference], GREY) for score in scenes[0].scores[:1]]
    log_key(rec, "key", [*named, *((s.deformation.estimator, colour_of(i)) for i, s in enumerate(scenes))])
    for index, scene in enumerate(scenes):
        _log_estimator(rec, scene, colour_of(index))
    for axis, name in enumerate("xyz"):
        rows = rmse_rows(scenes, axis)
        if rows:
            log_bars(rec, f"bars/{name}", rows, "RMSE [arcmin]; red: expected by its covariance")
    text = rmse_text([scene.result for scene in scenes])
    rec.log("rmse", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def colour_of(index: int) -> Colour:
    """The same colour for an estimator in every view."""
    return COLOURS[index % len(COLOURS)]


def tabs(scenes: Sequence[Scene]) -> list[rrb.Container]:
    """Per axis all estimates and all errors with the table beside; RMSE as bars where there is a reference."""
    rows = [rrb.Horizontal(*_axis_views(scenes, axis)) for axis in range(3)]
    side = rrb.TextDocumentView(origin="rmse", name="In figures")
    left = rrb.Vertical(key(), *rows, row_shares=[KEY_SHARE, 3.0, 3.0, 3.0])
    curves = rrb.Horizontal(left, side, column_shares=[2.5, 1.0], name="Comparison")
    if not scenes[0].scores:
        return [curves]
    height = bars_height(max(len(scenes), 4))
    bars = [sheet_view(f"bars/{n}", f"RMSE {axis} [arcmin]", height) for n, axis in zip("xyz", AXES)]
    return [curves, rrb.Vertical(*bars, name="RMSE")]


def rmse_rows(scenes: Sequence[Scene], axis: int) -> list[Row]:
    """A bar for each estimator against the first reference, marked where its own covariance expects it."""
    return [
        Row(
            scene.deformation.estimator,
            float(score.rmse[axis]) / ARCMIN,
            colour_of(index),
            mark=_expected(score, axis),
            note=number(float(score.rmse[axis]) / ARCMIN),
        )
        for index, scene in enumerate(scenes)
        for score in scene.scores[:1]
    ]


def _expected(score: Score, axis: int) -> float | None:
    allowed = float(np.hypot(score.predicted[axis], score.reference_noise[axis])) / ARCMIN
    return allowed if np.isfinite(allowed) else None


def rmse_text(results: Sequence[Result]) -> str:
    """Markdown: which came closest; RMSE per axis in arcminutes, a row per estimator and reference, and what its
    covariance and the reference's noise let expect."""
    found = closest(results)
    if found is None:
        return "# RMSE of the total angle\n\nThe log holds no reference."
    rows = [
        [score.estimator, REFERENCE_NAMES[score.reference], *(_measured_and_expected(score, axis) for axis in range(3))]
        for result in results
        for score in result.scores
    ]
    header = ["estimator", "reference", "x [′]", "y [′]", "z [′]"]
    about = "RMSE of the total angle, in brackets what the estimator's covariance and the reference's noise let expect."
    return f"# {plain_markdown(found[1])}\n\n{about}\n\n{table(header, rows)}"


def _measured_and_expected(score: Score, axis: int) -> str:
    return f"{number(float(score.rmse[axis]) / ARCMIN)} ({number(_expected(score, axis))})"


def _axis_views(scenes: Sequence[Scene], axis: int) -> list[rrb.View]:
    """The estimates of one axis and, where there is a reference, errors against the first one."""
    names = [scene.deformation.estimator for scene in scenes]
    over = [f"deformation/{score.reference}" for score in scenes[0].scores[:1]]
    entities = of_axis([*over, *(f"deformation/{name}" for name in names)], axis)
    title = f"Deformation {AXES[axis]} [arcmin]"
    limits = usual_range([scene.deformation.total[:, axis] / ARCMIN for scene in scenes])
    views: list[rrb.View] = [layout.time_view(scenes[0], title, entities, limits)]
    if scenes[0].scores:
        title = f"Error {AXES[axis]} against {REFERENCE_NAMES[scenes[0].scores[0].reference]} [arcmin]"
        entities = of_axis([f"error/{name}" for name in names], axis)
        limits = usual_range([s.error[:, axis] / ARCMIN for scene in scenes for s in scene.scores[:1]])
        views.append(layout.time_view(scenes[0], title, entities, limits))
    return views


def usual_range(values: Sequence[FloatArray]) -> tuple[float, float]:
    """Limits that hold all but the rarest of each curve: how a filter starts shall not flatten all the rest."""
    known = [curve[np.isfinite(curve)] for curve in values]
    ends = [np.percentile(curve, RARE) for curve in known if len(curve)]
    return span_of(ends, margin=0.15, zero=False)


def _log_reference(rec: rr.RecordingStream, scene: Scene) -> None:
    """The first reference in grey."""
    for score in scene.scores[:1]:
        stamp, total = reference_angles(scene.deformation, score, stride(score.stamp, scene.rate))
        name = REFERENCE_NAMES[score.reference]
        send_axes(rec, f"deformation/{score.reference}", stamp, scene.trial.epoch, total / ARCMIN, name, GREY, 1.2)


def _log_estimator(rec: rr.RecordingStream, scene: Scene, colour: Colour) -> None:
    d, name = scene.deformation, scene.deformation.estimator
    stamp, total = thin_extremes(d.stamp, d.total, stride(d.stamp, scene.rate))
    send_axes(rec, f"deformation/{name}", stamp, scene.trial.epoch, total / ARCMIN, name, colour)
    for score in scene.scores[:1]:
        stamp, error = thin_extremes(score.stamp, score.error, stride(score.stamp, scene.rate))
        send_axes(rec, f"error/{name}", stamp, scene.trial.epoch, error / ARCMIN, name, colour)
