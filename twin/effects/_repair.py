"""A log on its way to being compensated: what the effects' inverses work on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.trial import ImuSeries, Trial
from twin.scene import Scene

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Repair:
    """A log, the scene of its own motion and thermometers, and what was done to it, a sentence each."""

    trial: Trial
    scene: Scene
    notes: tuple[str, ...] = ()

    @property
    def sub(self) -> ImuSeries:
        """The sub-IMU as it stands."""
        return self.trial.sub

    @property
    def t(self) -> FloatArray:
        """Stamps (n,) s of the sub-IMU since the epoch."""
        return self.trial.seconds(self.trial.sub.stamp)

    def with_sub(self, **changes: Any) -> Repair:
        """With arrays of the sub-IMU replaced."""
        return replace(self, trial=replace(self.trial, sub=replace(self.trial.sub, **changes)))

    def without(self, lost: BoolArray) -> Repair:
        """With samples (n,) of the sub-IMU masked: they leave a gap."""
        keep, sub = ~lost, self.trial.sub
        attitude = None if sub.attitude is None else sub.attitude[keep]
        return self.with_sub(stamp=sub.stamp[keep], gyro=sub.gyro[keep], accel=sub.accel[keep], attitude=attitude)

    def noted(self, sentence: str) -> Repair:
        """With a sentence more."""
        return replace(self, notes=(*self.notes, sentence))


def runs(t: FloatArray) -> list[slice]:
    """The stretches of stamps (n,) s without a gap (1.5 usual steps)."""
    step = np.diff(t)
    ends = np.flatnonzero(step > 1.5 * np.median(step)) + 1 if len(step) else np.zeros(0, dtype=np.int64)
    edges = [0, *ends.tolist(), len(t)]
    return [slice(a, b) for a, b in pairwise(edges)]
