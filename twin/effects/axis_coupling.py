"""Flexure whose axes are forced together."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import model_validator

from twin.effects._change import added, section
from twin.effects._effect import Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.config import Twin

CORRELATION = parameter(
    "", "of the forcing, added to the twin's", prior=(0.02, 0.95), most=1.0, default=0.0, neutral=0.0
)


class AxisCoupling(Effect):
    """Axes of the flexure forced together: correlation of the white angular accelerations of two axes."""

    name: ClassVar[str] = "axis_coupling"
    xy: float = CORRELATION
    xz: float = CORRELATION
    yz: float = CORRELATION
    advice: ClassVar[str] = "Let the estimator's process noise carry the correlation of the axes."
    bends: ClassVar[bool] = True
    stays: ClassVar[str] = "the random flexure is followed on each axis, coupled or not"

    @model_validator(mode="after")
    def _possible(self) -> AxisCoupling:
        matrix = np.array([[1.0, self.xy, self.xz], [self.xy, 1.0, self.yz], [self.xz, self.yz, 1.0]])
        if np.linalg.eigvalsh(matrix)[0] < 0.0:
            raise ValueError("no three axes have such correlations")
        return self

    def twin(self, twin: Twin) -> Twin:
        """Correlation = the twin's + rho, within -1 .. 1."""
        rho = added(twin.flexure.correlation, (self.xy, self.xz, self.yz))
        return section(twin, "flexure", correlation=tuple(float(np.clip(value, -1.0, 1.0)) for value in rho))
