"""Range of the sub-IMU's gyros."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physics.units import DEG
from schemas.trial import ImuSeries
from twin.effects._effect import Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.scene import Scene


class GyroSaturation(Effect):
    """Gyros of the sub-IMU that stop at their range: rates held within -limit .. limit."""

    name: ClassVar[str] = "gyro_saturation"
    limit: float = parameter("deg/s", "of each axis", prior=(0.5, 500.0), least=1e-6, most=inf, neutral=inf)
    needs: ClassVar[tuple[str, ...]] = ("sub.gyro",)
    advice: ClassVar[str] = "Choose a wider range of the sub-IMU's gyros; what was clipped is lost."

    def imu(self, unit: str, series: ImuSeries, scene: Scene, rng: np.random.Generator) -> ImuSeries:
        """Rates clipped, noise and all."""
        if unit != "sub":
            return series
        return replace(series, gyro=np.clip(series.gyro, -self.limit * DEG, self.limit * DEG))
