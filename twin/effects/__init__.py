"""Effects: what reality may add to a twin.

An effect is a class with a ``name`` and keyword parameters (those of its ``[[effect]]`` table); it derives from
:class:`Effect` and overrides the hooks it acts through. A hook left alone hands back what it was given. Adding an
effect takes a file in this folder and a line in ``REGISTRY``.

The hooks are called in this order. Times are seconds since the epoch; ``scene`` answers questions about the motion at
any time; arrays are never changed in place.

=============  =====================================================================================================
twin           parameters of the twin itself: lever arm, static angle, gyro biases, flexure parameters, delay, ...
sub_clock      when the sub-IMU really measured what it stamps t (intervals and rotation increments follow exactly)
phins_clock    the same for the attitudes of a PHINS (``unit`` is ``phins_main`` or ``phins_sub``)
flexure        theta(t): bending added, or the path replaced; it moves the lever arm below the lever bandwidth
mount          the static angle Phi(t): steps and settling that do not move the lever arm
gyro, accel    ideal samples of ``main``, ``sub`` or ``sliding`` before scale, bias and noise
attitude       quaternions of a PHINS after its errors
imu            the finished series of any inertial unit: saturation, quantisation, outliers, lost or shifted stamps
=============  =====================================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError

if TYPE_CHECKING:
    from schemas.trial import ImuSeries
    from twin.config import Twin
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

REGISTRY: dict[str, str] = {}


class Effect:
    """Base of all effects: every hook hands back what it was given. ``name`` is the one used in twins and reports."""

    name: ClassVar[str] = ""

    def twin(self, twin: Twin) -> Twin:
        """The twin with parameters changed."""
        return twin

    def sub_clock(self, t: FloatArray) -> FloatArray:
        """Instants (n,) s at which the sub-IMU measured, for the instants t (n,) it claims (nominal delay excluded)."""
        return t

    def phins_clock(self, unit: str, t: FloatArray) -> FloatArray:
        """Instants (n,) s of the attitudes of a PHINS for the stamps t (n,)."""
        return t

    def flexure(self, t: FloatArray, theta: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """theta (n, 3) rad in m-axes at increasing times t (n,)."""
        return theta

    def mount(self, t: FloatArray, phi: FloatArray, scene: Scene) -> FloatArray:
        """Phi (n, 3) rad in m-axes at times t (n,); a function of time alone."""
        return phi

    def gyro(self, unit: str, t: FloatArray, gyro: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """Ideal rates (n, 3) rad/s at the stamps t (n,)."""
        return gyro

    def accel(self, unit: str, t: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """Ideal specific force (n, 3) m/s^2 at the stamps t (n,)."""
        return accel

    def attitude(
        self, unit: str, t: FloatArray, attitude: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """Quaternions (n, 4) of ``R_n_body`` of a PHINS at the stamps t (n,)."""
        return attitude

    def imu(self, unit: str, series: ImuSeries, scene: Scene, rng: np.random.Generator) -> ImuSeries:
        """The finished series of ``main``, ``sub``, ``phins_main``, ``phins_sub`` or ``sliding``."""
        return series


def names() -> tuple[str, ...]:
    """Names of all effects, sorted."""
    return tuple(sorted(REGISTRY))


def get(name: str) -> type[Effect]:
    """The class of an effect; ``DataError`` with the names there are when there is none of that name."""
    if name not in REGISTRY:
        known = ", ".join(names()) or "none"
        raise DataError(f"there is no effect named '{name}' (known effects: {known})")
    module, _, cls = REGISTRY[name].partition(":")
    return getattr(import_module(module), cls)


def build(name: str, parameters: Mapping[str, Any]) -> Effect:
    """An effect with its parameters; ``DataError`` names the effect when they do not fit."""
    cls = get(name)
    try:
        return cls(**parameters)
    except (TypeError, ValueError) as problem:
        raise DataError(f"effect '{name}': {problem}") from problem
