"""Quantised output of the sub-IMU's gyros."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCSEC
from schemas.trial import ImuSeries
from twin.effects._effect import Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


class GyroQuantization(Effect):
    """Gyros of the sub-IMU that count whole steps of angle and carry the rest over to the next sample."""

    name: ClassVar[str] = "gyro_quantization"
    step: float = parameter("arcsec", "of angle per count", prior=(1e-4, 10.0), least=0.0, most=3600.0, neutral=0.0)
    needs: ClassVar[tuple[str, ...]] = ("sub.gyro",)
    advice: ClassVar[str] = "Use the unit's output of full resolution, or model the white error of angle it leaves."
    stays: ClassVar[str] = "the rest is carried over, so that its error of angle stays below a count"

    def noise_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """White errors of angle of step / sqrt(12), differenced."""
        count = self.step * ARCSEC / interval  # rad/s of one count in a sample
        return density + count**2 / 12.0 * 4.0 * np.sin(0.5 * omega) ** 2

    def imu(self, unit: str, series: ImuSeries, scene: Scene, rng: np.random.Generator) -> ImuSeries:
        """Differences of the integrated rate rounded to whole steps: increments are multiples of the step."""
        if unit != "sub" or not self.step:
            return series
        count = self.step * ARCSEC * scene.twin.run.rate  # rad/s of one count in a sample
        total = np.rint(np.cumsum(series.gyro, axis=0) / count)
        return replace(series, gyro=np.diff(total, axis=0, prepend=0.0) * count)
