"""Tables and figures that several pages share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physics.interpolation import gap_starts, usual_interval
from physics.units import ARCMIN
from schemas import scratch
from schemas.products import DeckShape, Deformation, Estimate, Score
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial
from stages.publish.axis import Axis, decades_of, span_of, time_axis
from stages.publish.deck_line import design_line, measured_line
from stages.publish.page.figure import BLUE, GREEN, GREY, ORANGE, RED, Band, Line, Plot, plot, plots
from stages.publish.page.html import Html, join
from stages.publish.reference import reference_angles
from stages.publish.spectrum import (
    HIGHEST,
    MAX_LAG,
    drawable,
    measured_autocorrelation,
    measured_spectrum,
    model_autocorrelation,
    model_spectrum,
)
from stages.publish.summary import intervals
from stages.publish.verdict import AXES, REFERENCE_NAMES

REFERENCE_COLOURS = {"truth": GREEN, "phins": ORANGE}
CURVES = ("Vertical curvature (about x)", "Torsion (about y)", "Horizontal curvature (about z)")
CLOSE_UP = 60.0  # s, of the figure in detail
WANTED_POINTS = 20_000  # of a record, before extremes are picked: a reference is compared, not worked on


def angle(radians: float, digits: int = 3) -> str:
    """Arcminutes, a dash where unknown."""
    return f"{radians / ARCMIN:.{digits}f}".replace("-", "−") if np.isfinite(radians) else "–"


def figure(value: float | None, form: str = ".4g") -> str:
    """A number, a dash where unknown."""
    return "–" if value is None or not np.isfinite(value) else f"{value:{form}}".replace("-", "−")


def utc(stamp: int) -> str:
    """Date and time of a stamp in ns, to the second."""
    return str(np.datetime64(int(stamp), "ns").astype("datetime64[s]")).replace("T", " ") + " UTC"


def band_of(deformation: Deformation, axis: int, here: slice) -> FloatArray:
    """(m,) arcmin, three of the estimate's own standard deviations about an axis; NaN where unknown."""
    variance = deformation.covariance[here, axis, axis]
    return np.asarray(3.0 / ARCMIN * np.sqrt(np.where(variance >= 0, variance, np.nan)))


def ordered(scores: Sequence[Score]) -> list[Score]:
    """Truth first."""
    return sorted(scores, key=lambda score: score.reference != "truth")


def reason_of(estimate: Estimate) -> str:
    """Status and, where there is one, its reason."""
    return f"{estimate.status}: {estimate.reason}" if estimate.reason else str(estimate.status)


def seconds(trial: Trial, stamp: IntArray) -> FloatArray:
    """Seconds since the epoch of the trial."""
    return trial.seconds(stamp)


def breaks_of(stamp: IntArray) -> float:
    """The step of time (s) after which a line over these stamps breaks."""
    return 3.0 * usual_interval(stamp) * 1e-9


def whole(trial: Trial) -> Axis:
    """Time over the whole trial."""
    ends = trial.seconds(np.concatenate([trial.main.stamp[[0, -1]], trial.sub.stamp[[0, -1]]]))
    return time_axis(float(ends.min()), float(ends.max()))


def close_up(trial: Trial, deformation: Deformation) -> Axis:
    """The minute in which the deck bends most."""
    t = trial.seconds(deformation.stamp)
    theta = deformation.dynamic_part
    size = np.nan_to_num(np.einsum("ki,ki->k", theta, theta))
    middle = float(t[int(size.argmax())]) if len(t) else 0.0
    start = max(float(t[0]), min(middle - 0.5 * CLOSE_UP, float(t[-1]) - CLOSE_UP))
    return Axis(start, start + min(CLOSE_UP, float(t[-1] - t[0])), "time since the start of the trial [s]")


def deformation_plots(trial: Trial, deformation: Deformation, scores: Sequence[Score], x: Axis, title: str) -> Html:
    """Per axis the estimate within ±3σ and every reference, over the stretch of time ``x``."""
    references = [(score, *reference_angles(deformation, score, _every(score.stamp, x))) for score in ordered(scores)]
    drawn = join([plot(_deformation_plot(trial, deformation, references, i, x, title)) for i in range(3)])
    scratch.release(deformation.total, deformation.covariance, *(score.error for score in scores))
    return drawn


