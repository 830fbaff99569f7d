"""Rate records as integrated angle, so that they can be read on any grid and with any fractional delay.

    angle(t) = sum of rate_k * (t_k - t_{k-1}),  mean rate over a cell = (angle(end) - angle(start)) / step

The samples are means over the interval that ends at their stamp, so the angle is exact at the stamps whatever the
jitter. It is taken once, by a cubic spline through stamps about GRID apart, at the points of a regular grid; between
these a polynomial through six of them interpolates, with the same weights for all cells of a span. The angle is summed
per component in body axes: a constant rotation commutes with that sum, which is all that alignment asks of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from schemas import scratch
from schemas.errors import DataError
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray
from stages.slabs import rows

GRID = 0.05  # s; ship motion lies far below its 10 Hz. Cells are whole multiples of it
NODES = np.arange(-2.0, 4.0)  # grid points about an instant through which the polynomial goes
CELL_SHORTEST = 0.1  # s; rates are averaged over cells this long, ship motion is far slower
GAP_BRIDGED = 0.25  # s; a longer hole splits the record
SPIKE_SIGMA = 8.0  # robust sigmas off the local median at which a sample is taken for a spike
SPIKE_WINDOW = 5  # samples of the local median
SCATTER_SAMPLES = 50_000  # the usual scatter is taken from about so many samples, evenly spread
SEGMENT_SHORTEST = 5.0  # s; shorter stretches without a gap are left out
TAPER_SHARE = 0.1  # of a segment, at either end
TAPER_LONGEST = 20.0  # s
LONG_RUN_HZ = 0.012  # the long-run variance of a series is its spectrum below this, and
LONG_RUN_BINS = 4  # of at least so many bins

_PER_POWER = np.linalg.inv(np.vander(NODES, increasing=True))  # weights of the nodes for each power of the fraction


@dataclass(frozen=True)
class Track:
    """A stretch without a gap, to be read between start and end, s since the epoch.

    angle: (n, 3) rad, integrated rate, and velocity: (n, 3) m/s, integrated specific force, at origin + GRID k.
    """

    start: float
    end: float
    origin: float
    angle: FloatArray
    velocity: FloatArray

    def turned(self, start: float, step: float, count: int) -> FloatArray:
        """Integrated rate (count, 3), rad, at start, start + step, ...; step a multiple of GRID."""
        return self._read(self.angle, start, step, count)

    def rate(self, start: float, step: float, count: int) -> FloatArray:
        """Mean rates (count, 3), rad/s, over cells of ``step`` s (a multiple of GRID) from ``start`` on."""
        return np.diff(self.turned(start, step, count + 1), axis=0) / step

    def slope(self, start: float, step: float, count: int) -> FloatArray:
        """Derivative (count, 3) of :meth:`rate` with respect to ``start``, rad/s^2."""
        return np.diff(self._read(self.angle, start, step, count + 1, derivative=True), axis=0) / step

    def specific_force(self, start: float, step: float, count: int) -> FloatArray:
        """Mean specific forces (count, 3), m/s^2, over the same cells."""
        return np.diff(self._read(self.velocity, start, step, count + 1), axis=0) / step

    def _read(self, values: FloatArray, start: float, step: float, count: int, derivative: bool = False) -> FloatArray:
        position = (start - self.origin) / GRID
        whole = int(np.floor(position + 1e-6))
        powers = np.vander([position - whole], len(NODES), increasing=True)[0]
        if derivative:
            powers = np.append(0.0, np.arange(1, len(NODES)) * powers[:-1]) / GRID
        stride = round(step / GRID)
        out = np.zeros((count, values.shape[1]))
        for node, weight in zip(whole + NODES.astype(int), powers @ _PER_POWER):
            out += weight * values[node : node + stride * (count - 1) + 1 : stride]
        return out


@dataclass(frozen=True)
class Span:
    """Where two units' stretches overlap: start and end, s, in the first one's time."""

    first: Track
    second: Track
    start: float
    end: float

    def count(self, step: float) -> int:
        """Number of whole cells of ``step`` s."""
        return int((self.end - self.start) / step + 1e-9)


@dataclass(frozen=True)
class Cells:
    """Two units' mean rates on common cells of one length; segments follow each other without their gaps.

    first, second: (n, 3) rad/s, the second read ``delay`` later. slope: (n, 3) rad/s^2, derivative of second with
    respect to that delay. time: (n,) s, middle of the cell in the first unit's time. window: (n,) taper, zero at the
    ends of every segment. bounds: (k + 1,) first cell of every segment, and n.
    """

    step: float
    time: FloatArray
    first: FloatArray
    second: FloatArray
    slope: FloatArray
    window: FloatArray
    bounds: IntArray

    def centred(self, values: FloatArray) -> FloatArray:
        """Values (n, ...) without the taper-weighted mean of their segment (gyro biases are unknown constants)."""
        flat = np.reshape(values, (len(values), -1))
        out = np.empty_like(flat)
        for a, b in pairwise(self.bounds):
            out[a:b] = flat[a:b] - self.window[a:b] @ flat[a:b] / self.window[a:b].sum()
        return out.reshape(values.shape)


def cell_length(*series: ImuSeries) -> float:
    """Length of the cells, s: the least multiple of CELL_SHORTEST that is no shorter than any sample interval."""
    longest = max(float(np.median(np.diff(one.stamp))) * 1e-9 for one in series)
    return CELL_SHORTEST * max(1, int(np.ceil(longest / CELL_SHORTEST - 0.05)))


def tracks(series: ImuSeries, epoch: int, channel: str) -> tuple[Track, ...]:
    """The stretches of a unit's record; spikes are replaced by the local median, holes up to GAP_BRIDGED bridged.

    Stretches shorter than SEGMENT_SHORTEST are left out. Raises DataError when fewer than SPIKE_WINDOW finite samples
    are left.
    """
    good = finite_rows(series.gyro)
    if np.count_nonzero(good) <= SPIKE_WINDOW:
        raise DataError("too few finite gyro samples to align with", channel=channel)
    stamp, gyro = rows(series.stamp, good), despiked(rows(series.gyro, good))
    known = finite_rows(series.accel)
    accel = rows(series.accel if known.all() else np.where(known[:, None], series.accel, 0.0), good)
    time = np.asarray((stamp - epoch) * 1e-9, dtype=np.float64)
    intervals = np.diff(time)
    breaks = np.flatnonzero(intervals > max(GAP_BRIDGED, 3.0 * np.median(intervals))) + 1
    edges = np.concatenate(([0], breaks, [len(time)]))
    parts = [(a, b) for a, b in pairwise(edges) if b - a > SPIKE_WINDOW and time[b - 1] - time[a] > SEGMENT_SHORTEST]
    found = tuple(_track(time[a:b], gyro[a:b], accel[a:b], series.instantaneous) for a, b in parts)
    scratch.release(series.gyro, series.accel)
    return found


def finite_rows(values: FloatArray) -> BoolArray:
    """Mask (n,) of the rows of values (n, 3) without a NaN or an infinity."""
    with np.errstate(invalid="ignore", over="ignore"):  # of opposite infinities
        return np.asarray(np.isfinite(values @ np.ones(values.shape[1])))


def _track(time: FloatArray, gyro: FloatArray, accel: FloatArray, instantaneous: bool) -> Track:
    every = max(1, int(GRID / np.median(np.diff(time)) + 0.05))
    angle, velocity = (
        np.stack([_integral(time, column, instantaneous)[::every] for column in rate.T], axis=1)
        for rate in (gyro, accel)
    )
    knots = time[::every]
    grid = knots[0] + GRID * np.arange(int((knots[-1] - knots[0]) / GRID) + 1)
    velocity = np.stack([np.interp(grid, knots, velocity[:, axis]) for axis in range(3)], axis=1)
    inner = float(grid[int(-NODES[0])]), float(grid[-1 - int(NODES[-1])])
    return Track(*inner, float(grid[0]), CubicSpline(knots, angle)(grid), velocity)


def _integral(time: FloatArray, rate: FloatArray, instantaneous: bool) -> FloatArray:
    """(n,) of one component."""
    intervals = np.diff(time)
    mean = rate[1:].copy()
    # The sample after a hole speaks for its own interval only; across the hole the trapezoid is the better guess.
    holed = np.flatnonzero(instantaneous | (intervals > 1.5 * np.median(intervals)))
    mean[holed] = 0.5 * (rate[holed + 1] + rate[holed])
    out = np.zeros(rate.shape)
    mean *= intervals
    np.cumsum(mean, out=out[1:])
    return out


def despiked(values: FloatArray) -> FloatArray:
    """Values (n, 3) with spikes, off by SPIKE_SIGMA times the usual local scatter or step, set to the local median."""
    steps = np.diff(values, axis=0)
    np.abs(steps, out=steps)
    some = np.arange(0, len(steps), max(1, len(steps) // SCATTER_SAMPLES))
    # Clean data are monotonic over most windows and then equal their median: the usual step counts as scatter too.
    off = np.median(np.abs(values[some] - _local_median(values, some)), axis=0)
    scatter = np.maximum(1.4826 * off, np.median(steps[some], axis=0))
    limit = np.where(scatter > 0.0, SPIKE_SIGMA * scatter, np.inf)
    # Far off the median of five is far off a neighbour too: only there need the median be known.
    jumps = np.nonzero(steps > limit)[0]
    near = np.unique(np.concatenate((jumps, jumps + 1)))
    median = _local_median(values, near)
    out = values.copy()
    out[near] = np.where(np.abs(values[near] - median) > limit, median, values[near])
    return out


def _local_median(values: FloatArray, at: IntArray) -> FloatArray:
    """Medians (m, 3) over SPIKE_WINDOW samples about the rows ``at`` (m,)."""
    half = SPIKE_WINDOW // 2
    around = at[:, None] + np.arange(-half, half + 1)
    return np.sort(values[around.clip(0, len(values) - 1)], axis=1)[:, half]


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


def cells(spans: Sequence[Span], step: float, delay: float) -> Cells:
    """Mean rates of both units on the spans, the second read ``delay`` later (exactly, at any fraction)."""
    parts = [_segment(span, step, delay) for span in spans]
    bounds = np.cumsum([0, *(len(part[0]) for part in parts)])
    time, first, second, slope, window = (np.concatenate(column) for column in zip(*parts))
    return Cells(step, time, first, second, slope, window, bounds)


def _segment(span: Span, step: float, delay: float) -> tuple[FloatArray, ...]:
    count, later = span.count(step), span.start + delay
    time = np.asarray(span.start + step * (np.arange(count) + 0.5), dtype=np.float64)
    first = span.first.rate(span.start, step, count)
    second, slope = span.second.rate(later, step, count), span.second.slope(later, step, count)
    return time, first, second, slope, taper(count, step)


def taper(count: int, step: float) -> FloatArray:
    """Cosine-flanked window (count,): flanks TAPER_SHARE of the length, at most TAPER_LONGEST."""
    flank = max(1, int(min(TAPER_SHARE * count, TAPER_LONGEST / step)))
    distance = np.minimum(np.arange(count), np.arange(count)[::-1]) + 0.5
    return np.sin(0.5 * np.pi * np.minimum(distance / flank, 1.0)) ** 2


def long_run_variance(values: FloatArray, step: float) -> FloatArray:
    """Variance (p, p) of the sum of a coloured series (n, p), steps of ``step`` s: n times its PSD near zero."""
    count = max(LONG_RUN_BINS, round(LONG_RUN_HZ * len(values) * step))
    near_zero = np.fft.rfft(values - values.mean(axis=0), axis=0)[1 : count + 1]
    return np.real(near_zero.conj().T @ near_zero) / len(near_zero)
