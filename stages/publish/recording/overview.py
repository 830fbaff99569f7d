"""Overview: the deformation with its band against every reference, its error, the ship, the track, the summary."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from physics.interpolation import gap_starts
from physics.units import ARCMIN
from schemas.products import Score
from schemas.rig import FloatArray
from schemas.trial import GnssSeries, Trial
from stages.publish.axis import Axis, span_of
from stages.publish.document import summary_text
from stages.publish.recording import layout, ship
from stages.publish.recording.chart import (
    MARGIN,
    WIDTH,
    Chart,
    Curve,
    chart_view,
    key_view,
    log_chart,
    log_key,
)
from stages.publish.recording.scene import (
    AXES,
    BLUE,
    GREEN,
    GREY,
    RED,
    REFERENCE_COLOURS,
    REFERENCE_NAMES,
    RMSE_COLOURS,
    SLOW_RATE,
    Colour,
    Scene,
    channel_stamps,
    stride,
)
from stages.publish.recording.stream import send_axes, send_bands, thin_extremes
from stages.publish.reference import reference_angles
from stages.publish.verdict import surprise_times, verdict
from stages.slabs import SLAB

ESTIMATE = "deformation/estimate"
ALLOWED: Colour = (150, 112, 78)
TRACK_HEIGHT = 74.0
KEY_SHARE = 0.7  # of a column whose plots have 3
MOST_LANES = 5
REFERENCE_RATE = 10.0  # Hz: flexure moves far slower
FEW = 10  # every how many samples of a reference are looked at for its limits
SHORT = 0.02  # share of the trial that a record may miss at its ends
EARTH_RADIUS_KM = 6371.0


def log(rec: rr.RecordingStream, scene: Scene) -> None:
    """Everything the tab shows."""
    _log_estimate(rec, scene)
    for score in scene.scores:
        _log_reference(rec, scene, score)
        _log_error(rec, scene, score)
    log_key(rec, "key", colours_of(scene))
    ship.log(rec, scene)
    if has_track(scene.trial):
        log_chart(rec, "track", track_chart(scene.trial))
    text = summary_text(scene.result, scene.trial.source, verdict(scene.result, scene.trial))
    rec.log("summary", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def tab(scene: Scene) -> rrb.Container:
    """Per axis estimate and error on the left, above the data there were; verdict, ship and track on the right."""
    rows = [rrb.Horizontal(estimate_view(scene, axis), error_view(scene, axis)) for axis in range(3)]
    lanes = [f"$origin/{name}" for name in lanes_told(scene)]
    below = layout.lanes(scene, "Data, gaps and phases", "lanes", lanes)
    left = rrb.Vertical(key(), *rows, below, row_shares=[KEY_SHARE, 3.0, 3.0, 3.0, 1.0 + 0.55 * len(lanes)])
    side: list[object] = [rrb.TextDocumentView(origin="summary", name="Summary")]
    side.append(ship.view(scene, 1.0 if has_track(scene.trial) else 1.3))
    if has_track(scene.trial):
        side.append(chart_view("track", "GNSS track [km]", TRACK_HEIGHT))
    shares = [4.6, 2.4, 2.2][: len(side)]
    right = rrb.Vertical(*side, row_shares=shares)  # type: ignore[arg-type]
    return rrb.Horizontal(left, right, column_shares=[1.85, 1.0], name="Overview")


def key() -> rrb.View:
    """What the colours of estimates, references and errors mean."""
    return key_view("key", "Colours: deformation on the left, its error on the right")


def colours_of(scene: Scene) -> list[tuple[str, Colour]]:
    """Names of the lines of the tab, with their colours."""
    references = [(REFERENCE_NAMES[s.reference], REFERENCE_COLOURS[s.reference]) for s in scene.scores]
    running = [(f"RMSE so far, {REFERENCE_NAMES[s.reference]}", RMSE_COLOURS[s.reference]) for s in scene.scores]
    allowed = [(f"±3σ with {REFERENCE_NAMES[s.reference]}'s", ALLOWED) for s in scene.scores
               if (s.reference_noise > 0).any()]  # fmt: skip
    return [("estimate ±3σ", BLUE), *references, ("its ±3σ", GREY), *allowed, *running]


def lanes_told(scene: Scene) -> list[str]:
    """Lanes worth a glance: the estimate, what surprised it, the ship's phases, units with gaps or an early end."""
    start, end = scene.span
    told = ["estimate", *(["unexpected"] if len(surprises_of(scene)) else [])]
    told += ["ship"] if len(scene.deformation.alignment.static_phases) else []
    for name, stamp in channel_stamps(scene.trial).items():
        t = scene.trial.seconds(stamp[[0, -1]])
        whole = t[0] - start < SHORT * (end - start) and end - t[1] < SHORT * (end - start)
        told += [] if whole and not len(gap_starts(stamp)) else [name]
    return told[:MOST_LANES]