def _every(stamp: IntArray, x: Axis) -> int:
    """Each how many samples to take of a whole record; all of a close-up."""
    span = float(stamp[-1] - stamp[0]) * 1e-9
    return max(1, len(stamp) // WANTED_POINTS) if x.high - x.low > 0.5 * span else 1


def _deformation_plot(
    trial: Trial,
    d: Deformation,
    references: Sequence[tuple[Score, IntArray, FloatArray]],
    i: int,
    x: Axis,
    title: str,
) -> Plot:
    t = trial.seconds(d.stamp)
    here, pause = within(t, x), breaks_of(d.stamp)
    t, value, band = t[here], d.total[here, i] / ARCMIN, band_of(d, i, here)
    parts: list[Line | Band] = [Band(t, value - band, value + band, BLUE, "±3σ", pause)]
    for score, stamp, total in references:
        s = trial.seconds(stamp)
        seen, name = within(s, x), REFERENCE_NAMES[score.reference]
        colour = REFERENCE_COLOURS[score.reference]
        shown = Line(s[seen], total[seen, i] / ARCMIN, colour, name, 2.6, opacity=0.65, breaks=breaks_of(stamp))
        parts.append(shown)
    parts.append(Line(t, value, BLUE, "estimate", 1.3, breaks=pause))
    low, high = span_of([part.y for part in parts if isinstance(part, Line)], zero=False)
    return Plot(f"{AXES[i]} {title}", x, Axis(low, high, "angle [arcmin]"), parts, gaps(trial, d.stamp), 168.0,
                zone_name="no estimate")  # fmt: skip


def within(t: FloatArray, x: Axis) -> slice:
    """The stretch of increasing times that an axis shows."""
    return slice(int(np.searchsorted(t, x.low)), int(np.searchsorted(t, x.high, side="right")))


def gaps(trial: Trial, stamp: IntArray) -> list[tuple[float, float]]:
    """Stretches (s) without a sample, between samples."""
    t = trial.seconds(stamp)
    return [(float(t[k]), float(t[k + 1])) for k in gap_starts(stamp)]


def error_plots(trial: Trial, deformation: Deformation, scores: Sequence[Score], x: Axis) -> Html:
    """Per axis the error against each reference, within the estimate's own ±3σ."""
    drawn = join([plot(_error_plot(trial, deformation, ordered(scores), i, x)) for i in range(3)])
    scratch.release(deformation.covariance, *(score.error for score in scores))
    return drawn


def _error_plot(trial: Trial, d: Deformation, scores: Sequence[Score], i: int, x: Axis) -> Plot:
    t, band = trial.seconds(d.stamp), band_of(d, i, slice(None))
    parts: list[Line | Band] = [Band(t, -band, band, BLUE, "±3σ of the estimate", breaks_of(d.stamp))]
    for score in reversed(scores):  # truth on top
        colour, name = REFERENCE_COLOURS[score.reference], f"against {REFERENCE_NAMES[score.reference]}"
        error = score.error[:, i] / ARCMIN
        parts.append(Line(trial.seconds(score.stamp), error, colour, name, 1.0, breaks=breaks_of(score.stamp)))
    low, high = span_of([part.y for part in parts if isinstance(part, Line)])
    reach = min(float(np.nanmax(band)) if np.isfinite(band).any() else 0.0, 3.0 * max(-low, high))
    y = Axis(min(low, -1.1 * reach), max(high, 1.1 * reach), "error [arcmin]")
    return Plot(f"{AXES[i]} error", x, y, parts, gaps(trial, d.stamp), 140.0)


def spectrum_plots(deformation: Deformation) -> Html:
    """Per axis spectrum and autocorrelation of the flexure, measured and by the model; nothing for a short record."""
    found = drawable(deformation)
    if found is None:
        return join([])
    return join([_densities(deformation, *found), _correlations(deformation, *found)])


def _densities(d: Deformation, theta: FloatArray, rate: float) -> Html:
    f, density = measured_spectrum(theta, rate)
    keep = f <= HIGHEST
    f, pairs = f[keep], (density[keep] / ARCMIN**2, model_spectrum(f[keep], d.flexure) / ARCMIN**2)
    x = Axis(float(f[0]), float(f[-1]), "frequency [Hz]", log=True)
    return plots([
        Plot(f"{AXES[i]} spectrum", x, Axis(*decades_of([p[:, i] for p in pairs]), "[arcmin²/Hz]", log=True),
             [Line(f, pairs[0][:, i], BLUE, "measured"), Line(f, pairs[1][:, i], ORANGE, "model", 1.8)],
             height=230.0, width=300.0)
        for i in range(3)
    ])  # fmt: skip


def _correlations(d: Deformation, theta: FloatArray, rate: float) -> Html:
    lags = int(min(MAX_LAG * rate, len(theta) / 2))
    lag = np.arange(lags) / rate
    pairs = measured_autocorrelation(theta, lags), model_autocorrelation(lag, d.flexure)
    x, y = Axis(0.0, float(lag[-1]), "lag [s]"), Axis(-1.0, 1.05, "autocorrelation [1]")
    return plots([
        Plot(f"{AXES[i]} autocorrelation", x, y,
             [Line(lag, pairs[0][:, i], BLUE, "measured"), Line(lag, pairs[1][:, i], ORANGE, "model", 1.8)],
             height=200.0, width=300.0)
        for i in range(3)
    ])  # fmt: skip


def deck_plots(shape: DeckShape) -> Html:
    """Curvatures and torsion along the path with every run, limits and danger zones; the line they bend."""
    return join([*(plot(_deck_plot(shape, i)) for i in range(3)), *(plot(_line_plot(shape, i)) for i in (1, 0))])


def _deck_plot(shape: DeckShape, i: int) -> Plot:
    s, k, std = shape.arc_length, 1e5 * shape.curvature[:, i], 3e5 * shape.std[:, i]
    x = Axis(float(s[0]), float(s[-1]), "arc length along the path [m]")
    parts: list[Line | Band] = [Band(s, k - std, k + std, BLUE, "±3σ")]
    for index, run in enumerate(shape.passes):
        order = np.argsort(run.arc_length, kind="stable")
        named = f"each of {len(shape.passes)} runs" if index == 0 else ""
        parts.append(Line(run.arc_length[order], 1e5 * run.curvature[order, i], GREY, named, 0.6))
    parts.append(Line(s, k, BLUE, "all runs", 2.0))
    shown = [k - std, k + std]
    base = 1e5 * shape.design[:, i] if shape.design is not None else np.zeros_like(k)
    if shape.design is not None:
        parts.append(Line(s, base, GREEN, "design", 1.2, dashed=True))
    if np.isfinite(shape.limit[i]):
        edges = [base + sign * 1e5 * shape.limit[i] for sign in (1.0, -1.0)]
        parts += [Line(s, edge, RED, name, 1.2, dashed=True) for edge, name in zip(edges, ("limit", ""))]
        shown += edges
    y = Axis(*span_of([*shown, base]), "torsion [1e-5 rad/m]" if i == 1 else "curvature [1e-5 rad/m]")
    zones = [(a, b) for a, b in intervals(s, shape.exceeds[:, i])]
    return Plot(CURVES[i], x, y, parts, zones, 190.0, zone_name="beyond the limit")


def _line_plot(shape: DeckShape, i: int) -> Plot:
    """The line over its chord, sideways (0) or upwards (1), beside the design's where one is stated."""
    s, measured, design = shape.arc_length, measured_line(shape)[:, i], design_line(shape)
    x = Axis(float(s[0]), float(s[-1]), "arc length along the path [m]")
    lines = [Line(s, np.zeros_like(s), GREY, "straight", 1.0, True)]
    if design is not None:
        lines.append(Line(s, 1e3 * design[:, i], GREEN, "design", 1.2, dashed=True))
    lines.append(Line(s, 1e3 * measured, BLUE, "as bent", 2.0))
    y = Axis(*span_of([line.y for line in lines]), ("to starboard [mm]", "upwards [mm]")[i])
    over = shape.exceeds[:, (2, 0)[i]]  # curvature about z bends sideways, about x upwards
    zones = [(a, b) for a, b in intervals(s, over)]
    title = f"Deck line over the chord of its ends, {('sideways', 'upwards')[i]}"
    return Plot(title, x, y, lines, zones, 170.0, zone_name="beyond the limit")


def motion_plot(trial: Trial, series: ImuSeries, name: str, x: Axis) -> Plot:
    """Rates of a unit in deg/s."""
    every = max(1, len(series) // (4 * WANTED_POINTS))
    t, rate, pause = trial.seconds(series.stamp[::every]), np.degrees(series.gyro[::every]), breaks_of(series.stamp)
    parts = [
        Line(t, rate[:, i], colour, "xyz"[i], 0.9, breaks=max(pause, 3.0 * every * pause))
        for i, colour in enumerate((RED, GREEN, BLUE))
    ]
    y = Axis(*span_of([rate]), "rate [deg/s]")
    return Plot(f"Gyro of the {name}", x, y, parts, gaps(trial, series.stamp), 130.0, zone_name="gap")
