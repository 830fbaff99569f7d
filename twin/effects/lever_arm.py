"""Error of the lever arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.effects._change import added, section
from twin.effects._effect import ACCELEROMETERS, GYROS, LookAlike, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals

if TYPE_CHECKING:
    from twin.config import Twin

METRES = parameter("m", "added to the twin's", prior=(1e-3, 1.0), most=100.0, default=0.0, neutral=0.0)

FloatArray = NDArray[np.float64]


class LeverArm(PerAxis):
    """The sub-IMU stands elsewhere than the twin says: r + e, main to sub, in m-axes."""

    name: ClassVar[str] = "lever_arm"
    x: float = METRES
    y: float = METRES
    z: float = METRES
    needs: ClassVar[tuple[str, ...]] = (*GYROS, *ACCELEROMETERS)
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("accel_scale_factor", 0.75, "motion about several axes at several frequencies: a turn, a head sea"),
    )
    advice: ClassVar[str] = "Survey the place of the sub-IMU anew and correct the lever arm in the rig profile."

    def twin(self, twin: Twin) -> Twin:
        """Lever arm = the twin's + e."""
        return section(twin, "mount", lever_arm=added(twin.mount.lever_arm, self.size()))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """omega' x e + omega x (omega x e) in s-axes, per metre along each m-axis."""
        return tuple(
            Column(name, Signals(accel=_rigid(view, np.eye(3)[axis]) @ view.R_m_s)) for axis, name in enumerate(AXES)
        )


def _rigid(view: LogView, arm: FloatArray) -> FloatArray:
    omega = view.omega_m
    return np.asarray(np.cross(view.omega_dot_m, arm) + np.cross(omega, np.cross(omega, arm)))
