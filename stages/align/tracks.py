"""Rate records as integrated angle, so that they can be read on any grid and with any fractional delay.

    angle(t) = sum of rate_k * (t_k - t_{k-1}),  mean rate over a cell = (angle(end) - angle(start)) / step

The samples are means over the interval that ends at their stamp, so the angle is exact at the stamps whatever the
jitter; between them a cubic spline interpolates. The angle is summed per component in body axes: a constant rotation
commutes with that sum, which is all that alignment asks of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter

from schemas.errors import DataError
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray

GAP_BRIDGED = 0.25  # s; a longer hole splits the record
SPIKE_SIGMA = 8.0  # robust sigmas off the local median at which a sample is taken for a spike
SPIKE_WINDOW = 5  # samples of the local median
SEGMENT_SHORTEST = 5.0  # s; shorter stretches without a gap are left out
TAPER_SHARE = 0.1  # of a segment, at either end
TAPER_LONGEST = 20.0  # s
LONG_RUN_HZ = 0.012  # the long-run variance of a series is its spectrum below this, and
LONG_RUN_BINS = 4  # of at least so many bins


@dataclass(frozen=True)
class Track:
    """A stretch without a gap. angle: spline of the integrated rate (rad), velocity: knots of integrated accel."""

    start: float
    end: float
    angle: CubicSpline
    velocity: FloatArray


@dataclass(frozen=True)
class Span:
    """Where two units' stretches overlap: start and end, s, in the first one's time."""

    first: Track
    second: Track
    start: float
    end: float


@dataclass(frozen=True)
class Cells:
    """Two units' mean rates on common cells of one length; segments follow each other without their gaps.

    first, second: (n, 3) rad/s, the second read ``delay`` later. slope: (n, 3) rad/s^2, derivative of second with
    respect to that delay. time: (n,) s, middle of the cell in the first unit's time. window: (n,) taper, zero at the
    ends of every segment. segment: (n,) index.
    """

    step: float
    time: FloatArray
    first: FloatArray
    second: FloatArray
    slope: FloatArray
    window: FloatArray
    segment: IntArray

    def centred(self, values: FloatArray) -> FloatArray:
        """Values (n, ...) without the taper-weighted mean of their segment (gyro biases are unknown constants)."""
        out = np.array(values, dtype=float)
        for index in np.unique(self.segment):
            part = self.segment == index
            out[part] -= np.average(out[part], axis=0, weights=self.window[part])
        return out


def tracks(series: ImuSeries, epoch: int, channel: str) -> tuple[Track, ...]:
    """The stretches of a unit's record; spikes are replaced by the local median, holes up to GAP_BRIDGED bridged.

    Raises DataError when fewer than SPIKE_WINDOW finite samples are left.
    """
    good = np.isfinite(series.gyro).all(axis=1)
    if np.count_nonzero(good) <= SPIKE_WINDOW:
        raise DataError("too few finite gyro samples to align with", channel=channel)
    stamp, gyro = series.stamp[good], despiked(series.gyro[good])
    accel = np.nan_to_num(series.accel[good], posinf=0.0, neginf=0.0)
    time = np.asarray((stamp - epoch) * 1e-9, dtype=np.float64)
    intervals = np.diff(time)
    breaks = np.flatnonzero(intervals > max(GAP_BRIDGED, 3.0 * np.median(intervals))) + 1
    edges = np.concatenate(([0], breaks, [len(time)]))
    long_enough = [(a, b) for a, b in pairwise(edges) if b - a > SPIKE_WINDOW]
    return tuple(_track(time[a:b], gyro[a:b], accel[a:b], series.instantaneous) for a, b in long_enough)


def _track(time: FloatArray, gyro: FloatArray, accel: FloatArray, instantaneous: bool) -> Track:
    angle = CubicSpline(time, _integral(time, gyro, instantaneous))
    return Track(float(time[0]), float(time[-1]), angle, _integral(time, accel, instantaneous))


def _integral(time: FloatArray, rate: FloatArray, instantaneous: bool) -> FloatArray:
    intervals = np.diff(time)
    mean = rate[1:].copy()
    # The sample after a hole speaks for its own interval only; across the hole the trapezoid is the better guess.
    holed = np.full(len(mean), instantaneous) | (intervals > 1.5 * np.median(intervals))
    mean[holed] = 0.5 * (rate[1:] + rate[:-1])[holed]
    return np.asarray(np.vstack((np.zeros(3), np.cumsum(mean * intervals[:, None], axis=0))), dtype=np.float64)


def despiked(values: FloatArray) -> FloatArray:
    """Values (n, 3) with spikes, off by SPIKE_SIGMA times the usual local scatter or step, set to the local median."""
    median = median_filter(values, (SPIKE_WINDOW, 1), mode="nearest")
    off = np.abs(values - median)
    # Clean data are monotonic over most windows and then equal their median: the usual step counts as scatter too.
    scatter = np.maximum(1.4826 * np.median(off, axis=0), np.median(np.abs(np.diff(values, axis=0)), axis=0))
    scatter = np.where(scatter > 0.0, scatter, np.inf)
    return np.where(off > SPIKE_SIGMA * scatter, median, values)


def shared_spans(
    first: Sequence[Track], second: Sequence[Track], shortest: float, reach: tuple[float, float]
) -> list[Span]:
    """Spans of at least ``shortest`` s in which both units are there at every delay within reach (s)."""
    spans = []
    for a in first:
        for b in second:
            start, end = max(a.start, b.start - reach[0]), min(a.end, b.end - reach[1])
            if end - start >= shortest:
                spans.append(Span(a, b, start, end))
    return sorted(spans, key=lambda span: span.start)


def edges_of(span: Span, step: float) -> FloatArray:
    """Cell edges (k + 1,) of a span, s."""
    count = int((span.end - span.start) / step + 1e-9) + 1
    return np.asarray(span.start + step * np.arange(count), dtype=np.float64)


def cells(spans: Sequence[Span], step: float, delay: float) -> Cells:
    """Mean rates of both units on the spans, the second read ``delay`` later (exactly, at any fraction)."""
    parts = [_segment(span, step, delay) for span in spans]
    index = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    time, first, second, slope, window = (np.concatenate(column) for column in zip(*parts))
    return Cells(step, time, first, second, slope, window, index)


def _segment(span: Span, step: float, delay: float) -> tuple[FloatArray, ...]:
    edges = edges_of(span, step)
    later = edges + delay
    slope = np.diff(span.second.angle(later, 1), axis=0) / step
    first = np.diff(span.first.angle(edges), axis=0) / step
    second = np.diff(span.second.angle(later), axis=0) / step
    return 0.5 * (edges[1:] + edges[:-1]), first, second, slope, taper(len(edges) - 1, step)


def taper(count: int, step: float) -> FloatArray:
    """Cosine-flanked window (count,): flanks TAPER_SHARE of the length, at most TAPER_LONGEST."""
    flank = max(1, int(min(TAPER_SHARE * count, TAPER_LONGEST / step)))
    distance = np.minimum(np.arange(count), np.arange(count)[::-1]) + 0.5
    return np.sin(0.5 * np.pi * np.minimum(distance / flank, 1.0)) ** 2


def mean_accel(span: Span, step: float, delay: float) -> tuple[FloatArray, FloatArray]:
    """Mean specific forces (k, 3) of both units on cells of a span, the second read ``delay`` later."""
    edges = edges_of(span, step)
    return _velocity_rate(span.first, edges, step), _velocity_rate(span.second, edges + delay, step)


def _velocity_rate(track: Track, edges: FloatArray, step: float) -> FloatArray:
    knots = track.angle.x
    velocity = np.stack([np.interp(edges, knots, track.velocity[:, axis]) for axis in range(3)], axis=1)
    return np.diff(velocity, axis=0) / step


def long_run_variance(values: FloatArray, step: float) -> FloatArray:
    """Variance (p, p) of the sum of a coloured series (n, p), steps of ``step`` s: n times its PSD near zero."""
    count = max(LONG_RUN_BINS, round(LONG_RUN_HZ * len(values) * step))
    near_zero = np.fft.rfft(values - values.mean(axis=0), axis=0)[1 : count + 1]
    return np.real(near_zero.conj().T @ near_zero) / len(near_zero)
