"""Constant time delay of the sub-IMU."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from twin.effects._change import section
from twin.effects._effect import Effect, LookAlike
from twin.effects._parameters import parameter
from twin.effects._prediction import Column, LogView, Signals

if TYPE_CHECKING:
    from twin.config import Twin


class TimeDelay(Effect):
    """A sub-IMU sample stamped t was measured at t - delay, beyond the delay of the twin."""

    name: ClassVar[str] = "time_delay"
    delay: float = parameter("s", "added to the twin's delay", prior=(1e-5, 0.2), most=5.0, neutral=0.0)
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("gyro_bandwidth", 1.0, "the sub-IMU's accelerometers, which a delay shifts too", ("sub.accel",)),
        LookAlike("phins_latency", 0.99, "the sub-IMU's accelerometers, which a PHINS latency leaves", ("sub.accel",)),
        LookAlike("clock_drift", 0.76, "a longer log: a delay is there from the start, a drift grows"),
    )
    advice: ClassVar[str] = (
        "Check the trigger and the transport of the sub-IMU's data, or enter the delay in the rig profile."
    )

    def twin(self, twin: Twin) -> Twin:
        """Delay = the twin's + delay."""
        return section(twin, "mount", time_delay=twin.mount.time_delay + self.delay)

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """The sub-IMU's samples move by -delay times their derivative, per second of delay."""
        return (Column("delay", Signals(gyro=-view.omega_dot_s, accel=-view.jerk_s)),)
