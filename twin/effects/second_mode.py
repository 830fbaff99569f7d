"""A second mode of the deck."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics import flexure, whittle
from physics.units import ARCMIN
from twin.effects._axes import along
from twin.effects._effect import Effect
from twin.effects._parameters import AXES, FLEXURE_MOST, Axis, parameter

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


class SecondMode(Effect):
    """A second mode on one axis: independent flexure with damping mu, frequency lambda and size of its own, added."""

    name: ClassVar[str] = "second_mode"
    damping: float = parameter("1/s", "mu", prior=(0.02, 1.0), least=1e-6, most=100.0, default=0.1)
    frequency: float = parameter("rad/s", "lambda", prior=(1.0, 12.0), least=0.0, most=100.0, default=3.0)
    std_arcmin: float = parameter("arcmin", "sigma", prior=(0.02, 10.0), least=0.0, most=FLEXURE_MOST, neutral=0.0)
    axis: Axis = "x"
    advice: ClassVar[str] = "Give the estimator a second flexure mode on this axis."
    bends: ClassVar[bool] = True
    stays: ClassVar[str] = "it is random, and the estimator follows it as it does the first mode"

    def flexure_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """The spectrum of the mode, exact with its aliases, added on its axis."""
        if AXES[axis] != self.axis or not self.std_arcmin:
            return density
        stiffness = self.damping**2 + self.frequency**2
        mode = whittle.increment_spectrum(omega, self.damping, stiffness, self.std_arcmin * ARCMIN, 0.0, interval)
        return density + mode / interval**2

    def flexure(self, t: FloatArray, theta: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """theta + a stationary second-order Gauss-Markov path."""
        if not self.std_arcmin:
            return theta
        stiffness = self.damping**2 + self.frequency**2
        path = flexure.sample(self.damping, stiffness, self.std_arcmin * ARCMIN, np.round(np.diff(t), 10), rng)[0]
        return theta + along(self.axis, path)
