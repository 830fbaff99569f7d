"""Scale factor of the sub-IMU's gyros."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from physics.units import PPM
from twin.effects._change import added, sub_imu
from twin.effects._effect import PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.config import Twin

SCALE = parameter("ppm", "added to the twin's", prior=(10.0, 5000.0), most=1e5, default=0.0, neutral=0.0)


class GyroScaleFactor(PerAxis):
    """Scale factor errors of the sub-IMU's gyros: omega_i (1 + s_i), beyond the twin's."""

    name: ClassVar[str] = "gyro_scale_factor"
    x: float = SCALE
    y: float = SCALE
    z: float = SCALE
    advice: ClassVar[str] = "Calibrate the sub-IMU's gyros on a rate table; a turn of the ship confirms the z axis."

    def twin(self, twin: Twin) -> Twin:
        """Scale = the twin's + s."""
        return sub_imu(twin, gyro_scale_ppm=added(twin.imu.sub.gyro_scale_ppm, self.size()))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """The rate of each axis, per ppm."""
        return tuple(
            Column(name, Signals(gyro=on_axis(axis, PPM * view.omega_s[:, axis]))) for axis, name in enumerate(AXES)
        )
