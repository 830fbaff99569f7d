"""Slowly wandering bias of the sub-IMU's gyros."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG_PER_HOUR
from twin.effects._effect import Effect, LookAlike
from twin.effects._parameters import parameter
from twin.sensors import markov

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


class GyroBiasInstability(Effect):
    """Biases of the sub-IMU's gyros that wander: first-order Gauss-Markov, E[b(t) b(t + u)] = std^2 exp(-|u|/tau)."""

    name: ClassVar[str] = "gyro_bias_instability"
    std: float = parameter("deg/h", "of each axis", prior=(0.01, 20.0), least=0.0, most=36000.0, neutral=0.0)
    tau: float = parameter("s", "time constant", prior=(10.0, 3600.0), least=1e-3, most=1e7, default=300.0)
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike(
            "gyro_temperature", None, "the sub-IMU's temperature, and a warm-up that repeats", ("sub.temperature",)
        ),
    )
    advice: ClassVar[str] = "Model the bias as a Gauss-Markov process in the estimator, or fit steadier gyros."
    stays: ClassVar[str] = "it is random, and the estimator lets the biases wander"

    def noise_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """First-order Gauss-Markov, sampled: std^2 (1 - a^2) / (1 - 2 a cos w + a^2), a = exp(-interval/tau)."""
        a = np.exp(-interval / self.tau)
        markov_power = (1.0 - a * a) / (1.0 - 2.0 * a * np.cos(omega) + a * a)
        return density + (self.std * DEG_PER_HOUR) ** 2 * markov_power

    def gyro(
        self, unit: str, t: FloatArray, gyro: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """omega + b(t), stationary from the start, the axes independent."""
        if unit != "sub" or not self.std:
            return gyro
        std = [self.std * DEG_PER_HOUR] * 3
        return gyro + markov(len(gyro), 1.0 / scene.twin.run.rate, std, self.tau, rng)