def surprises_of(scene: Scene) -> FloatArray:
    """Times (k,) s at which an innovation was so large that the verdict speaks of it."""
    innovations = scene.deformation.innovations
    return surprise_times(innovations) if innovations is not None else np.zeros(0)


def estimate_view(scene: Scene, axis: int) -> rrb.TimeSeriesView:
    """Estimate with +-3 sigma, and each reference."""
    entities = [ESTIMATE, *(f"deformation/{score.reference}" for score in scene.scores)]
    name = f"Deformation {AXES[axis]} ±3σ [arcmin]"
    return layout.time_view(scene, name, of_axis(entities, axis), angle_range(scene, axis))


def error_view(scene: Scene, axis: int) -> rrb.TimeSeriesView:
    """Error against each reference, the estimate's own +-3 sigma, and the RMSE so far."""
    allowed = [f"error/allowed/{s.reference}" for s in scene.scores if (s.reference_noise > 0).any()]
    entities = [
        *allowed,
        "error/bound",
        *(f"{kind}/{s.reference}" for kind in ("error", "running_rmse") for s in scene.scores),
    ]
    name = f"Error {AXES[axis]}, RMSE so far [arcmin]" if scene.scores else f"Uncertainty {AXES[axis]} ±3σ [arcmin]"
    return layout.time_view(scene, name, of_axis(entities, axis), error_range(scene, axis))


def angle_range(scene: Scene, axis: int) -> tuple[float, float]:
    """Limits that show estimate and references whole, and the band unless it is far wider than what it surrounds."""
    references = [reference_angles(scene.deformation, score, FEW)[1][:, axis] for score in scene.scores]
    value = scene.deformation.total[:, axis]
    low, high = span_of([part / ARCMIN for part in (value, *references)], zero=False)
    extra = min(_largest_band(scene, axis) or 0.0, 0.5 * (high - low))
    return low - extra, high + extra


def error_range(scene: Scene, axis: int) -> tuple[float, float]:
    """Limits that show errors and band whole; a band much wider than the errors is cut."""
    errors = [score.error[:, axis] / ARCMIN for score in scene.scores]
    running = [running_rmse(score.error[::FEW, axis, None])[:, 0] / ARCMIN for score in scene.scores]
    low, high = span_of([*errors, *running])
    band = _largest_band(scene, axis)
    reach = 1.15 * band if band is not None else 1.0
    reach = min(reach, 3.0 * max(-low, high)) if errors else reach
    return min(low, -reach), max(high, reach)


def _largest_band(scene: Scene, axis: int) -> float | None:
    """3 sigma, arcmin, where it is largest; None where it is known nowhere."""
    sigma = scene.sigma[:, axis]
    return 3.0 * float(np.nanmax(sigma)) / ARCMIN if np.isfinite(sigma).any() else None


def of_axis(entities: list[str], axis: int) -> list[str]:
    """The entities of one axis."""
    return [f"{entity}/{'xyz'[axis]}" for entity in entities]


def _log_estimate(rec: rr.RecordingStream, scene: Scene) -> None:
    """Estimate at full rate unless thinned; the error band around zero at a slow rate."""
    d, every = scene.deformation, 1
    if scene.estimate_rate is not None:
        every = stride(d.stamp, scene.estimate_rate)
    values, sigma = d.total[::every], scene.sigma[::every]
    send_bands(rec, ESTIMATE, d.stamp[::every], scene.trial.epoch, values, sigma, "estimate", BLUE, "arcmin", ARCMIN)
    slow = stride(d.stamp, SLOW_RATE)
    bound = scene.sigma[::slow]
    zero = np.zeros_like(bound)
    send_bands(rec, "error/bound", d.stamp[::slow], scene.trial.epoch, zero, bound, "±3σ", GREY, "arcmin", ARCMIN)


