"""Comparison: several estimators of one trial overlaid, their errors beside, their RMSE in a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from physics.units import ARCMIN
from schemas.products import Result
from schemas.trial import Trial, Truth
from stages.publish.document import number, table
from stages.publish.recording import layout
from stages.publish.recording.overview import of_axis
from stages.publish.recording.scene import (
    AXES,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    RED,
    REFERENCE_NAMES,
    SENSOR_RATE,
    Colour,
    Scene,
    stride,
)
from stages.publish.recording.stream import record, send_axes, thin_extremes

COLOURS: tuple[Colour, ...] = (BLUE, ORANGE, GREEN, PURPLE, RED, (90, 190, 190), (225, 200, 100))


def write_comparison(
    results: Sequence[Result], trial: Trial, truth: Truth | None, path: Path, rate: float | None = None
) -> None:
    """Write the recording of several estimators on one trial; everything is thinned to rate Hz (default 20)."""
    scenes = [Scene(result, trial, truth, rate or SENSOR_RATE, rate or SENSOR_RATE) for result in results]
    name = f"{Path(trial.source).name} {' '.join(scene.deformation.estimator for scene in scenes)}"
    record(path, name, layout.blueprint([tab(scenes)], layout.time_axis(scenes[0])), lambda rec: _log(rec, scenes))


def _log(rec: rr.RecordingStream, scenes: Sequence[Scene]) -> None:
    for index, scene in enumerate(scenes):
        _log_estimator(rec, scene, COLOURS[index % len(COLOURS)])
    text = rmse_text([scene.result for scene in scenes])
    rec.log("rmse", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def tab(scenes: Sequence[Scene]) -> rrb.Container:
    """Per axis all estimates and all errors, and the table."""
    rows = [rrb.Horizontal(*_axis_views(scenes, axis)) for axis in range(3)]
    side = rrb.TextDocumentView(origin="rmse", name="RMSE")
    return rrb.Horizontal(rrb.Vertical(*rows), side, column_shares=[3.0, 1.0], name="Comparison")


def rmse_text(results: Sequence[Result]) -> str:
    """Markdown: RMSE per axis in arcminutes, a row per estimator and reference."""
    rows = [
        [score.estimator, REFERENCE_NAMES[score.reference], *(number(value / ARCMIN) for value in score.rmse)]
        for result in results
        for score in result.scores
    ]
    header = ["estimator", "reference", *(f"{axis} [arcmin]" for axis in AXES)]
    return "# RMSE of the total angle\n\n" + (table(header, rows) if rows else "The log holds no reference.")


def _axis_views(scenes: Sequence[Scene], axis: int) -> list[rrb.TimeSeriesView]:
    """The estimates of one axis and, where there is a reference, their errors against the first one."""
    names = [scene.deformation.estimator for scene in scenes]
    estimates = of_axis([f"deformation/{name}" for name in names], axis)
    views = [layout.time_view(scenes[0], f"Deformation {AXES[axis]} [arcmin]", estimates)]
    if scenes[0].scores:
        reference = REFERENCE_NAMES[scenes[0].scores[0].reference]
        errors = of_axis([f"error/{name}" for name in names], axis)
        views.append(layout.time_view(scenes[0], f"Error {AXES[axis]} against {reference} [arcmin]", errors))
    return views


def _log_estimator(rec: rr.RecordingStream, scene: Scene, colour: Colour) -> None:
    d, name = scene.deformation, scene.deformation.estimator
    stamp, total = thin_extremes(d.stamp, d.total / ARCMIN, stride(d.stamp, scene.rate))
    send_axes(rec, f"deformation/{name}", stamp, scene.trial.epoch, total, name, colour)
    for score in scene.scores[:1]:
        stamp, error = thin_extremes(score.stamp, score.error / ARCMIN, stride(score.stamp, scene.rate))
        send_axes(rec, f"error/{name}", stamp, scene.trial.epoch, error, name, colour)
