"""How a hidden effect acts on reality: the hooks of a cause, all of which leave things alone unless overridden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.blind.reality.flexure import Bend, Restoring
from pipeline.blind.reality.motion import ShipPath
from pipeline.blind.reality.nature import Nature
from schemas.trial import ImuSeries

FloatArray = NDArray[np.float64]

AXES = "xyz"


@dataclass(frozen=True)
class Seen:
    """What the sub-IMU would write at stamps t (n,) s without errors: gyro (n, 3) rad/s, force (n, 3) m/s^2."""

    t: FloatArray
    gyro: FloatArray
    force: FloatArray
    nature: Nature


@dataclass(frozen=True)
class Cause:
    """One effect with the parameters of the log contract, in its units.

    listed: it is in the contract's list.
    """

    parameters: dict[str, Any]
    listed: ClassVar[bool] = True

    def vector(self, key: str = "") -> FloatArray:
        """(3,) of x, y, z, or of the list under ``key``."""
        if key:
            return np.array(self.parameters[key], dtype=float)
        return np.array([float(self.parameters.get(axis, 0.0)) for axis in AXES])

    def number(self, key: str) -> float:
        """A scalar parameter."""
        return float(self.parameters[key])

    @property
    def axis(self) -> int:
        """Index of the axis it acts about."""
        return AXES.index(self.parameters.get("axis", "x"))

    def nature(self, nature: Nature) -> Nature:
        """Parameters of ship, deck or sensors changed."""
        return nature

    def sub_clock(self, t: FloatArray) -> FloatArray:
        """When the sub-IMU measured what it stamps t (delay of reality excluded)."""
        return t

    def phins_clock(self, t: FloatArray) -> FloatArray:
        """When the attitudes stamped t were taken."""
        return t

    def strength(self, t: FloatArray, nature: Nature) -> FloatArray:
        """Factor (n,) on the forcing of the flexure."""
        return np.ones(len(t))

    def restoring(self, axis: int, nature: Nature) -> Restoring | None:
        """Another law of the restoring moment."""
        return None

    def reshape(self, t: FloatArray, path: FloatArray, nature: Nature, rng: np.random.Generator) -> FloatArray:
        """The random path (k, 3) on the grid of the integration, replaced."""
        return path

    def bend(self, ship: ShipPath, nature: Nature, rng: np.random.Generator) -> Bend | None:
        """Bending added to the flexure, (n, 3) rad as a function of t."""
        return None

    def mount(self, t: FloatArray) -> FloatArray | None:
        """Added to the static angle, (n, 3) rad."""
        return None

    def rate(self, seen: Seen, rng: np.random.Generator) -> FloatArray:
        """Mean rates (n, 3) of the sub-IMU before its own errors."""
        return seen.gyro

    def force(self, force: FloatArray) -> FloatArray:
        """Mean specific force (n, 3) on the sub-IMU before its own errors."""
        return force

    def cutoff(self) -> float:
        """Hz of a low-pass in the sub-IMU's gyros."""
        return float("inf")

    def attitude(self, t: FloatArray) -> FloatArray | None:
        """Error (n, 3) rad in m-axes of the attitude of the PHINS at the sub-IMU."""
        return None

    def finish(self, series: ImuSeries, nature: Nature, rng: np.random.Generator) -> ImuSeries:
        """The sub-IMU's series as recorded."""
        return series
