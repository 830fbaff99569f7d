"""Overview: the deformation with its band against every reference, its error, the ship, the track, the summary."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from physics import quaternions
from physics.units import ARCMIN, DEG
from schemas.products import Score
from schemas.rig import FloatArray
from schemas.trial import GnssSeries
from stages.publish.document import summary_text
from stages.publish.recording import layout, ship
from stages.publish.recording.scene import (
    AXES,
    BLUE,
    GREY,
    REFERENCE_COLOURS,
    REFERENCE_NAMES,
    RMSE_COLOURS,
    SLOW_RATE,
    Scene,
    stride,
)
from stages.publish.recording.stream import send_axes, send_bands, thin_extremes

ESTIMATE = "deformation/estimate"


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Everything the tab shows."""
    _log_estimate(rec, scene)
    for score in scene.scores:
        _log_reference(rec, scene, score)
        _log_error(rec, scene, score)
    ship.log(rec, scene)
    _log_track(rec, scene)
    rec.log(
        "summary",
        rr.TextDocument(summary_text(scene.result, scene.trial.source), media_type=rr.MediaType.MARKDOWN),
        static=True,
    )


def tab(scene: Scene) -> rrb.Container:
    """Per axis estimate and error on the left; ship, track and summary on the right."""
    rows = [rrb.Horizontal(estimate_view(scene, axis), error_view(scene, axis)) for axis in range(3)]
    side: list[object] = [ship.view(scene)]
    if scene.trial.gnss is not None:
        side.append(rrb.MapView(origin="track", name="GNSS track", zoom=track_zoom(scene.trial.gnss)))
    side.append(rrb.TextDocumentView(origin="summary", name="Summary"))
    shares = [3.3, 1.7, 3.3] if len(side) == 3 else [1.0, 1.0]
    return rrb.Horizontal(
        rrb.Vertical(*rows),
        rrb.Vertical(*side, row_shares=shares),  # type: ignore[arg-type]
        column_shares=[2.0, 1.0],
        name="Overview",
    )


def estimate_view(scene: Scene, axis: int) -> rrb.TimeSeriesView:
    """Estimate with +-3 sigma, and each reference."""
    entities = [ESTIMATE, *(f"deformation/{score.reference}" for score in scene.scores)]
    return layout.time_view(scene, f"Deformation {AXES[axis]} ±3σ [arcmin]", of_axis(entities, axis))


def error_view(scene: Scene, axis: int) -> rrb.TimeSeriesView:
    """Error against each reference, the estimate's own +-3 sigma, and the RMSE so far."""
    entities = ["error/bound", *(f"{kind}/{s.reference}" for kind in ("error", "running_rmse") for s in scene.scores)]
    return layout.time_view(scene, f"Error {AXES[axis]}, RMSE so far [arcmin]", of_axis(entities, axis))


def of_axis(entities: list[str], axis: int) -> list[str]:
    """The entities of one axis."""
    return [f"{entity}/{'xyz'[axis]}" for entity in entities]


def _log_estimate(rec: rr.RecordingStream, scene: Scene) -> None:
    """Estimate at full rate unless thinned; the error band around zero at a slow rate."""
    d, every = scene.deformation, 1
    if scene.estimate_rate is not None:
        every = stride(d.stamp, scene.estimate_rate)
    values, sigma = d.total[::every] / ARCMIN, 3 * scene.sigma[::every] / ARCMIN
    send_bands(rec, ESTIMATE, d.stamp[::every], scene.trial.epoch, values, sigma, "estimate", BLUE, "arcmin")
    slow = stride(d.stamp, SLOW_RATE)
    bound = 3 * scene.sigma[::slow] / ARCMIN
    zero = np.zeros_like(bound)
    send_bands(rec, "error/bound", d.stamp[::slow], scene.trial.epoch, zero, bound, "±3σ", GREY, "arcmin")


def _log_reference(rec: rr.RecordingStream, scene: Scene, score: Score) -> None:
    """``R_ref = Exp(e)^T R_est``, thinned: a reference is drawn to compare with, not to work on."""
    every = stride(score.stamp, scene.rate)
    stamp, error = score.stamp[::every], score.error[::every]
    estimate = scene.deformation.total[np.searchsorted(scene.deformation.stamp, stamp)]
    total = quaternions.log(quaternions.multiply(quaternions.exp(-error), quaternions.exp(estimate)))
    who, colour = REFERENCE_NAMES[score.reference], REFERENCE_COLOURS[score.reference]
    send_axes(rec, f"deformation/{score.reference}", stamp, scene.trial.epoch, total / ARCMIN, who, colour)


def _log_error(rec: rr.RecordingStream, scene: Scene, score: Score) -> None:
    colour, who = REFERENCE_COLOURS[score.reference], REFERENCE_NAMES[score.reference]
    stamp, error = thin_extremes(score.stamp, score.error / ARCMIN, stride(score.stamp, scene.rate))
    send_axes(rec, f"error/{score.reference}", stamp, scene.trial.epoch, error, f"against {who}", colour)
    slow = stride(score.stamp, SLOW_RATE)
    stamp, running = score.stamp[::slow], running_rmse(score.error)[::slow] / ARCMIN
    entity, tint = f"running_rmse/{score.reference}", RMSE_COLOURS[score.reference]
    send_axes(rec, entity, stamp, scene.trial.epoch, running, f"RMSE, {who}", tint, 2.5)


def running_rmse(error: FloatArray) -> FloatArray:
    """RMS (n, 3) of all errors up to and including each, per axis."""
    count = np.arange(1, len(error) + 1)[:, None]
    return np.sqrt(np.cumsum(error**2, axis=0) / count)


def track_zoom(fixes: GnssSeries) -> float:
    """Map zoom at which the whole track fits: a small view shows little more than half a tile of 360 deg / 2^zoom."""
    width = float(np.ptp(fixes.longitude)) / DEG if len(fixes.stamp) else 0.0
    height = float(np.ptp(fixes.latitude) / np.cos(np.mean(fixes.latitude))) / DEG if len(fixes.stamp) else 0.0
    return float(np.clip(np.log2(220.0 / max(width, 1.6 * height, 1e-4)), 1.0, 18.0))


def _log_track(rec: rr.RecordingStream, scene: Scene) -> None:
    fixes = scene.trial.gnss
    if fixes is None or not len(fixes.stamp):
        return
    place = np.stack([fixes.latitude, fixes.longitude], axis=1) / DEG
    line = rr.GeoLineStrings(lat_lon=[place], colors=[BLUE], radii=rr.Radius.ui_points(2.0))
    rec.log("track/line", line, static=True)
    ends = rr.GeoPoints(lat_lon=place[[0, -1]], colors=[(60, 170, 90), (214, 60, 60)], radii=rr.Radius.ui_points(6.0))
    rec.log("track/ends", ends, static=True)
