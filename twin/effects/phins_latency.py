"""Latency of the PHINS."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.effects._effect import GYROS, PHINS, Effect
from twin.effects._parameters import parameter
from twin.effects._prediction import Column, LogView, Signals

FloatArray = NDArray[np.float64]


class PhinsLatency(Effect):
    """Attitudes of both PHINS that are late: stamped t, they are of t - delay."""

    name: ClassVar[str] = "phins_latency"
    delay: float = parameter("s", "of both units", prior=(1e-5, 0.2), most=5.0, neutral=0.0)
    needs: ClassVar[tuple[str, ...]] = (*GYROS, *PHINS)
    advice: ClassVar[str] = (
        "Have the PHINS stamp its data at the time of validity, or enter the latency in the rig profile."
    )

    def phins_clock(self, unit: str, t: FloatArray) -> FloatArray:
        """t - delay."""
        return t - self.delay if self.delay else t

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """Both attitudes move by -delay times their rate, per second: flexure in their difference, the ship in each."""
        return (Column("delay", Signals(phins=-view.theta_dot, phins_main=-view.omega_m)),)
