"""A result as a Rerun recording, blueprint embedded: everything Rerun is behind these functions."""

from __future__ import annotations

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from schemas.products import Result
from schemas.trial import Trial, Truth
from stages.publish.recording import accuracy, deck, layout, overview, sensors, spectra
from stages.publish.recording.scene import SENSOR_RATE, Scene
from stages.publish.recording.stream import record


def write_recording(result: Result, trial: Trial, truth: Truth | None, path: Path, rate: float | None = None) -> None:
    """Write the recording of a run; it appears at path whole or not at all.

    rate: Hz to which everything is thinned; None leaves the estimates at full rate and the rest at 20 Hz, minimum
    and maximum kept. Times are both since the trial's epoch and UTC.
    """
    scene = Scene(result, trial, truth, SENSOR_RATE if rate is None else rate, rate)
    name = f"{Path(trial.source).name} {scene.deformation.estimator}"
    record(path, name, layout.blueprint(tabs(scene), layout.time_axis(scene)), lambda rec: _log(rec, scene))


def _log(rec: rr.RecordingStream, scene: Scene) -> None:
    overview.log(rec, scene)
    accuracy.log(rec, scene)
    if scene.result.deck_shape is not None:
        deck.log(rec, scene.result.deck_shape)
    sensors.log(rec, scene)
    spectra.log(rec, scene)


def tabs(scene: Scene) -> list[rrb.Container]:
    """Overview first; the deck's shape where there is one."""
    shape = [deck.tab(scene)] if scene.result.deck_shape is not None else []
    return [overview.tab(scene), accuracy.tab(scene), *shape, sensors.tab(scene), spectra.tab(scene)]
