"""Vibration of the sub-IMU."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG
from twin.effects._axes import along
from twin.effects._effect import Effect
from twin.effects._parameters import Axis, parameter

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


class NarrowbandVibration(Effect):
    """The sub-IMU vibrates about one axis at one frequency: omega + A sin(2 pi f t + p), p random."""

    name: ClassVar[str] = "narrowband_vibration"
    frequency: float = parameter("Hz", "of the vibration", prior=(1.0, 45.0), least=0.01, most=1000.0, default=12.0)
    amplitude: float = parameter("deg/s", "of the rate", prior=(1e-5, 1.0), least=0.0, most=500.0, neutral=0.0)
    axis: Axis = "x"
    advice: ClassVar[str] = "Find the machine that runs at this frequency, or set the sub-IMU on a stiffer base."

    def gyro(
        self, unit: str, t: FloatArray, gyro: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """omega + the mean of the sine over each sample interval."""
        phase = rng.uniform(0.0, 2.0 * np.pi) if unit == "sub" else 0.0
        if unit != "sub" or not self.amplitude:
            return gyro
        step = 1.0 / scene.twin.run.rate
        mean = np.sinc(self.frequency * step) * np.sin(2.0 * np.pi * self.frequency * (t - 0.5 * step) + phase)
        return gyro + along(self.axis, self.amplitude * DEG * mean)
