"""A deck that grows stiffer as it bends."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from physics.units import ARCMIN
from twin.effects._effect import Effect
from twin.effects._parameters import parameter
from twin.effects._prediction import Column, LogView, Signals

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

POINTS = 4001  # at which the law of the deflection is tabulated, over eight standard deviations


class AmplitudeStiffening(Effect):
    """Stiffness that grows with deflection: theta'' + 2 mu theta' + b^2 (1 + gain theta^2) theta = w, per axis."""

    name: ClassVar[str] = "amplitude_stiffening"
    gain: float = parameter("1/arcmin^2", "of each axis", prior=(1e-3, 0.5), least=0.0, most=100.0, neutral=0.0)
    advice: ClassVar[str] = (
        "Identify the flexure in calm and rough parts apart, or let its stiffness depend on the size."
    )
    bends: ClassVar[bool] = True
    stays: ClassVar[str] = "the random flexure is followed, stiffened or not"

    def sea_flexure(self, t: FloatArray, theta: FloatArray, scene: Scene) -> FloatArray:
        """The stiffened answer to the same forcing: theta + d, d'' + 2 mu d' + b^2 d = -b^2 gain (theta + d)^3."""
        from physics.recursion import stiffening_excess

        belief, gain = scene.twin.flexure, self.gain / ARCMIN**2
        out = theta.copy()
        for axis in range(3):
            damping, std = belief.damping[axis], belief.std_arcmin[axis] * ARCMIN
            if gain == 0.0 or std == 0.0:
                continue
            stiffness = damping**2 + belief.frequency[axis] ** 2
            path = np.ascontiguousarray(theta[:, axis])
            start = stationary(path[0], std, gain) - path[0]
            out[:, axis] += stiffening_excess(t, path, damping, stiffness, gain, start)
        return out

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """The answer d to the lacking restoring moment, d'' + 2 mu d' + b^2 d = -b_twin^2 theta^3, per 1/arcmin^2.

        theta is the one that is seen, stiffened, as foretold from before each step, so that it holds none of the noise
        of that step: with mu and b of the model that whitens it this is exact.
        """
        from physics.flexure import driven

        moment = -view.stiffness * view.foretold[0] ** 3 / ARCMIN**2
        answer = [driven(mu, b2, view.interval, w) for mu, b2, w in zip(*view.answering, moment.T)]
        return (Column("gain", Signals(bending=np.stack(answer, axis=1))),)


def stationary(theta: float, std: float, gain: float) -> float:
    """The deflection as probable under p ~ exp(-(x^2/2 + gain x^4/4)/std^2) as theta is without stiffening.

    The rate of a stiffened axis under white forcing is as it was (Caughey 1963), so this start is a stationary one.
    """
    x = std * np.linspace(-8.0, 8.0, POINTS)
    density = np.exp(-(0.5 * x**2 + 0.25 * gain * x**4) / std**2)
    share = np.cumsum(density) - 0.5 * density
    return float(np.interp(ndtr(theta / std), share / density.sum(), x))
