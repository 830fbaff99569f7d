"""Error of the static angle."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from physics.units import ARCMIN
from twin.effects._change import added, section
from twin.effects._effect import LookAlike, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.config import Twin

ANGLE = parameter("arcmin", "added to the twin's", prior=(1.0, 300.0), most=5400.0, default=0.0, neutral=0.0)


class StaticMisalignment(PerAxis):
    """The static angle is another than the twin says: Phi + e, as a sum of vectors."""

    name: ClassVar[str] = "static_misalignment"
    x: float = ANGLE
    y: float = ANGLE
    z: float = ANGLE
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("thermal_bending", 0.9, "a log of at least a period of the bending"),
    )
    advice: ClassVar[str] = "Take the static angle anew alongside; the estimate absorbs it and is not the worse for it."
    bends: ClassVar[bool] = True

    def twin(self, twin: Twin) -> Twin:
        """Phi = the twin's + e."""
        return section(twin, "mount", static_arcmin=added(twin.mount.static_arcmin, self.size()))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """A constant angle about each m-axis, per arcmin."""
        one = np.full(len(view.t), ARCMIN)
        return tuple(Column(name, Signals(mount=on_axis(axis, one))) for axis, name in enumerate(AXES))
