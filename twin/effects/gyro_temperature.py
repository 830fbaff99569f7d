"""Bias of the sub-IMU's gyros that follows temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG_PER_HOUR
from twin.effects._effect import GYROS, TEMPERATURE, Effect
from twin.effects._parameters import AXES, Vector, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

REFERENCE = 20.0  # deg C, where the twin's biases hold


class GyroTemperature(Effect):
    """Biases of the sub-IMU's gyros that follow its temperature: omega + slope (T - 20 deg C)."""

    name: ClassVar[str] = "gyro_temperature"
    slope: Vector = parameter("deg/h/K", "per axis", prior=(1e-3, 5.0), most=3600.0, neutral=0.0)
    needs: ClassVar[tuple[str, ...]] = (*GYROS, *TEMPERATURE)
    advice: ClassVar[str] = "Compensate the sub-IMU's gyros with its thermometer, or wait until it is warm."

    def gyro(
        self, unit: str, t: FloatArray, gyro: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """omega + slope (T - 20), T the true temperature."""
        if unit != "sub" or not any(self.slope):
            return gyro
        warmth = scene.temperature("sub", t) - REFERENCE
        return gyro + np.outer(warmth, np.array(self.slope) * DEG_PER_HOUR)

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """A rate in proportion to the temperature's difference from 20 deg C, per deg/h/K; nothing without one."""
        if view.temperature_sub is None:
            return ()
        warmth = DEG_PER_HOUR * (view.temperature_sub - REFERENCE)
        return tuple(Column(f"slope.{name}", Signals(gyro=on_axis(axis, warmth))) for axis, name in enumerate(AXES))

    def compensate(self, repair: Repair) -> Repair:
        """omega - slope (T - 20), T by the sub-IMU's thermometer, else by the twin."""
        warmth = repair.scene.temperature("sub", repair.t) - REFERENCE
        repair = repair.with_sub(gyro=repair.sub.gyro - np.outer(warmth, np.array(self.slope) * DEG_PER_HOUR))
        source = "thermometer" if "sub" in repair.scene.thermometers else "temperature in the twin (none is recorded)"
        return repair.noted(f"{self.name}: taken out of the sub-IMU's gyros by its {source}")
