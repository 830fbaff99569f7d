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
    from twin.effects._repair import Repair
    from twin.scene import Scene

CLIPPED = 1e-6  # of the limit: samples closer to it are clipped


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

    def compensate(self, repair: Repair) -> Repair:
        """Clipped samples masked: what went beyond the range is lost."""
        clipped = np.abs(repair.sub.gyro).max(axis=1) >= self.limit * DEG * (1.0 - CLIPPED)
        if clipped.all():
            return repair.noted(f"{self.name}: left in; every sample of the sub-IMU is clipped")
        told = f"{self.name}: {np.count_nonzero(clipped)} clipped samples of the sub-IMU masked"
        return repair.without(clipped).noted(told)
