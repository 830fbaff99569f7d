"""Sensitivity of the sub-IMU's gyros to specific force."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG_PER_HOUR, STANDARD_GRAVITY
from twin.effects._effect import ACCELEROMETERS, GYROS, LookAlike, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

SENSITIVITY = parameter("deg/h/g", "of the axis's own force", prior=(0.01, 100.0), most=1e4, default=0.0, neutral=0.0)


class GyroGSensitivity(PerAxis):
    """Rates of the sub-IMU that follow the specific force along the same axis: omega_i + k_i f_i / g."""

    name: ClassVar[str] = "gyro_g_sensitivity"
    x: float = SENSITIVITY
    y: float = SENSITIVITY
    z: float = SENSITIVITY
    needs: ClassVar[tuple[str, ...]] = (*GYROS, ACCELEROMETERS[1])
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("gyro_bias", 1.0, "heave or heel, which change the force along z (f_z is nearly g otherwise)"),
    )
    advice: ClassVar[str] = "Measure the gyros' g-sensitivity by turning the unit over, and compensate it."

    def gyro(
        self, unit: str, t: FloatArray, gyro: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """omega + k f, f the true specific force in the sub-IMU's own axes."""
        if unit != "sub":
            return gyro
        return gyro + accel * self.size(DEG_PER_HOUR / STANDARD_GRAVITY)

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """The force of each axis in its own rate, per deg/h/g."""
        unit = DEG_PER_HOUR / STANDARD_GRAVITY
        return tuple(
            Column(name, Signals(gyro=on_axis(axis, unit * view.force_s[:, axis]))) for axis, name in enumerate(AXES)
        )

    def compensate(self, repair: Repair) -> Repair:
        """omega - k f, f as measured."""
        return repair.with_sub(gyro=repair.sub.gyro - repair.sub.accel * self.size(DEG_PER_HOUR / STANDARD_GRAVITY))
