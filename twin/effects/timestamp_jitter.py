"""Jitter of the sub-IMU's stamps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physics.units import NS
from schemas.trial import ImuSeries
from twin.effects._effect import STAMPS, Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.scene import Scene


class TimestampJitter(Effect):
    """Stamps of the sub-IMU scatter about the true times, as a driver stamps that stamps on arrival: in order."""

    name: ClassVar[str] = "timestamp_jitter"
    std: float = parameter("s", "standard deviation, white", prior=(1e-5, 0.01), least=0.0, most=1.0, neutral=0.0)
    needs: ClassVar[tuple[str, ...]] = STAMPS
    advice: ClassVar[str] = "Stamp in hardware at the moment of measurement, or fit even stamps to the recorded ones."

    def imu(self, unit: str, series: ImuSeries, scene: Scene, rng: np.random.Generator) -> ImuSeries:
        """Stamps with white errors, then put in order and at least a nanosecond apart."""
        if unit != "sub" or not self.std:
            return series
        late = np.rint(self.std / NS * rng.standard_normal(len(series))).astype(np.int64)
        index = np.arange(len(series))
        stamp = np.maximum.accumulate(np.sort(series.stamp + late) - index) + index
        return replace(series, stamp=stamp)
