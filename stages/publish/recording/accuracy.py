"""Accuracy: is the estimate as good as it says? Error within its band, innovations, coverage, budget, gaps."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from physics.interpolation import gap_starts
from physics.units import ARCMIN
from schemas.products import Innovations
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.publish.document import accuracy_text
from stages.publish.recording import layout
from stages.publish.recording.overview import error_view
from stages.publish.recording.scene import (
    AXES,
    AXIS_COLOURS,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    REFERENCE_NAMES,
    SLOW_RATE,
    Colour,
    Scene,
    channel_stamps,
    stride,
)
from stages.publish.recording.stream import send_lines, send_states

WINDOW = 60.0  # s, of the RMS over time
DATA, GAP, STILL, MOVING = "data", "gap", "lying still", "under way"
LANE_COLOURS: dict[str, Colour] = {DATA: GREEN, GAP: (214, 60, 60), STILL: BLUE, MOVING: GREY}
DIM_COLOURS: tuple[Colour, ...] = ((140, 70, 68), (70, 120, 70), (66, 92, 145))
PALETTE: tuple[Colour, ...] = (*AXIS_COLOURS, ORANGE, (170, 110, 210), (90, 190, 190))


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Innovations, RMS per minute, lanes, and the table."""
    innovations = scene.deformation.innovations
    if innovations is not None and len(innovations.t):
        _log_innovations(rec, scene, innovations)
    for score in scene.scores[:1]:
        stamp, rms = windowed_rms(score.stamp, score.error, WINDOW)
        names = [f"{REFERENCE_NAMES[score.reference]} {axis}" for axis in AXES]
        send_lines(rec, f"rms/{score.reference}", stamp, scene.trial.epoch, rms / ARCMIN, names, AXIS_COLOURS)
    slow = stride(scene.deformation.stamp, SLOW_RATE)
    names = [f"predicted 1σ {axis}" for axis in AXES]
    stamp, sigma = scene.deformation.stamp[::slow], scene.sigma[::slow] / ARCMIN
    send_lines(rec, "rms/predicted", stamp, scene.trial.epoch, sigma, names, DIM_COLOURS, 1.0)
    _log_lanes(rec, scene)
    rec.log("accuracy", rr.TextDocument(accuracy_text(scene.result), media_type=rr.MediaType.MARKDOWN), static=True)


def tab(scene: Scene) -> rrb.Container:
    """Errors and innovations on the left, RMS, lanes and table on the right."""
    left: list[object] = [error_view(scene, axis, axis == 0) for axis in range(3)] if scene.scores else []
    if scene.deformation.innovations is not None:
        name = "Innovations, standardised (±3 expected) [1]"
        left.append(layout.time_view(scene, name, ["innovations"], y_range=(-6.0, 6.0)))
    entities = ["rms/predicted", *(f"rms/{score.reference}" for score in scene.scores[:1])]
    right = [
        layout.time_view(scene, f"RMS error over {WINDOW:.0f} s and predicted 1σ [arcmin]", entities),
        layout.lanes(scene, "Phases and gaps", "lanes"),
        rrb.TextDocumentView(origin="accuracy", name="Accuracy in figures"),
    ]
    columns = [rrb.Vertical(*left)] if left else []  # type: ignore[arg-type]
    return rrb.Horizontal(*columns, rrb.Vertical(*right, row_shares=[1.7, 1.9, 3.0]), name="Accuracy")


def _log_innovations(rec: rr.RecordingStream, scene: Scene, innovations: Innovations) -> None:
    stamp = scene.trial.epoch + np.round(innovations.t * 1e9).astype(np.int64)
    colours = [PALETTE[i % len(PALETTE)] for i in range(len(innovations.names))]
    every = stride(stamp, scene.rate)
    values = innovations.values[::every]
    send_lines(rec, "innovations", stamp[::every], scene.trial.epoch, values, innovations.names, colours, 1.0)


def windowed_rms(stamp: IntArray, error: FloatArray, window: float) -> tuple[IntArray, FloatArray]:
    """RMS (k, 3) of errors (n, 3) per window of ``window`` s, at its middle; empty windows left out."""
    index = ((stamp - stamp[0]) * 1e-9 // window).astype(int)
    count = np.bincount(index)
    sums = np.stack([np.bincount(index, error[:, i] ** 2) for i in range(error.shape[1])], axis=1)
    filled = np.flatnonzero(count)
    middle = stamp[0] + ((filled + 0.5) * window * 1e9).astype(np.int64)
    return middle, np.sqrt(sums[filled] / count[filled][:, None])


def _log_lanes(rec: rr.RecordingStream, scene: Scene) -> None:
    for name, stamp in channel_stamps(scene.trial).items():
        at, states = data_lane(stamp, "" if name == "sliding" else GAP)  # between runs the sled rightly rests
        send_states(rec, f"lanes/{name}", at, scene.trial.epoch, states, {k: LANE_COLOURS[k] for k in (DATA, GAP)})
    at, states = data_lane(scene.deformation.stamp)
    send_states(rec, "lanes/estimate", at, scene.trial.epoch, states, {k: LANE_COLOURS[k] for k in (DATA, GAP)})
    phases = scene.deformation.alignment.static_phases
    if len(phases):
        times, states = phase_lane(phases, scene.span)
        stamp = scene.trial.epoch + np.round(times * 1e9).astype(np.int64)
        colours = {k: LANE_COLOURS[k] for k in (STILL, MOVING)}
        send_states(rec, "lanes/ship", stamp, scene.trial.epoch, states, colours)


def data_lane(stamp: IntArray, pause: str = GAP) -> tuple[IntArray, list[str]]:
    """Stamps and states: data from the first sample, ``pause`` where samples stop, nothing after the last."""
    gaps = gap_starts(stamp)
    inner = np.stack([stamp[gaps], stamp[gaps + 1]], axis=1).ravel()
    at = np.concatenate([stamp[:1], inner, stamp[-1:]]).astype(np.int64)
    return at, [DATA, *([pause, DATA] * len(gaps)), ""]


def phase_lane(phases: FloatArray, span: tuple[float, float]) -> tuple[FloatArray, list[str]]:
    """Times (s) and states of a lane from static phases (k, 2) within the span."""
    times, states = [span[0]], [MOVING]
    for start, end in phases:
        times += [float(start), float(end)]
        states += [STILL, MOVING]
    return np.array([*times, span[1]]), [*states, ""]
