"""Bending that follows the waves."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCMIN, DEG
from twin.effects._effect import LookAlike, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

SHARE = parameter(
    "arcmin/deg", "of flexure per degree of roll", prior=(0.01, 5.0), most=600.0, default=0.0, neutral=0.0
)


class WaveForcedBending(PerAxis):
    """Bending that follows the roll at once: theta + k roll."""

    name: ClassVar[str] = "wave_forced_bending"
    x: float = SHARE
    y: float = SHARE
    z: float = SHARE
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("heel_bending", None, "a lasting heel, in a turn: its lag of 20 s then shows"),
        LookAlike(
            "gyro_scale_factor",
            None,
            "the accelerometers and PHINS, which see bending but no error of the gyros",
            ("sub.accel", "phins_sub.attitude"),
        ),
    )
    advice: ClassVar[str] = (
        "Model bending in proportion to roll in the estimator; with gyros alone it hurts before it shows."
    )
    bends: ClassVar[bool] = True
    foretold: ClassVar[bool] = True

    def flexure(self, t: FloatArray, theta: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """theta + k roll(t)."""
        if not self.size().any():
            return theta
        return theta + np.outer(scene.angles(t)[:, 1] / DEG, self.size(ARCMIN))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """Bending in proportion to roll, per arcmin/deg about each axis; nothing where roll is not known."""
        if view.roll is None:
            return ()
        share = ARCMIN / DEG * view.roll
        return tuple(Column(name, Signals(bending=on_axis(axis, share))) for axis, name in enumerate(AXES))
