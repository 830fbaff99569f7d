"""Spectral matrices of the rate residual: Hann segments that overlap by half, pooled in bins, odd and even apart.

Segment by segment, so that the memory does not grow with the record. Neighbouring ordinates of a Hann segment are
correlated (4/9 and 1/36 in power), and so are segments that overlap by half (1/36): a likelihood that takes them as
independent counts each one SHARE times.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import fft
from scipy.signal.windows import hann

from physics.units import ARCMIN
from schemas.products import BoolArray
from schemas.rig import FloatArray
from stages.diagnose.spectral_residual import FullRateResidual, straight

ComplexArray = NDArray[np.complex128]
Density = TypeVar("Density", FloatArray, ComplexArray)

SHARE = 1.0 / ((1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)) * (1.0 + 2.0 / 36.0))
SEGMENT_S = (60.0, 200.0)  # s, shortest and longest segment
SEGMENTS = 6  # segments end to end that a record shall hold before they grow
LINEAR_HZ = 2.5  # up to here every ordinate is kept; above, they are pooled
BINS_PER_OCTAVE = 24
FIRST = 2  # ordinate below which the mean of the segment and the slow drift of the gyros lie
SHORTEST_S, FEWEST = 8.0, 6  # s to which segments shrink among gaps, until there are so many
LONGEST_HOLE_S = 0.5  # s bridged within a segment
BRIDGED_SHARE = 0.02  # of a segment, bridged at most
UNDER_WAY = 0.2  # of its usual rate: below, the ship lies still, and so does her deck
STILL_S = 20.0  # s over which that is judged
LEFT_ANGLE = 0.3 * ARCMIN  # rad, by which the angle between the units may be off for a while
LEFT_SHARE = 0.1  # of the spectrum: where that angle lets through more of the ship's rate, a bin does not count
SOUND = 0.46  # of the sample rate: beyond, an interpolated unit's noise is dulled
GROUPS = 8  # of segments in time, for what changes over the record
# |W|^2 of a Hann window, half an ordinate apart: what an expected spectrum is smoothed by
KERNEL = np.array([0.0288, 0.25, 0.7205, 1.0, 0.7205, 0.25, 0.0288])
KERNEL = KERNEL / KERNEL.sum()


@njit(cache=True, nogil=True)
def _smoothed(density, kernel, keep, m):  # type: ignore[no-untyped-def]
    """Density at the first m points smoothed where they are kept, mirrored at zero; the others as they are."""
    half, kept = len(kernel) // 2, len(keep)
    out = np.empty(kept + len(density) - m)
    for k in range(kept):
        total = 0.0
        for j in range(-half, half + 1):
            total += kernel[half - j] * density[abs(keep[k] + j)]
        out[k] = total
    for k in range(m, len(density)):
        out[kept + k - m] = density[k]
    return out


@dataclass(frozen=True, eq=False)
class Grid:
    """Bins. fine: (m,) rad/sample, half an ordinate apart from zero, under the bins kept one by one; coarse: (j,)
    rad/sample, centres of the pooled ones. keep: indices of fine at which the first bins stand."""

    fine: FloatArray
    coarse: FloatArray
    keep: NDArray[np.int64]
    interval: float

    @cached_property
    def points(self) -> FloatArray:
        """Where a density is asked for, (m + j,) rad/sample."""
        return np.concatenate([self.fine, self.coarse])

    @cached_property
    def omega(self) -> FloatArray:
        """Bins, (k,) rad/sample."""
        return np.concatenate([self.fine[self.keep], self.coarse])

    @cached_property
    def frequency(self) -> FloatArray:
        """Bins, (k,) Hz."""
        return self.omega / (2.0 * np.pi * self.interval)

    def seen(self, density: Density) -> Density:
        """What Hann segments show on average in the bins, (k,), of a density at the points, (m + j,)."""
        m, half = len(self.fine), len(KERNEL) // 2
        if density.dtype == np.float64:
            return _smoothed(density, KERNEL, self.keep, m)  # type: ignore[return-value]
        low = density[:m]
        smoothed = np.convolve(np.concatenate([low[half:0:-1].conj(), low]), KERNEL, "valid")
        return np.concatenate([smoothed[self.keep], density[m:]])  # type: ignore[return-value]


@dataclass(frozen=True)
class Spectra:
    """power: (2, g, k, 3, 3) mean spectral matrices (white noise of variance v has v) of the halves, odd and even, and
    of the groups in time; count: (2, g, k) ordinates in them; share: (2, g) mean place of the group, 0..1. poor: gaps
    everywhere, so that it says nothing."""

    grid: Grid
    power: ComplexArray
    count: FloatArray
    share: FloatArray
    duration: float
    poor: bool = False

    def half(self, which: int) -> Spectra:
        """One half alone."""
        part = slice(which, which + 1)
        return Spectra(self.grid, self.power[part], self.count[part], self.share[part], self.duration, self.poor)

    @cached_property
    def pooled(self) -> Spectra:
        """Halves and places in time all together."""
        if self.count.shape[:2] == (1, 1):
            return self
        count = self.count.sum(axis=(0, 1), keepdims=True)
        weight = self.count / np.maximum(count, 1e-300)
        power = (self.power * weight[..., None, None]).sum(axis=(0, 1), keepdims=True)
        share = np.sum(weight.mean(axis=2) * self.share, keepdims=True)
        return Spectra(self.grid, power, count, share, self.duration, self.poor)


_KNOWN: WeakKeyDictionary[FullRateResidual, Spectra] = WeakKeyDictionary()


def spectra(residual: FullRateResidual) -> Spectra:
    """Spectral matrices of a residual, of shorter segments where gaps leave no long ones; made once for each."""
    if residual not in _KNOWN:
        _KNOWN[residual] = _spectra(residual)
    return _KNOWN[residual]


def _spectra(residual: FullRateResidual) -> Spectra:
    n, starts = _segments(residual)
    poor = len(starts) < 2
    if poor:
        starts = [0, len(residual.t) - n]
    grid, edges = _grid(n, residual.interval)
    rate = straight(residual.rate, residual.good)
    groups = min(GROUPS, len(starts) // 2)
    power = np.zeros((2, groups, len(grid.omega), 3, 3), dtype=complex)
    number, place = np.zeros((2, groups)), np.zeros((2, groups))
    window, motion = hann(n, sym=False), np.zeros(len(grid.omega))
    for index, start in enumerate(starts):
        slot = index % 2, index * groups // len(starts)
        power[slot] += _pooled(rate[start : start + n], window, edges)
        motion += _pooled_power(residual.omega[start : start + n], window, edges)
        number[slot] += 1.0
        place[slot] += (start + 0.5 * n) / len(rate)
    weight = np.maximum(number, 1.0)
    width = np.concatenate([np.ones(len(grid.keep)), np.diff(edges[len(grid.keep) :])])
    width = np.where(grid.omega < 2.0 * np.pi * (SOUND if residual.interpolated else 0.5), width, 0.0)
    count = number[:, :, None] * width * _clear(motion / len(starts), power.sum(axis=(0, 1)) / len(starts))
    mean = np.asarray(power / weight[:, :, None, None, None], dtype=complex)
    return Spectra(grid, mean, count, place / weight, residual.duration, poor)


def _under_way(residual: FullRateResidual) -> BoolArray:
    """Samples (n,) at which the ship moves; all of them where she never does."""
    every = max(1, min(int(STILL_S / residual.interval), len(residual.t)))
    starts = np.arange(0, len(residual.t), every)
    size = np.sqrt(np.add.reduceat((residual.omega - residual.omega.mean(axis=0)) ** 2, starts, axis=0).sum(axis=1))
    moves = size > UNDER_WAY * np.quantile(size, 0.75)
    moves[-1] |= moves[-2:].any()  # the last piece may be short
    return np.repeat(moves, every)[: len(residual.t)]


def _clear(motion: FloatArray, power: ComplexArray) -> BoolArray:
    """Bins (k,) in which no line of the ship's motion, power (k,), shows through beside the mean power (k, 3, 3)."""
    least = np.einsum("kii->ki", power).real.min(axis=1)
    return np.asarray(LEFT_ANGLE**2 * motion < LEFT_SHARE * least)


