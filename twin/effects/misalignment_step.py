"""A step of the static angle."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCMIN
from twin.effects._effect import PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

ANGLE = parameter("arcmin", "of the step", prior=(0.1, 60.0), most=5400.0, default=0.0, neutral=0.0)


class MisalignmentStep(PerAxis):
    """The mounting of the sub-IMU slips once: Phi + e from a time on."""

    name: ClassVar[str] = "misalignment_step"
    x: float = ANGLE
    y: float = ANGLE
    z: float = ANGLE
    time: float = parameter("s", "of the step, since the start", prior=(0.0, 7200.0), least=0.0, most=1e7)
    advice: ClassVar[str] = "Check the fastening of the sub-IMU and treat the log before and after as two."
    bends: ClassVar[bool] = True

    def mount(self, t: FloatArray, phi: FloatArray, scene: Scene) -> FloatArray:
        """Phi + e where t > time; the lever arm stays."""
        return phi + np.outer(t > self.time, self.size(ARCMIN))

    @classmethod
    def predict(cls, view: LogView, *, time: float = 0.0) -> tuple[Column, ...]:
        """An angle from a time on, per arcmin about each m-axis."""
        after = ARCMIN * (view.t > time).astype(np.float64)
        return tuple(
            Column(name, Signals(mount=on_axis(axis, after)), {"time": time}) for axis, name in enumerate(AXES)
        )
