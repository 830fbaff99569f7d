"""The deck behind the seal: an oscillator per axis shaken by noise, stepped at 2 kHz, and the lever arm it moves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import fft

from pipeline.blind.reality import paths
from pipeline.blind.reality.nature import Deck

FloatArray = NDArray[np.float64]
Bend = Callable[[FloatArray], FloatArray]

STEP = 5e-4  # s, of the integration
SETTLING = 60.0  # s, before the record, for what does not begin stationary
MARGIN = 12.0  # s, at either end, for the band of the lever arm
EVERY = 4  # steps of the integration to one of the lever arm's table


@dataclass(frozen=True)
class Restoring:
    """b^2 (share x + (1 - share) z) (1 + gain x^2), z the hysteretic part of Bouc and Wen that yields at ``yields``.

    z' = v - (|v| z + |z| v) / (2 yields). gain in 1/rad^2; share = 1: no hysteresis.
    """

    gain: float = 0.0
    share: float = 1.0
    yields: float = 1.0


@njit(cache=True)
def shaken(
    damping: float,
    stiffness: float,
    std: float,
    law: tuple[float, float, float],
    strength: FloatArray,
    noise: FloatArray,
    start: tuple[float, float],
    step: float,
) -> FloatArray:  # pragma: no cover
    """x'' + 2 mu x' + restoring(x) = w, after each step: kick, drift, exact damping with noise, drift, kick.

    The splitting of Leimkuhler and Matthews (2013, BAOAB): the stationary law is right to the second order of b step,
    here 1e-5 and less. strength scales the noise, whose size gives the standard deviation std when linear.
    """
    gain, share, yields = law
    x, v, z = start[0], start[1], start[0]
    decay = np.exp(-2.0 * damping * step)
    size = np.sqrt(stiffness) * std * np.sqrt(1.0 - decay * decay)
    out = np.empty(len(noise))
    force = stiffness * (share * x + (1.0 - share) * z) * (1.0 + gain * x * x)
    for k in range(len(noise)):
        v -= 0.5 * step * force
        x += 0.5 * step * v
        v = decay * v + size * strength[k] * noise[k]
        x += 0.5 * step * v
        if share < 1.0:
            z += step * (v - 0.5 * (abs(v) * z + abs(z) * v) / yields)
        force = stiffness * (share * x + (1.0 - share) * z) * (1.0 + gain * x * x)
        v -= 0.5 * step * force
        out[k] = x
    return out


@dataclass(frozen=True)
class Bending:
    """theta(t) in m-axes: the random path (k, 3) rad every STEP from ``first``, and what is added in closed form."""

    first: float
    path: FloatArray
    added: tuple[Bend, ...] = ()

    def at(self, t: FloatArray) -> FloatArray:
        """(n, 3) rad at times t (n,)."""
        theta = paths.between(self.path, self.first, STEP, t)
        for bend in self.added:
            theta = theta + bend(t)
        return theta


@dataclass(frozen=True)
class Lever:
    """The flexure that moves the lever arm: a table (3, 3, k) of value, rate, acceleration per axis."""

    first: float
    table: FloatArray

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Angle, rate and acceleration, each (n, 3)."""
        values = paths.quintic(self.table, self.first, STEP * EVERY, t)
        return values[:, 0].T, values[:, 1].T, values[:, 2].T


def grid(duration: float) -> FloatArray:
    """Instants (k,) s of the integration, settling included."""
    count = np.arange(round(-(SETTLING + MARGIN) / STEP), round((duration + MARGIN) / STEP) + 1)
    return np.asarray(count * STEP, dtype=np.float64)


def random_path(
    deck: Deck, t: FloatArray, laws: Sequence[Restoring], strength: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """The shaken deck (k, 3) rad at the instants t of :func:`grid`; laws: one per axis."""
    noise = rng.standard_normal((len(t), 3)) @ np.linalg.cholesky(deck.correlation).T
    out = np.empty_like(noise)
    for axis in range(3):
        stiffness = deck.damping[axis] ** 2 + deck.frequency[axis] ** 2
        law = laws[axis]
        start = deck.std[axis] * rng.standard_normal(2) * np.array([1.0, np.sqrt(stiffness)])
        out[:, axis] = shaken(
            deck.damping[axis], stiffness, deck.std[axis], (law.gain, law.share, law.yields), strength,
            np.ascontiguousarray(noise[:, axis]), (start[0], start[1]), STEP,
        )  # fmt: skip
    return out


def settled(t: FloatArray, path: FloatArray) -> tuple[float, FloatArray]:
    """The part after the settling: its first instant and the path."""
    skip = round(SETTLING / STEP)
    return float(t[skip]), path[skip:]


def moved_lever(bending: Bending, deck: Deck) -> Lever:
    """Low-passed flexure with two derivatives, by Fourier transform of a path whose ends are joined by a line."""
    t = bending.first + STEP * EVERY * np.arange((len(bending.path) - 1) // EVERY + 1)
    theta = np.concatenate([bending.at(part) for part in np.array_split(t[1:-1], max(1, len(t) // 100_000))])
    t = t[1:-1]
    slope = (theta[-1] - theta[0]) / (t[-1] - t[0])
    line = theta[0] + np.outer(t - t[0], slope)
    size = fft.next_fast_len(len(t), real=True)
    omega = 2.0 * np.pi * fft.rfftfreq(size, STEP * EVERY)
    gain = 1.0 / (1.0 + (omega / (2.0 * np.pi * deck.corner)) ** (2 * deck.order))
    table = np.empty((3, 3, len(t)))
    for axis in range(3):
        spectrum = fft.rfft(theta[:, axis] - line[:, axis], size) * gain
        for order in range(3):
            table[axis, order] = fft.irfft(spectrum * (1j * omega) ** order, size)[: len(t)]
        table[axis, 0] += line[:, axis]
        table[axis, 1] += slope[axis]
    return Lever(float(t[0]), table)
