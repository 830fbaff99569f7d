"""Outliers of the sub-IMU's gyros."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from physics.units import DEG
from schemas.trial import ImuSeries
from twin import sensors
from twin.effects._effect import Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

LEAST = 0.4  # of the mean size: no outlier is smaller than half
SIGMAS = 6.0
ROUNDS = 5  # outliers beside each other take turns


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

    def compensate(self, repair: Repair) -> Repair:
        """Single samples that stand out put on the cubic through the two before and the two after."""
        gyro, count = cleaned(repair.sub.gyro, LEAST * self.size * DEG)
        told = f"{self.name}: {count} samples of the sub-IMU's gyros replaced by what their neighbours say"
        return repair.with_sub(gyro=gyro).noted(told)


def cleaned(gyro: FloatArray, least: float) -> tuple[FloatArray, int]:
    """Rates (n, 3) rad/s without single samples off by ``least`` and SIGMAS of their axis's spread, and how many."""
    gyro, count = gyro.copy(), 0
    for column in gyro.T:
        limit = max(least, SIGMAS * 1.4826 * float(np.median(np.abs(_departure(column)))))
        for _ in range(ROUNDS):
            off = np.abs(_departure(column))
            wild = np.flatnonzero((off > limit) & (off >= maximum_filter1d(off, 5)))
            if not len(wild):
                break
            column[wild] -= _departure(column)[wild]
            count += len(wild)
    return gyro, count


def _departure(x: FloatArray) -> FloatArray:
    """x less the cubic through the four neighbours (n,); at the ends less the mirrored signal's."""
    y = np.pad(x, 2, mode="reflect", reflect_type="odd")
    return x - (4.0 * (y[1:-3] + y[3:-1]) - y[:-4] - y[4:]) / 6.0
