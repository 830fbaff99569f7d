"""The Trial: columnar data of one sea trial, as every stage reads it.

The decode stage makes one from a log, the twin makes one from nothing. All of it is in hull axes (x starboard,
y bow, z up), SI units and radians; time is an integer number of nanoseconds, as in ROS. Stamps are those of the
measurement (``header.stamp``), strictly increasing within a channel: duplicates and disorder are settled by the
decode stage and reported in ``notes``.

Truth is kept apart (:class:`Truth`), so that no estimator can see it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from schemas.rig import FloatArray, Rig

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class ImuSeries:
    """One inertial unit.

    stamp: (n,) ns. gyro: (n, 3) rad/s and accel: (n, 3) m/s^2 in the unit's body axes, each the mean over the
    interval that ends at the stamp. attitude: (n, 4) unit quaternion x, y, z, w of ``R_n_body`` (body to ENU),
    instantaneous at the stamp, or None. instantaneous: the unit samples gyro and accel at the stamp instead.
    """

    stamp: IntArray
    gyro: FloatArray
    accel: FloatArray
    attitude: FloatArray | None = None
    instantaneous: bool = False

    def __len__(self) -> int:
        return len(self.stamp)


@dataclass(frozen=True)
class GnssSeries:
    """stamp: (n,) ns. latitude, longitude: (n,) rad. altitude: (n,) m. covariance: (n, 3, 3) m^2, ENU."""

    stamp: IntArray
    latitude: FloatArray
    longitude: FloatArray
    altitude: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class OdometrySeries:
    """The sled on the deck. stamp: (n,) ns. position: (n, 3) m and velocity: (n, 3) m/s, both in the deck frame."""

    stamp: IntArray
    position: FloatArray
    velocity: FloatArray


@dataclass(frozen=True)
class ScalarSeries:
    """stamp: (n,) ns. value: (n,) in the unit its owner states (kelvin for temperatures, as differences; deg C)."""

    stamp: IntArray
    value: FloatArray


@dataclass(frozen=True)
class Trial:
    """All channels of one trial that an estimator may see.

    epoch: ns; :meth:`seconds` counts from it. main and sub are always there. source: name for messages.
    notes: what decoding repaired or found odd, one sentence each.
    """

    main: ImuSeries
    sub: ImuSeries
    epoch: int
    phins_main: ImuSeries | None = None
    phins_sub: ImuSeries | None = None
    gnss: GnssSeries | None = None
    sliding: ImuSeries | None = None
    sled: OdometrySeries | None = None
    temperature_main: ScalarSeries | None = None
    temperature_sub: ScalarSeries | None = None
    rig: Rig = field(default_factory=Rig)
    source: str = ""
    notes: tuple[str, ...] = ()

    def seconds(self, stamp: IntArray) -> FloatArray:
        """Seconds since the epoch of the trial, (n,), of stamps in ns (exact to 1e-9 s over months)."""
        return np.asarray((stamp - self.epoch) * 1e-9, dtype=np.float64)

    @property
    def duration(self) -> float:
        """Length of the main IMU's record in seconds."""
        return float(self.main.stamp[-1] - self.main.stamp[0]) * 1e-9


@dataclass(frozen=True)
class Truth:
    """Truth of a simulated log; read by scoring alone.

    stamp: (n,) ns. total, static_part, dynamic_part: (n, 3) rad, Log(R_m_s), Phi, theta. attitude: (k, 4) quaternion
    x, y, z, w of ``R_n_s`` at attitude_stamp (k,) ns.
    """

    stamp: IntArray
    total: FloatArray
    static_part: FloatArray
    dynamic_part: FloatArray
    attitude_stamp: IntArray | None = None
    attitude: FloatArray | None = None
