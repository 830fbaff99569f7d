"""A sea that grows or falls."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.effects._effect import Effect, LookAlike
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


class NonstationarySea(Effect):
    """Random flexure that grows over the log: its size goes in a line from the twin's to growth times that."""

    name: ClassVar[str] = "nonstationary_sea"
    growth: float = parameter(
        "", "size of the flexure, end over start", prior=(0.3, 5.0), least=0.0, most=100.0, neutral=1.0
    )
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("flexure_parameters", None, "a longer log: parts of it identified apart differ or do not"),
    )
    advice: ClassVar[str] = "Identify the flexure in pieces of the log, and let its size follow the sea."
    bends: ClassVar[bool] = True
    stays: ClassVar[str] = "the random flexure is followed, whatever its size"

    def flexure_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """Multiplied by the square of the size at that place."""
        return density * (1.0 + (self.growth - 1.0) * share) ** 2

    def sea_flexure(self, t: FloatArray, theta: FloatArray, scene: Scene) -> FloatArray:
        """theta (1 + (growth - 1) t / duration), held beyond the ends of the log."""
        share = np.clip(t / scene.twin.run.duration, 0.0, 1.0)
        return theta * (1.0 + (self.growth - 1.0) * share)[:, None]