def _length(residual: FullRateResidual) -> int:
    seconds = float(np.clip(residual.duration / SEGMENTS, *SEGMENT_S))
    return 2 * int(0.5 * min(seconds, 0.5 * residual.duration) / residual.interval)


def _segments(residual: FullRateResidual) -> tuple[int, list[int]]:
    """Samples of a segment, and the first ones of those that are whole."""
    n, shortest = _length(residual), int(SHORTEST_S / residual.interval)
    good = residual.good & _under_way(residual)
    starts = _whole(good, n, residual.interval)
    while len(starts) < FEWEST and n >= 2 * shortest:
        n = 2 * (n // 4)
        starts = _whole(good, n, residual.interval)
    return n, starts


def _whole(good: BoolArray, n: int, interval: float) -> list[int]:
    """First samples of the segments that are whole enough, half a segment apart at least."""
    bad = np.concatenate([[0], np.cumsum(~good)])
    run = int(LONGEST_HOLE_S / interval) + 1
    holes = np.concatenate([[0], np.cumsum((bad[run:] - bad[:-run]) == run)])
    inner = np.flatnonzero(good)
    if len(inner) < n:
        return []
    k, last, out = int(inner[0]), int(inner[-1]) + 1, []
    while k + n <= last:
        whole = bad[k + n] - bad[k] <= BRIDGED_SHARE * n and holes[k + n - run] == holes[k]
        out += [k] if whole else []
        k += n // 2 if whole else max(n // 16, 1)
    return out


def _grid(n: int, interval: float) -> tuple[Grid, NDArray[np.int64]]:
    """Bins of segments of n samples, and their edges in ordinates."""
    top = n // 2  # the last ordinate, at half the sample rate, is left out
    linear = min(int(LINEAR_HZ * n * interval), top)
    count = max(int(np.log2(top / linear) * BINS_PER_OCTAVE), 0)
    pooled = np.unique(np.rint(linear * (top / linear) ** (np.arange(count + 1) / max(count, 1))).astype(np.int64))
    edges = np.unique(np.concatenate([np.arange(FIRST, linear + 1), pooled]))
    step = 2.0 * np.pi / n
    fine = np.asarray(0.5 * step * np.arange(2 * linear + len(KERNEL)), dtype=float)
    coarse = np.asarray(step * 0.5 * (pooled[:-1] + pooled[1:] - 1.0), dtype=float)
    return Grid(fine, coarse, 2 * np.arange(FIRST, linear), interval), edges


def _pooled(rate: FloatArray, window: FloatArray, edges: NDArray[np.int64]) -> ComplexArray:
    """Mean matrices (k, 3, 3) of one segment in the bins."""
    x = _transform(rate, window, edges)
    out = np.empty((len(edges) - 1, 3, 3), dtype=complex)
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        out[:, i, j] = np.add.reduceat(x[i] * x[j].conj(), edges[:-1] - edges[0])
        out[:, j, i] = out[:, i, j].conj()
    return np.asarray(out / np.diff(edges)[:, None, None])


def _pooled_power(rate: FloatArray, window: FloatArray, edges: NDArray[np.int64]) -> FloatArray:
    """Their traces (k,)."""
    x = _transform(rate, window, edges)
    power = (x.real**2 + x.imag**2).sum(axis=0)
    return np.asarray(np.add.reduceat(power, edges[:-1] - edges[0]) / np.diff(edges))


def _transform(rate: FloatArray, window: FloatArray, edges: NDArray[np.int64]) -> ComplexArray:
    """(3, j) ordinates of a segment within the edges, such that white noise of variance v has the power v."""
    return np.asarray(
        fft.rfft((rate - rate.mean(axis=0)).T * (window / np.sqrt(np.sum(window**2))))[:, edges[0] : edges[-1]]
    )
