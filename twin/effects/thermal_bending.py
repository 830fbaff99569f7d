"""Slow bending of the deck in the sun."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCMIN
from twin.effects._effect import Effect
from twin.effects._parameters import AXES, FLEXURE_MOST, Vector, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


class ThermalBending(Effect):
    """Slow bending of the deck, as by the sun: theta + amplitude sin(2 pi t / period)."""

    name: ClassVar[str] = "thermal_bending"
    amplitude: Vector = parameter("arcmin", "per axis", prior=(1.0, 60.0), most=FLEXURE_MOST, neutral=0.0)
    period: float = parameter("s", "of the sine", prior=(600.0, 86400.0), least=10.0, most=1e7, default=7200.0)
    advice: ClassVar[str] = (
        "Let the estimator follow a slow deformation (a quasi-static part), or measure in the shade."
    )
    bends: ClassVar[bool] = True
    foretold: ClassVar[bool] = True

    def flexure(self, t: FloatArray, theta: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """theta + a sin(2 pi t / period)."""
        return theta + np.outer(np.sin(2.0 * np.pi * t / self.period), np.array(self.amplitude) * ARCMIN)

    @classmethod
    def predict(cls, view: LogView, *, period: float = 7200.0) -> tuple[Column, ...]:
        """A sine of bending that is zero at the start, per arcmin about each axis."""
        sine = ARCMIN * np.sin(2.0 * np.pi * view.t / period)
        return tuple(
            Column(f"amplitude.{name}", Signals(bending=on_axis(axis, sine)), {"period": period})
            for axis, name in enumerate(AXES)
        )
