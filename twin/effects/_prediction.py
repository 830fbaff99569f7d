"""What a mean effect predicts in a log: signals that are proportional to its parameters, to first order.

The prediction is made from a view of the log that holds no random flexure of the sub-IMU's own: the motion comes from
the main IMU, turned and moved to the sub-IMU's place, so that a regressor does not correlate with the flexure's noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LogView:
    """A log as a twin's parameters see it, at the stamps of the main IMU.

    t: (n,) s since the epoch. interval: s. R_m_s: (3, 3), static. lever_arm: (3,) m. omega_m, omega_dot_m: (n, 3)
    rad/s and rad/s^2 of the main IMU in m-axes; force_m: (n, 3) m/s^2. omega_s, omega_dot_s, force_s, jerk_s: (n, 3)
    ideal rate, its derivative, specific force and its derivative at the sub-IMU in s-axes, without flexure. theta,
    theta_dot: (n, 3) rad, rad/s: the flexure that the gyros show. damping, stiffness: (3,) of the flexure as the twin
    has it; answering: (2, 3) those with which a moment turns into bending, as the log shows them. foretold: (2, n, 3)
    theta and theta_dot as what they were a step of the observations ago foretells them. roll: (n,) rad, or None without
    attitude. temperature_sub: (n,) deg C or None.
    """

    t: FloatArray
    interval: float
    R_m_s: FloatArray
    lever_arm: FloatArray
    omega_m: FloatArray
    omega_dot_m: FloatArray
    force_m: FloatArray
    omega_s: FloatArray
    omega_dot_s: FloatArray
    force_s: FloatArray
    jerk_s: FloatArray
    theta: FloatArray
    theta_dot: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    answering: FloatArray
    foretold: FloatArray
    roll: FloatArray | None = None
    temperature_sub: FloatArray | None = None


@dataclass(frozen=True)
class OnAxis:
    """Vectors (n, 3) of which the component ``axis`` is ``values`` (n,), the others zero: a third of the memory, and
    less where values are shared. An array to whoever asks for one."""

    axis: int
    values: FloatArray

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype)

    def __getitem__(self, rows: slice | NDArray[np.int64]) -> FloatArray:
        """(k, 3) some of them."""
        some = self.values[rows]
        out = np.zeros((len(some), 3))
        out[:, self.axis] = some
        return out


Signal = FloatArray | OnAxis


@dataclass(frozen=True)
class Signals:
    """What a unit of a parameter adds, each (n, 3) at the stamps of the view, None for nothing.

    gyro: rad/s, accel: m/s^2, on the sub-IMU, s-axes. bending: rad, m-axes: theta, which moves the lever arm. mount:
    rad, m-axes: the vector Phi, which does not. phins: rad, m-axes, on the relative attitude of the PHINS (sub less
    main). phins_main: rad, m-axes, on the attitude of the main PHINS against the main IMU.
    """

    gyro: Signal | None = None
    accel: Signal | None = None
    bending: Signal | None = None
    mount: Signal | None = None
    phins: Signal | None = None
    phins_main: Signal | None = None


@dataclass(frozen=True)
class Column:
    """The prediction of one number of an effect: parameter ``x`` or, of a vector parameter, ``amplitude.x``.

    signals: per unit of the parameter, in the unit of its declaration. shape: what else was assumed (a period, a time),
    in the units of the declarations: columns of one effect with the same shape belong together.
    """

    parameter: str
    signals: Signals
    shape: dict[str, float] = field(default_factory=dict)


def on_axis(axis: int, values: FloatArray) -> OnAxis:
    """Values (n,) as the component ``axis`` of vectors (n, 3), the others zero."""
    return OnAxis(axis, values)
