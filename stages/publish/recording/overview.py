"""Overview: the deformation with its band against every reference, its error, the ship, the track, the summary."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from physics.units import ARCMIN, DEG
from schemas.products import Score
from schemas.rig import FloatArray
from stages.publish.document import summary_text
from stages.publish.recording import layout, ship
from stages.publish.recording.scene import (
    AXES,
    BLUE,
    GREY,
    PURPLE,
    REFERENCE_COLOURS,
    REFERENCE_NAMES,
    SLOW_RATE,
    Scene,
    stride,
)
from stages.publish.recording.stream import send_band, send_lines, thin_extremes

ESTIMATE = "deformation/estimate"


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Everything the tab shows."""
    _log_estimate(rec, scene)
    for score in scene.scores:
        _log_reference(rec, scene, score)
        _log_error(rec, scene, score)
    ship.log(rec, scene)
    _log_track(rec, scene)
    rec.log("summary", rr.TextDocument(summary_text(scene.result), media_type=rr.MediaType.MARKDOWN), static=True)


def tab(scene: Scene) -> rrb.Container:
    """Per axis estimate and error on the left; ship, track and summary on the right."""
    rows = [rrb.Horizontal(estimate_view(scene, axis), error_view(scene, axis)) for axis in range(3)]
    side: list[object] = [ship.view(scene)]
    if scene.trial.gnss is not None:
        side.append(rrb.MapView(origin="track", name="GNSS track"))
    side.append(rrb.TextDocumentView(origin="summary", name="Summary"))
    shares = [3.0, 2.0, 3.0] if len(side) == 3 else [1.0, 1.0]
    return rrb.Horizontal(
        rrb.Vertical(*rows),
        rrb.Vertical(*side, row_shares=shares),  # type: ignore[arg-type]
        column_shares=[2.0, 1.0],
        name="Overview",
    )


def estimate_view(scene: Scene, axis: int) -> rrb.TimeSeriesView:
    """Estimate with +-3 sigma, and each reference."""
    references = [f"deformation/{score.reference}" for score in scene.scores]
    overrides = {ESTIMATE: layout.only_band(axis)} | {name: layout.only_line(axis) for name in references}
    return layout.time_view(scene, f"Deformation {AXES[axis]} ±3σ [arcmin]", [ESTIMATE, *references], overrides)


def error_view(scene: Scene, axis: int) -> rrb.TimeSeriesView:
    """Error against each reference, the estimate's own +-3 sigma, and the RMSE so far."""
    lines = [f"error/{score.reference}" for score in scene.scores]
    lines += [f"running_rmse/{score.reference}" for score in scene.scores]
    overrides = {"error/bound": layout.only_band(axis)} | {name: layout.only_line(axis) for name in lines}
    return layout.time_view(scene, f"Error {AXES[axis]}, RMSE so far [arcmin]", ["error/bound", *lines], overrides)


def _log_estimate(rec: rr.RecordingStream, scene: Scene) -> None:
    """Estimate at full rate unless thinned; the error band around zero at a slow rate."""
    d, every = scene.deformation, 1
    if scene.estimate_rate is not None:
        every = stride(d.stamp, scene.estimate_rate)
    names = [f"estimate {axis}" for axis in AXES]
    values, sigma = d.total[::every] / ARCMIN, 3 * scene.sigma[::every] / ARCMIN
    send_band(rec, ESTIMATE, d.stamp[::every], scene.trial.epoch, values, sigma, names, [BLUE] * 3, "arcmin")
    slow = stride(d.stamp, SLOW_RATE)
    bound = 3 * scene.sigma[::slow] / ARCMIN
    bands = [f"±3σ {axis}" for axis in AXES]
    stamp = d.stamp[::slow]
    send_band(rec, "error/bound", stamp, scene.trial.epoch, np.zeros_like(bound), bound, bands, [GREY] * 3, "arcmin")


def _log_reference(rec: rr.RecordingStream, scene: Scene, score: Score) -> None:
    """``R_ref = Exp(e)^T R_est``, thinned: a reference is drawn to compare with, not to work on."""
    every = stride(score.stamp, scene.rate)
    stamp, error = score.stamp[::every], score.error[::every]
    estimate = scene.deformation.total[np.searchsorted(scene.deformation.stamp, stamp)]
    total = (Rotation.from_rotvec(error).inv() * Rotation.from_rotvec(estimate)).as_rotvec()
    names = [f"{REFERENCE_NAMES[score.reference]} {axis}" for axis in AXES]
    colours = [REFERENCE_COLOURS[score.reference]] * 3
    send_lines(rec, f"deformation/{score.reference}", stamp, scene.trial.epoch, total / ARCMIN, names, colours, 1.0)


def _log_error(rec: rr.RecordingStream, scene: Scene, score: Score) -> None:
    colour, who = REFERENCE_COLOURS[score.reference], REFERENCE_NAMES[score.reference]
    stamp, error = thin_extremes(score.stamp, score.error / ARCMIN, stride(score.stamp, scene.rate))
    names = [f"estimate − {who} {axis}" for axis in AXES]
    send_lines(rec, f"error/{score.reference}", stamp, scene.trial.epoch, error, names, [colour] * 3, 1.0)
    slow = stride(score.stamp, SLOW_RATE)
    running = running_rmse(score.error)[::slow] / ARCMIN
    entity, names = f"running_rmse/{score.reference}", [f"RMSE so far, {who} {axis}" for axis in AXES]
    tint = PURPLE if score.reference == "truth" else (215, 190, 90)
    send_lines(rec, entity, score.stamp[::slow], scene.trial.epoch, running, names, [tint] * 3, 2.0)


def running_rmse(error: FloatArray) -> FloatArray:
    """RMS (n, 3) of all errors up to and including each, per axis."""
    count = np.arange(1, len(error) + 1)[:, None]
    return np.sqrt(np.cumsum(error**2, axis=0) / count)


def _log_track(rec: rr.RecordingStream, scene: Scene) -> None:
    fixes = scene.trial.gnss
    if fixes is None or not len(fixes.stamp):
        return
    place = np.stack([fixes.latitude, fixes.longitude], axis=1) / DEG
    line = rr.GeoLineStrings(lat_lon=[place], colors=[BLUE], radii=rr.Radius.ui_points(2.0))
    rec.log("track/line", line, static=True)
    ends = rr.GeoPoints(lat_lon=place[[0, -1]], colors=[(60, 170, 90), (214, 60, 60)], radii=rr.Radius.ui_points(6.0))
    rec.log("track/ends", ends, static=True)
