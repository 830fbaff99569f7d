"""The sea behind the seal: wind sea and swell as lines of equal energy, each with a random frequency in its share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SHORTEST = 2.2  # s, shortest period of a line
STEEPEST = 3.5  # of the peak frequency, where the wind sea is cut off


@dataclass(frozen=True)
class Lines:
    """x(t) = sum_i a_i sin(w_i t + p_i); all (k,), amplitude in rad, m or m/s, omega rad/s, phase rad."""

    amplitude: FloatArray
    omega: FloatArray
    phase: FloatArray

    def at(self, t: FloatArray) -> FloatArray:
        """Value and first two derivatives (3, n) at times t (n,) s."""
        out = np.zeros((3, len(t)))
        for a, w, p in zip(self.amplitude, self.omega, self.phase):
            sine, cosine = np.sin(w * t + p), np.cos(w * t + p)
            out[0] += a * sine
            out[1] += (a * w) * cosine
            out[2] -= (a * w * w) * sine
        return out

    def rate(self) -> Lines:
        """The derivative, as lines."""
        return Lines(self.amplitude * self.omega, self.omega, self.phase + 0.5 * np.pi)

    @property
    def rms(self) -> float:
        """Root mean square over a long time."""
        return float(np.sqrt(0.5 * np.sum(self.amplitude**2)))

    def __add__(self, other: Lines) -> Lines:
        pairs = zip((self.amplitude, self.omega, self.phase), (other.amplitude, other.omega, other.phase))
        return Lines(*(np.concatenate(pair) for pair in pairs))


def none() -> Lines:
    """No motion."""
    return Lines(np.zeros(0), np.zeros(0), np.zeros(0))


def wind_sea(std: float, period: float, count: int, rng: np.random.Generator) -> Lines:
    """Bretschneider's spectrum S(w) ~ w^-5 exp(-1.25 (w_p/w)^4), standard deviation ``std``, peak ``period`` s.

    Its distribution is exp(-1.25 (w_p/w)^4), so that a line of each equal share of the energy is drawn by inversion.
    """
    peak = 2.0 * np.pi / period
    ceiling = np.exp(-1.25 * max(STEEPEST, 1.5) ** -4.0)
    share = (np.arange(count) + rng.uniform(0.02, 0.98, count)) / count * ceiling
    omega = np.minimum(peak * (-np.log(share) / 1.25) ** -0.25, 2.0 * np.pi / SHORTEST)
    return Lines(np.full(count, std * np.sqrt(2.0 / count)), omega, rng.uniform(0.0, 2.0 * np.pi, count))


def swell(std: float, period: float, count: int, rng: np.random.Generator) -> Lines:
    """A narrow bell of 8 % about the peak ``period`` s."""
    omega = 2.0 * np.pi / period * np.maximum(1.0 + 0.08 * rng.standard_normal(count), 0.6)
    return Lines(np.full(count, std * np.sqrt(2.0 / count)), omega, rng.uniform(0.0, 2.0 * np.pi, count))


def mixed(std: float, period: float, share: float, rng: np.random.Generator) -> Lines:
    """Wind sea with a share (0..1) of the variance in a swell of a longer period."""
    wind = wind_sea(std * np.sqrt(1.0 - share), period, 36, rng)
    return wind + swell(std * np.sqrt(share), period * rng.uniform(1.4, 1.9), 12, rng)
