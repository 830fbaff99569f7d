"""What an effect or a sensor may ask about the simulated world."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.config import Twin
from twin.motion import Motion

FloatArray = NDArray[np.float64]

SLAB = 1 << 15  # samples worked on at a time: what bounds the memory of a long record


class Moving(Protocol):
    """A ship whose motion is known at any time: a simulated one, or that of a log."""

    def at(self, t: FloatArray) -> Motion:
        """Everything at times t (n,) s."""

    def angles(self, t: FloatArray) -> FloatArray:
        """Pitch, roll and heading (n, 3) rad at times t (n,) s."""


@dataclass(frozen=True)
class Scene:
    """The ship and its instruments' surroundings; times in s since the epoch.

    thermometers: temperature (deg C) of ``main`` or ``sub`` as recorded; for others the twin says it.
    """

    twin: Twin
    ship: Moving
    thermometers: Mapping[str, Callable[[FloatArray], FloatArray]] = field(default_factory=dict)

    def motion(self, t: FloatArray) -> Motion:
        """Full motion of the main IMU at t (n,); for long records ask in slabs."""
        return self.ship.at(t)

    def angles(self, t: FloatArray) -> FloatArray:
        """Pitch, roll, heading (n, 3) rad."""
        return self.ship.angles(t)

    def specific_force(self, t: FloatArray) -> FloatArray:
        """Specific force at the main IMU (n, 3) m/s^2, m-axes."""
        parts = [self.ship.at(t[k : k + SLAB]).specific_force for k in range(0, len(t), SLAB)]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    def temperature(self, unit: str, t: FloatArray) -> FloatArray:
        """Temperature (n,) deg C of ``main`` or ``sub``: start + rise (1 - exp(-t/tau)) + swing sin(2 pi t/period)."""
        if unit in self.thermometers:
            return self.thermometers[unit](t)
        belief = self.twin.temperature
        rise = belief.rise_sub if unit == "sub" else belief.rise_main
        swing = belief.swing * np.sin(2.0 * np.pi * t / belief.swing_period)
        return belief.start - rise * np.expm1(-t / belief.tau) + swing
