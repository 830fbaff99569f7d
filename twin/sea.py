"""Wave motion of the ship: sums of sines, given row by row or drawn from a spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG
from twin.config import Rows, Sea

FloatArray = NDArray[np.float64]

MOTIONS = ("pitch", "roll", "heading", "surge", "sway", "heave")
ANGULAR = ("pitch", "roll", "heading")
BAND = (0.6, 2.5)  # of the peak frequency: where lines of a spectrum are put


@dataclass(frozen=True)
class Harmonics:
    """x(t) = sum_i amplitude_i sin(omega_i t + phase_i); all (k,), amplitude in rad or m, omega rad/s, phase rad."""

    amplitude: FloatArray
    omega: FloatArray
    phase: FloatArray

    def at(self, t: FloatArray) -> FloatArray:
        """Value and first two derivatives, (n, 3), at times t (n,) s."""
        from physics.recursion import harmonic_sum

        return harmonic_sum(self.amplitude, self.omega, self.phase, np.ascontiguousarray(t, dtype=float))


def from_rows(rows: Rows, unit: float) -> Harmonics:
    """Rows of amplitude (in units of ``unit``), period s, phase deg."""
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return Harmonics(table[:, 0] * unit, 2.0 * np.pi / table[:, 1], table[:, 2] * DEG)


def jonswap(frequency: FloatArray, peak: float, enhancement: float) -> FloatArray:
    """S(f) ~ f^-5 exp(-1.25 (f_p/f)^4) gamma^r, r = exp(-(f/f_p - 1)^2 / (2 s^2)), s = 0.07 below the peak, 0.09 above.

    Shape alone, of any unit (Hasselmann et al. 1973).
    """
    x = frequency / peak
    width = np.where(x <= 1.0, 0.07, 0.09)
    return x**-5.0 * np.exp(-1.25 * x**-4.0) * enhancement ** np.exp(-((x - 1.0) ** 2) / (2.0 * width**2))


def draw(significant: float, period: float, sea: Sea, unit: float, rng: np.random.Generator) -> Harmonics:
    """Lines of a spectrum with standard deviation significant/2: one random frequency in each of equal bands."""
    edges = np.linspace(*BAND, sea.components + 1) / period
    frequency = edges[:-1] + rng.random(sea.components) * np.diff(edges)
    phase = rng.random(sea.components) * 2.0 * np.pi
    power = jonswap(frequency, 1.0 / period, sea.peak_enhancement)
    amplitude = np.sqrt(2.0 * power / power.sum()) * 0.5 * significant * unit
    return Harmonics(amplitude, 2.0 * np.pi * frequency, phase)


def realise(sea: Sea, rng: np.random.Generator) -> dict[str, Harmonics]:
    """The six motions of a sea; random only where the sea is a spectrum."""
    units = {name: DEG if name in ANGULAR else 1.0 for name in MOTIONS}
    if sea.model == "rows":
        return {name: from_rows(getattr(sea, name), units[name]) for name in MOTIONS}
    return {
        name: draw(getattr(sea, f"{name}_significant"), getattr(sea, f"{name}_period"), sea, units[name], rng)
        for name in MOTIONS
    }
