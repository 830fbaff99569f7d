"""Matched filters over the whitened rate residual.

A shape h that begins at time t with size a adds a h to an axis whose spectrum is S. The best a, and how many standard
deviations it is from none,

    a(t) = F^-1[X H* / S] / E,   z(t) = F^-1[X H* / S] / sqrt(E),   E = mean |H|^2 / S

and z^2 / 2 is the log-likelihood ratio. z is brought to unit spread by its own median deviation, minute by minute, so
that a spectrum that is off or a sea that grows makes no events. Found ones are fitted between the samples, taken out,
and the search goes on in what is left.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize_scalar

from schemas.products import BoolArray
from schemas.rig import FloatArray
from stages.diagnose.spectral_data import ComplexArray

LOCAL_S = 60.0  # s over which the spread of z is taken
MAD = 1.4826
APART_S = 0.25  # s between two events
GUARD = 4  # samples around what was not measured
WINDOW_S = 25.0  # s of the fit of one event
LEAD_S = 5.0  # s of it before the event
PASSES = 4


@dataclass(frozen=True)
class Whitener:
    """An axis: inverse of its spectrum. frequency: (k,) Hz of the model. power: (k,) (rad/s)^2. interval: s."""

    frequency: FloatArray
    power: FloatArray
    interval: float

    def inverse(self, n: int) -> FloatArray:
        """1 / S (n // 2 + 1,) at the ordinates of n samples; held at the ends, none at zero."""
        at = fft.rfftfreq(n, self.interval)
        low = np.maximum(at, self.frequency[0])
        out = np.exp(-np.interp(np.log(low), np.log(self.frequency), np.log(self.power)))
        out[0] = 0.0
        return out


@dataclass(frozen=True)
class Hit:
    """An event: when it begins, s from the first sample; its size; z."""

    time: float
    size: float
    z: float


Shape = Callable[[FloatArray], FloatArray]  # of the time since the beginning, s, at the ends of samples: rate means


class Record:
    """One axis of a record, (n,) rad/s, ready to be searched for shapes no longer than ``longest`` samples."""

    def __init__(self, x: FloatArray, whitener: Whitener, usable: BoolArray, longest: int) -> None:
        self.n, self.usable, self.whitener = len(x), usable, whitener
        self.padded = fft.next_fast_len(len(x) + longest, real=True)
        self.weight = whitener.inverse(self.padded)
        # Single precision is 1e-6 of a z, in half the time: every event is fitted again in double.
        self.whitened = (fft.rfft(x, self.padded) * self.weight).astype(np.complex64)

    def scores(self, H: ComplexArray) -> FloatArray:
        """z (n,) of a shape with transform H that begins with each sample; zero where nothing was measured."""
        size = 1.0 / np.sqrt(_energy(H, self.weight, self.padded))
        z = fft.irfft(self.whitened * H.conj().astype(np.complex64), self.padded)[: self.n] * np.float32(size)
        z[~self.usable] = 0.0
        return np.asarray(z / _spread(z, self.usable, int(LOCAL_S / self.whitener.interval)))


def _energy(H: ComplexArray, weight: FloatArray, n: int) -> float:
    """Mean of |H|^2 / S over all n ordinates."""
    power = (H.real**2 + H.imag**2) * weight
    return float((2.0 * power.sum() - power[0]) / n)


def _spread(z: FloatArray, usable: BoolArray, block: int) -> FloatArray:
    """Standard deviation (n,) by medians of blocks; at least one, the model's."""
    edges = np.arange(0, len(z), block)
    size, values = np.abs(z), np.zeros(len(edges))
    for b, k in enumerate(edges):
        part, there = size[k : k + block], usable[k : k + block]
        values[b] = _median(part if there.all() else part[there])
    return _between_middles(np.maximum(MAD * values, 1.0), block, len(z))


def _median(x: FloatArray) -> float:
    """As np.median, 0 of nothing; x (n,) is put in another order. Of a million short ones most of that is overhead."""
    half = len(x) // 2
    if not len(x):
        return 0.0
    x.partition(half)
    return float(x[half] if len(x) % 2 else 0.5 * (x[:half].max() + x[half]))


def _between_middles(values: FloatArray, block: int, n: int) -> FloatArray:
    """(n,) straight lines between values (b,) in the middles of blocks of so many samples, held at the ends."""
    first = (block + 1) // 2  # the sample at the first middle, or half a one behind
    share = (np.arange(block) + first - 0.5 * block) / block
    lines = values[:-1, None] + np.diff(values)[:, None] * share
    return np.concatenate([np.full(first, values[0]), lines.ravel(), np.full(block, values[-1])])[:n]


def peaks(z: FloatArray, least: float, apart: int) -> list[int]:
    """Samples at which |z| is the largest for ``apart`` samples around and at least ``least``."""
    size = np.abs(z)
    return [int(k) for k in np.flatnonzero((size >= least) & (size >= maximum_filter1d(size, 2 * apart + 1)))]


@dataclass(frozen=True)
class Window:
    """The record around one event. whitened: transform over S. weight: 1 / S. clock: s since the event's beginning, at
    the end of each sample. padded: ordinates of the transform."""

    whitened: ComplexArray
    weight: FloatArray
    clock: FloatArray
    padded: int

    @classmethod
    def of(cls, x: FloatArray, hit: Hit, whitener: Whitener) -> Window:
        """About a hit in x (n,)."""
        T = whitener.interval
        begin = max(round((hit.time - LEAD_S) / T), 0)
        part = x[begin : begin + int(WINDOW_S / T)]
        n = fft.next_fast_len(2 * len(part), real=True)
        weight = whitener.inverse(n)
        clock = np.asarray(T * np.arange(begin, begin + len(part)) - hit.time, dtype=float)
        return cls(fft.rfft(part - part.mean(), n) * weight, weight, clock, n)

    def best(self, shape: Shape, shift: float = 0.0) -> tuple[float, float]:
        """Size of a shape that begins ``shift`` s later, and z."""
        H = fft.rfft(shape(self.clock - shift), self.padded)
        energy = _energy(H, self.weight, self.padded)
        product = (H.conj() * self.whitened).real
        size = float((2.0 * product.sum() - product[0]) / self.padded) / energy
        return size, size * float(np.sqrt(energy))

    def z(self, shape: Shape) -> float:
        """z of a shape that begins at the event's time."""
        return self.best(shape)[1]


def fitted(x: FloatArray, first: int, shape: Shape, whitener: Whitener, *, exact: bool) -> Hit:
    """The event near sample ``first``, its beginning fitted between samples unless it is ``exact``."""
    T = whitener.interval
    window, shift = Window.of(x, Hit(first * T, 0.0, 0.0), whitener), 0.0
    if not exact:
        shift = minimize_scalar(lambda s: -(window.best(shape, s)[1] ** 2), bounds=(-1.5 * T, 1.5 * T),
                                method="bounded", options={"xatol": 1e-3 * T}).x  # fmt: skip
    return Hit(first * T + float(shift), *window.best(shape, float(shift)))


def rendered(hit: Hit, shape: Shape, n: int, interval: float) -> tuple[slice, FloatArray]:
    """Where in n samples the event lies, and its rate there."""
    begin = max(int(hit.time / interval) - 1, 0)
    end = min(begin + int(WINDOW_S / interval), n)
    clock = np.asarray(interval * np.arange(begin, end) - hit.time, dtype=float)
    return slice(begin, end), hit.size * shape(clock)


def usable(good: BoolArray) -> BoolArray:
    """Samples away from what was not measured."""
    bad = np.convolve(~good, np.ones(2 * GUARD + 1), "same") > 0.5
    return ~bad
