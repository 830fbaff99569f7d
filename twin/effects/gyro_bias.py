"""Constant bias of the sub-IMU's gyros."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physics.units import DEG_PER_HOUR
from twin.effects._change import added, sub_imu
from twin.effects._effect import LookAlike, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.config import Twin

BIAS = parameter("deg/h", "added to the twin's", prior=(0.01, 100.0), most=36000.0, default=0.0, neutral=0.0)


class GyroBias(PerAxis):
    """Constant biases of the sub-IMU's gyros: omega + b, beyond the twin's."""

    name: ClassVar[str] = "gyro_bias"
    x: float = BIAS
    y: float = BIAS
    z: float = BIAS
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike(
            "gyro_temperature", 0.9, "a swing of the sub-IMU's temperature, recorded: a warm-up", ("sub.temperature",)
        ),
        LookAlike("gyro_bias_instability", None, "a log of several of its time constants: a bias stays"),
    )
    advice: ClassVar[str] = "Let the sub-IMU warm up and take its biases anew alongside, or widen the twin's."

    def twin(self, twin: Twin) -> Twin:
        """Bias = the twin's + b."""
        return sub_imu(twin, gyro_bias_dph=added(twin.imu.sub.gyro_bias_dph, self.size()))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """A constant rate on each axis, per deg/h."""
        one = np.full(len(view.t), DEG_PER_HOUR)
        return tuple(Column(name, Signals(gyro=on_axis(axis, one))) for axis, name in enumerate(AXES))
