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
from stages.publish.recording.chart import key_view, log_key
from stages.publish.recording.overview import colours_of, error_view, surprises_of
from stages.publish.recording.scene import (
    AXES,
    AXIS_COLOURS,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    REFERENCE_NAMES,
    SLOW_RATE,
    Colour,
    Scene,
    channel_stamps,
    stride,
)
from stages.publish.recording.stream import send_band, send_lines, send_states, thin_extremes

KEY_SHARES = (1.0, 0.7)  # of a key with one line, and of each more, where plots have 3
LINE_LETTERS = 80  # of the names of innovations, beside each other
WINDOW = 60.0  # s, of the RMS over time
INNOVATIONS_SHOWN = (4.5, 30.0)  # least and largest limit of their plot
DATA, GAP, STILL, MOVING, UNEXPECTED = "data", "gap", "lying still", "under way", "unexpected"
LANE_COLOURS: dict[str, Colour] = {DATA: GREEN, GAP: RED, STILL: BLUE, MOVING: GREY, UNEXPECTED: ORANGE}
EVENT_SHOWN = 0.01  # share of the trial that an event takes in its lane
PALETTE: tuple[Colour, ...] = (*AXIS_COLOURS, ORANGE, (170, 110, 210), (90, 190, 190))


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Innovations, RMS per minute, lanes, and the table."""
    innovations = scene.deformation.innovations
    log_key(rec, "accuracy_key/errors", colours_of(scene)[1:])
    log_key(rec, "accuracy_key/rms", [*zip(AXES, AXIS_COLOURS), *([("expected", GREY)] if scene.scores else [])])
    if innovations is not None and len(innovations.t):
        _log_innovations(rec, scene, innovations)
    _log_rms(rec, scene)
    _log_lanes(rec, scene)
    rec.log("accuracy", rr.TextDocument(accuracy_text(scene.result), media_type=rr.MediaType.MARKDOWN), static=True)


def tab(scene: Scene) -> rrb.Container:
    """Errors and innovations on the left, RMS, lanes and table on the right."""
    left = [*_errors(scene), *_innovations(scene)]
    lanes = layout.lanes(scene, "Phases and gaps", "lanes")
    words = rrb.TextDocumentView(origin="accuracy", name="Accuracy in figures")
    right = [key_view("accuracy_key/rms", "Colours of RMS"), rms_view(scene), lanes, words]
    columns = [rrb.Vertical(*(view for view, _ in left), row_shares=[share for _, share in left])] if left else []
    return rrb.Horizontal(*columns, rrb.Vertical(*right, row_shares=[0.5, 1.9, 2.3, 2.5]), name="Accuracy")


def _errors(scene: Scene) -> list[tuple[rrb.View, float]]:
    """Views of the errors below their key, each with its share of the height."""
    if not scene.scores:
        return []
    key = key_view("accuracy_key/errors", "Colours of errors")
    return [(key, KEY_SHARES[0]), *((error_view(scene, axis), 3.0) for axis in range(3))]


def _innovations(scene: Scene) -> list[tuple[rrb.View, float]]:
    """The view of the innovations below its key."""
    innovations = scene.deformation.innovations
    if innovations is None or not len(innovations.t):
        return []
    lines, entities = key_lines(innovations), ["innovation_bound", "innovations"]
    key = key_view("accuracy_key/innovations", "Colours of innovations", lines)
    name = "Innovations, standardised, ±3 expected [1]"
    view = layout.time_view(scene, name, entities, innovation_range(innovations))
    return [(key, KEY_SHARES[0] + KEY_SHARES[1] * (lines - 1)), (view, 3.0)]


def key_lines(innovations: Innovations) -> int:
    """Lines that the names of innovations need beside each other."""
    return -(-sum(len(name) + 4 for name in innovations.names) // LINE_LETTERS)


def rms_view(scene: Scene) -> rrb.TimeSeriesView:
    """RMS error in the course of time in units of its budget; the standard deviation where there is no reference."""
    if not scene.scores:
        return layout.time_view(scene, "Predicted 1σ [arcmin]", ["rms/predicted"])
    window, name = window_of(scene), REFERENCE_NAMES[scene.scores[0].reference]
    title = f"RMS error over {window:.0f} s against {name}, 1 = expected [expected RMS]"
    return layout.time_view(scene, title, ["rms/expected", "rms/over_budget"])


def innovation_range(innovations: Innovations) -> tuple[float, float]:
    """Limits that show all innovations, but never so wide that their usual size is lost."""
    largest = float(np.nanmax(np.abs(innovations.values), initial=0.0))
    reach = float(np.clip(1.1 * largest, *INNOVATIONS_SHOWN))
    return -reach, reach


def window_of(scene: Scene) -> float:
    """Length (s) of the windows of the RMS: a minute, less in a short trial."""
    start, end = scene.span
    return float(np.clip((end - start) / 20.0, 5.0, WINDOW))


def _log_rms(rec: rr.RecordingStream, scene: Scene) -> None:
    epoch, slow = scene.trial.epoch, stride(scene.deformation.stamp, SLOW_RATE)
    if not scene.scores:
        stamp, sigma = scene.deformation.stamp[::slow], scene.sigma[::slow] / ARCMIN
        send_lines(rec, "rms/predicted", stamp, epoch, sigma, [f"predicted 1σ {axis}" for axis in AXES], AXIS_COLOURS)
        return
    score = scene.scores[0]
    budget = np.hypot(score.predicted, score.reference_noise)
    stamp, rms = windowed_rms(score.stamp, score.error, window_of(scene))
    share = np.divide(rms, budget, out=np.full_like(rms, np.nan), where=np.isfinite(budget) & (budget > 0))
    send_lines(rec, "rms/over_budget", stamp, epoch, share, AXES, AXIS_COLOURS)
    ends = score.stamp[[0, -1]]
    send_lines(rec, "rms/expected", ends, epoch, np.ones((2, 1)), ["expected"], [GREY], 1.0)


def _log_innovations(rec: rr.RecordingStream, scene: Scene, innovations: Innovations) -> None:
    stamp = scene.trial.epoch + np.round(innovations.t * 1e9).astype(np.int64)
    colours = [PALETTE[i % len(PALETTE)] for i in range(len(innovations.names))]
    at, values = thin_extremes(stamp, innovations.values, stride(stamp, scene.rate))
    names = list(zip(innovations.names, colours))
    log_key(rec, "accuracy_key/innovations", names, key_lines(innovations))
    send_lines(rec, "innovations", at, scene.trial.epoch, values, innovations.names, colours, 1.0)
    zero = np.zeros((2, 1))
    send_band(rec, "innovation_bound", stamp[[0, -1]], scene.trial.epoch, zero, zero + 1.0, ["±3"], [GREY], "1")


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
    events = surprises_of(scene)
    if len(events):
        stamp, states = event_lane(events, scene)
        send_states(rec, "lanes/unexpected", stamp, scene.trial.epoch, states, {UNEXPECTED: LANE_COLOURS[UNEXPECTED]})
    phases = scene.deformation.alignment.static_phases
    if len(phases):
        times, states = phase_lane(phases, scene.span)
        stamp = scene.trial.epoch + np.round(times * 1e9).astype(np.int64)
        colours = {k: LANE_COLOURS[k] for k in (STILL, MOVING)}
        send_states(rec, "lanes/ship", stamp, scene.trial.epoch, states, colours)


def event_lane(events: FloatArray, scene: Scene) -> tuple[IntArray, list[str]]:
    """Stamps and states: unexpected around each event (s), long enough to be seen, nothing between them."""
    start, end = scene.span
    wide = EVENT_SHOWN * (end - start)
    groups = np.split(events, np.flatnonzero(np.diff(events) > wide) + 1)
    t = np.array([edge for group in groups for edge in (group[0], group[-1] + wide)])
    stamp = scene.trial.epoch + np.round(t * 1e9).astype(np.int64)
    return stamp, [UNEXPECTED, ""] * len(groups)


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
