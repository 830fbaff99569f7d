"""Jitter of the sub-IMU's stamps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import NS
from schemas.trial import ImuSeries
from twin.effects._effect import STAMPS, Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.effects._repair import Repair
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

    def compensate(self, repair: Repair) -> Repair:
        """Even stamps fitted to the recorded ones: a straight line through them, lost samples counted."""
        index = numbered(repair.sub.stamp, self.std)
        middle, first = index.mean(), repair.sub.stamp[0]
        since = (repair.sub.stamp - first).astype(np.float64)
        slope = ((index - middle) @ since) / ((index - middle) @ (index - middle))
        even = first + np.rint(since.mean() + slope * (index - middle)).astype(np.int64)
        return repair.with_sub(stamp=even).noted(f"{self.name}: even stamps fitted to those of the sub-IMU")


def numbered(stamp: NDArray[np.int64], std: float) -> NDArray[np.int64]:
    """The number (n,) of each sample, those that were lost before it counted; std: s, of the jitter."""
    step = np.diff(stamp)
    period = (stamp[-1] - stamp[0]) / max(len(step), 1) if 6.0 * std / NS > np.median(step) else np.median(step)
    lost = step > 1.5 * period + 6.0 * std / NS
    count = np.where(lost, np.maximum(np.rint(step / period), 1), 1).astype(np.int64)
    return np.concatenate([[0], np.cumsum(count)])