def _log_reference(rec: rr.RecordingStream, scene: Scene, score: Score) -> None:
    """A reference, thinned: it is drawn to compare with, not to work on."""
    rate = min(scene.rate, REFERENCE_RATE)
    stamp, total = reference_angles(scene.deformation, score, stride(score.stamp, rate))
    who, colour = REFERENCE_NAMES[score.reference], REFERENCE_COLOURS[score.reference]
    send_axes(rec, f"deformation/{score.reference}", stamp, scene.trial.epoch, total / ARCMIN, who, colour)


def _log_error(rec: rr.RecordingStream, scene: Scene, score: Score) -> None:
    colour, who = REFERENCE_COLOURS[score.reference], REFERENCE_NAMES[score.reference]
    if (score.reference_noise > 0).any():
        _log_allowed(rec, scene, score)
    stamp, error = thin_extremes(score.stamp, score.error, stride(score.stamp, scene.rate))
    send_axes(rec, f"error/{score.reference}", stamp, scene.trial.epoch, error / ARCMIN, f"against {who}", colour)
    slow = stride(score.stamp, SLOW_RATE)
    stamp, running = score.stamp[::slow], running_rmse(score.error, slow) / ARCMIN
    entity, tint = f"running_rmse/{score.reference}", RMSE_COLOURS[score.reference]
    send_axes(rec, entity, stamp, scene.trial.epoch, running, f"RMSE, {who}", tint, 2.5)


def _log_allowed(rec: rr.RecordingStream, scene: Scene, score: Score) -> None:
    """+-3 sigma of estimate and reference together: an error within it contradicts neither."""
    d, slow = scene.deformation, stride(scene.deformation.stamp, SLOW_RATE)
    bound = np.hypot(scene.sigma[::slow], score.reference_noise)
    zero, name = np.zeros_like(bound), f"±3σ with {REFERENCE_NAMES[score.reference]}'s own"
    entity = f"error/allowed/{score.reference}"
    send_bands(rec, entity, d.stamp[::slow], scene.trial.epoch, zero, bound, name, ALLOWED, "arcmin", ARCMIN)


def running_rmse(error: FloatArray, every: int = 1) -> FloatArray:
    """RMS (n / every, k) of all errors (n, k) up to and including the first, and each so many after it, per axis."""
    out, before = [], np.zeros(error.shape[1])
    slab = SLAB // every * every or every
    for start in range(0, len(error), slab):
        total = before + np.cumsum(error[start : start + slab] ** 2, axis=0)
        out.append(total[::every] / np.arange(start + 1, start + len(total) + 1, every)[:, None])
        before = total[-1]
    return np.sqrt(np.concatenate(out))


def has_track(trial: Trial) -> bool:
    """Whether there is a way to draw."""
    return trial.gnss is not None and len(trial.gnss.stamp) > 1


def track_chart(trial: Trial) -> Chart:
    """The way made good, km east and north of its start, equal scales; drawn here, so that nothing is fetched."""
    assert trial.gnss is not None
    north, east = way(trial.gnss)
    middle = [0.5 * (float(v.min()) + float(v.max())) for v in (east, north)]
    wide, high = WIDTH - MARGIN[0] - MARGIN[2], TRACK_HEIGHT - MARGIN[1] - MARGIN[3]
    half = 0.55 * max(float(np.ptp(east)) / wide, float(np.ptp(north)) / high, 1e-3 / high)
    x = Axis(middle[0] - half * wide, middle[0] + half * wide, "east [km]")
    y = Axis(middle[1] - half * high, middle[1] + half * high, "north [km]")
    dot = np.array([-0.006, 0.006]) * half * wide
    ends = [
        Curve(east[k] + dot, north[k] + 0 * dot, colour, name, 9.0)
        for k, colour, name in ((0, GREEN, "start"), (-1, RED, "end"))
    ]
    return Chart(x, y, [Curve(east, north, BLUE, "", 2.0), *ends], height=TRACK_HEIGHT, low=True)


def way(fixes: GnssSeries) -> tuple[FloatArray, FloatArray]:
    """North and east (n,) km of the first fix, on a sphere tangent there: good to a percent over 100 km."""
    good = np.isfinite(fixes.latitude) & np.isfinite(fixes.longitude)
    latitude, longitude = fixes.latitude[good], np.unwrap(fixes.longitude[good])
    north = (latitude - latitude[0]) * EARTH_RADIUS_KM
    return north, (longitude - longitude[0]) * np.cos(latitude[0]) * EARTH_RADIUS_KM
