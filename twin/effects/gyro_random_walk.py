"""Angle random walk of the sub-IMU's gyros."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from twin.effects._change import sub_imu
from twin.effects._effect import Effect, LookAlike
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.config import Twin


class GyroRandomWalk(Effect):
    """White noise of the sub-IMU's gyros of another level than the twin's: arw is the total."""

    name: ClassVar[str] = "gyro_random_walk"
    arw: float = parameter("deg/sqrt(h)", "in all", prior=(1e-4, 0.5), least=0.0, most=60.0, neutral="twin")
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("flexure_parameters", 0.9, "the band from 5 to 50 Hz, where noise is flat and flexure falls"),
    )
    advice: ClassVar[str] = (
        "Compare with the Allan deviation of the unit at rest ashore; enter the level in the rig profile."
    )
    stays: ClassVar[str] = "it is noise, whose level the estimator finds in the log"

    def twin(self, twin: Twin) -> Twin:
        """ARW = arw."""
        return sub_imu(twin, gyro_arw=self.arw)
