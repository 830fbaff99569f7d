"""Slams of the bow."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCMIN
from twin.effects._axes import along
from twin.effects._effect import Effect
from twin.effects._parameters import AXES, Axis, parameter

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

FADED = 20.0  # time constants after which a slam is over


class Slamming(Effect):
    """Slams at random times (Poisson): each sets the deck ringing, theta' = amplitude at first, then a damped sine."""

    name: ClassVar[str] = "slamming"
    rate: float = parameter("1/min", "of slams", prior=(0.05, 20.0), least=0.0, most=600.0, neutral=0.0)
    amplitude: float = parameter("arcmin/s", "rate at first", prior=(0.5, 60.0), most=3600.0, neutral=0.0)
    frequency: float = parameter("rad/s", "of the ringing", prior=(2.0, 30.0), least=0.1, most=300.0, default=8.0)
    damping: float = parameter("1/s", "of the ringing", prior=(0.1, 5.0), least=0.01, most=100.0, default=0.5)
    axis: Axis = "x"
    advice: ClassVar[str] = "Mask the seconds after each slam, or slow down; slams carry no lasting deformation."
    bends: ClassVar[bool] = True
    stays: ClassVar[str] = "slams are real bending at unknown times, which the estimator follows"

    def flexure_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """Shot noise of the rings: rate times the squared spectrum of one, on its axis."""
        if AXES[axis] != self.axis:
            return density
        s = 1j * omega / interval
        ring = self.amplitude * ARCMIN * s / ((s + self.damping) ** 2 + self.frequency**2)
        return density + self.rate / 60.0 * np.abs(ring) ** 2 / interval

    def flexure(self, t: FloatArray, theta: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """theta + sum of A / w exp(-d (t - t_k)) sin(w (t - t_k)) after each slam t_k."""
        duration = scene.twin.run.duration
        times = np.sort(rng.uniform(0.0, duration, rng.poisson(self.rate / 60.0 * duration)))
        ring = np.zeros(len(t))
        for first in times if self.amplitude else ():
            hit = slice(*np.searchsorted(t, [first, first + FADED / self.damping]))
            after = t[hit] - first
            ring[hit] += np.exp(-self.damping * after) * np.sin(self.frequency * after)
        return theta + along(self.axis, ring * self.amplitude * ARCMIN / self.frequency)
