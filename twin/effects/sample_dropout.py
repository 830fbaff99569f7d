"""Lost samples of the sub-IMU."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from schemas.errors import DataError
from schemas.trial import ImuSeries
from twin.effects._effect import STAMPS, Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.scene import Scene


class SampleDropout(Effect):
    """Runs of lost sub-IMU samples at random times (Poisson): rate of runs and length of each."""

    name: ClassVar[str] = "sample_dropout"
    rate: float = parameter("1/s", "of runs", prior=(1e-3, 1.0), least=0.0, most=50.0, neutral=0.0)
    length: int = parameter("samples", "of each run", prior=(1.0, 100.0), least=0, most=1e6, default=1, neutral=0)
    needs: ClassVar[tuple[str, ...]] = STAMPS
    advice: ClassVar[str] = "Look for a full buffer or a poor link between the sub-IMU and the recorder."
    stays: ClassVar[str] = "what was lost stays lost, and the estimator bridges the gaps"

    def imu(self, unit: str, series: ImuSeries, scene: Scene, rng: np.random.Generator) -> ImuSeries:
        """The series without the samples of the runs."""
        if unit != "sub" or not self.rate or not self.length:
            return series
        n = len(series)
        starts = np.flatnonzero(rng.random(n) < -np.expm1(-self.rate / scene.twin.run.rate))
        covered = np.zeros(n + 1, dtype=np.int64)
        np.add.at(covered, starts, 1)
        np.add.at(covered, np.minimum(starts + self.length, n), -1)
        kept = np.cumsum(covered[:n]) == 0
        if kept.sum() < 2:
            raise DataError("effect 'sample_dropout' leaves no samples of the sub-IMU", channel="sub")
        return replace(series, stamp=series.stamp[kept], gyro=series.gyro[kept], accel=series.accel[kept])
