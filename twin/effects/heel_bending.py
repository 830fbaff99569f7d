"""Bending that follows heel."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from physics.units import ARCMIN
from twin.effects._effect import ACCELEROMETERS, GYROS, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

LAG = 20.0  # s
STEP = 0.02  # s, of the grid on which the lag is worked out
SHARE = parameter(
    "arcmin/(m/s^2)", "of lateral specific force", prior=(0.1, 60.0), most=600.0, default=0.0, neutral=0.0
)


class HeelBending(PerAxis):
    """Bending that follows lateral specific force through a lag: theta + k u, 20 s u' + u = f_x."""

    name: ClassVar[str] = "heel_bending"
    x: float = SHARE
    y: float = SHARE
    z: float = SHARE
    needs: ClassVar[tuple[str, ...]] = (*GYROS, ACCELEROMETERS[0])
    advice: ClassVar[str] = "Model bending in proportion to lasting heel, and keep heel small while measuring."
    bends: ClassVar[bool] = True
    foretold: ClassVar[bool] = True

    def flexure(self, t: FloatArray, theta: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """theta + k u(t), f_x the specific force of the main IMU."""
        if not self.size().any():
            return theta
        grid = np.arange(t[0], t[-1] + 3.0 * STEP, STEP)
        lagged = lag(scene.specific_force(grid)[:, 0], STEP, LAG)
        return theta + np.outer(CubicSpline(grid, lagged)(t), self.size(ARCMIN))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """Bending that follows the lagged lateral force, per arcmin/(m/s^2) about each axis."""
        lagged = ARCMIN * lag(view.force_m[:, 0], view.interval, LAG)
        return tuple(Column(name, Signals(bending=on_axis(axis, lagged))) for axis, name in enumerate(AXES))


def lag(force: FloatArray, step: float, constant: float) -> FloatArray:
    """u (n,) with constant u' + u = force, exact for force linear between even steps.

    It starts settled: at the mean force of the first three time constants.
    """
    a = np.exp(-step / constant)
    late = constant / step * (1.0 - a)
    start = force[: max(1, round(3.0 * constant / step))].mean()
    tail, _ = lfilter([1.0 - late, late - a], [1.0, -a], force[1:], zi=[(late - a) * force[0] + a * start])
    return np.concatenate([[start], tail])
