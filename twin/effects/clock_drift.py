"""Drift of the sub-IMU's clock."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import PPM
from twin.effects._effect import Effect
from twin.effects._parameters import parameter
from twin.effects._prediction import Column, LogView, Signals

FloatArray = NDArray[np.float64]


class ClockDrift(Effect):
    """The sub-IMU's clock runs fast by drift: a sample stamped t was measured at t / (1 + drift)."""

    name: ClassVar[str] = "clock_drift"
    drift: float = parameter(
        "ppm", "of the sub-IMU's clock; above 0 the delay grows", prior=(0.01, 100.0), most=1e4, neutral=0.0
    )
    advice: ClassVar[str] = "Discipline the sub-IMU's clock (PTP or a common pulse), or align the log in pieces."

    def sub_clock(self, t: FloatArray) -> FloatArray:
        """True time at the clock's time t; both agree at the start."""
        return t / (1.0 + self.drift * PPM) if self.drift else t

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """A delay that grows from 0 at the start, per ppm."""
        delay = PPM * view.t[:, None]
        return (Column("drift", Signals(gyro=-delay * view.omega_dot_s, accel=-delay * view.jerk_s)),)
