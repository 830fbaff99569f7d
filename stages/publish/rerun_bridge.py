"""A result as a Rerun recording, blueprint embedded: everything Rerun is behind these functions."""

from __future__ import annotations

from pathlib import Path

import rerun.blueprint as rrb

from schemas.products import Result
from schemas.trial import Trial, Truth
from stages.publish.recording import accuracy, deck, layout, overview, sensors, spectra
from stages.publish.recording.scene import SENSOR_RATE, Scene
from stages.publish.recording.stream import TRIAL, open_recording


def write_recording(result: Result, trial: Trial, truth: Truth | None, path: Path, rate: float | None = None) -> None:
    """Write the recording of a run; it appears at path whole or not at all.

    rate: Hz to which everything is thinned; None leaves the estimates at full rate and the rest at 20 Hz, minimum
    and maximum kept. Times are both since the trial's epoch and UTC.
    """
    scene = Scene(result, trial, truth, SENSOR_RATE if rate is None else rate, rate)
    partial = path.with_name(f".{path.name}.partial")
    try:
        _write(scene, partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _write(scene: Scene, path: Path) -> None:
    name = f"{Path(scene.trial.source).name} {scene.deformation.estimator}"
    recording = open_recording(path, blueprint(scene), name)
    recording.send_recording_name(name)
    overview.log(recording, scene)
    accuracy.log(recording, scene)
    if scene.result.deck_shape is not None:
        deck.log(recording, scene.result.deck_shape)
    sensors.log(recording, scene)
    spectra.log(recording, scene)
    recording.flush()
    recording.disconnect()


def blueprint(scene: Scene) -> rrb.Blueprint:
    """Tabs, overview first; paused at the start, time panel small."""
    tabs = [overview.tab(scene), accuracy.tab(scene)]
    if scene.result.deck_shape is not None:
        tabs.append(deck.tab(scene))
    tabs += [sensors.tab(scene), spectra.tab(scene)]
    root = layout.LinkedTabs(*tabs, axis=layout.time_axis(scene))
    layout.fix_ids(root)
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TRIAL, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )
