"""Scale factor of the sub-IMU's accelerometers."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import PPM
from twin.effects._effect import ACCELEROMETERS, LookAlike, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

SCALE = parameter("ppm", "of each axis", prior=(20.0, 5000.0), most=1e5, default=0.0, neutral=0.0)


class AccelScaleFactor(PerAxis):
    """Scale factor errors of the sub-IMU's accelerometers: f_i (1 + s_i)."""

    name: ClassVar[str] = "accel_scale_factor"
    x: float = SCALE
    y: float = SCALE
    z: float = SCALE
    needs: ClassVar[tuple[str, ...]] = ACCELEROMETERS
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("accel_bias", 1.0, "heave or heel, which change the force along z (f_z is nearly g otherwise)"),
    )
    advice: ClassVar[str] = "Calibrate the sub-IMU's accelerometers in several positions."

    def accel(self, unit: str, t: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """f (1 + s)."""
        return accel * (1.0 + self.size(PPM)) if unit == "sub" else accel

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """The force of each axis, per ppm."""
        return tuple(
            Column(name, Signals(accel=on_axis(axis, PPM * view.force_s[:, axis]))) for axis, name in enumerate(AXES)
        )

    def compensate(self, repair: Repair) -> Repair:
        """f / (1 + s)."""
        return repair.with_sub(accel=repair.sub.accel / (1.0 + self.size(PPM)))
