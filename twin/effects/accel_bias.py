"""Constant bias of the sub-IMU's accelerometers."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physics.units import MICRO_G
from twin.effects._change import added, sub_imu
from twin.effects._effect import ACCELEROMETERS, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.config import Twin

BIAS = parameter("ug", "added to the twin's", prior=(20.0, 10000.0), most=1e6, default=0.0, neutral=0.0)


class AccelBias(PerAxis):
    """Constant biases of the sub-IMU's accelerometers: f + b, beyond the twin's."""

    name: ClassVar[str] = "accel_bias"
    x: float = BIAS
    y: float = BIAS
    z: float = BIAS
    needs: ClassVar[tuple[str, ...]] = ACCELEROMETERS
    advice: ClassVar[str] = "Calibrate the sub-IMU's accelerometers in several positions, or widen the twin's biases."

    def twin(self, twin: Twin) -> Twin:
        """Bias = the twin's + b."""
        return sub_imu(twin, accel_bias_ug=added(twin.imu.sub.accel_bias_ug, self.size()))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """A constant force on each axis, per micro-g."""
        one = np.full(len(view.t), MICRO_G)
        return tuple(Column(name, Signals(accel=on_axis(axis, one))) for axis, name in enumerate(AXES))
