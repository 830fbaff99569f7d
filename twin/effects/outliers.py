"""Outliers of the sub-IMU's gyros."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG
from schemas.trial import ImuSeries
from twin import sensors
from twin.effects._effect import Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


class Outliers(Effect):
    """Single wild samples of the sub-IMU's gyros at random times (Poisson), each on one axis, of either sign."""

    name: ClassVar[str] = "outliers"
    rate: float = parameter("1/min", "of outliers", prior=(0.05, 60.0), least=0.0, most=6000.0, neutral=0.0)
    size: float = parameter(
        "deg/s", "mean size; each is of 0.5 to 1.5 times", prior=(0.01, 10.0), least=0.0, most=1000.0, neutral=0.0
    )
    needs: ClassVar[tuple[str, ...]] = ("sub.gyro",)
    advice: ClassVar[str] = "Let the estimator reject or weigh down outliers, and look for disturbance on the cable."

    def noise_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """White: a third of the outliers falls on each axis, of mean square 13/12 size^2."""
        hit = self.rate / 60.0 * interval / 3.0
        return density + hit * 13.0 / 12.0 * (self.size * DEG) ** 2

    def imu(self, unit: str, series: ImuSeries, scene: Scene, rng: np.random.Generator) -> ImuSeries:
        """Outliers added to the finished rates."""
        if unit != "sub":
            return series
        wild = sensors.outliers(len(series), scene.twin.run.rate, self.rate, self.size, rng)
        return replace(series, gyro=series.gyro + wild)
