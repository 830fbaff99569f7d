"""What is known beforehand about the installation: the physical half of a rig profile.

The other half (topics, axes, units, encodings) concerns decoding alone and lives with the decode stage; by the time
a :class:`~schemas.trial.Trial` exists everything is in hull axes and SI units.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ImuGrade:
    """Error budget of one inertial unit; ``None`` means: not stated, find it in the log.

    gyro_arw: angle random walk, rad/sqrt(s). gyro_bias_std: rad/s. accel_vrw: velocity random walk, (m/s)/sqrt(s).
    accel_bias_std: m/s^2.
    """

    gyro_arw: float | None = None
    gyro_bias_std: float | None = None
    accel_vrw: float | None = None
    accel_bias_std: float | None = None


@dataclass(frozen=True)
class Rig:
    """The installation as its owner states it; every field may be unknown.

    lever_arm: (3,) m, main to sub IMU in m-axes, with lever_arm_std (m, one sigma per axis); ``None``: estimate it
    from scratch. installation_main, installation_sub: (3, 3) ``R_imu_phins``; ``None``: estimate from the log.
    """

    name: str = "default"
    lever_arm: FloatArray | None = None
    lever_arm_std: float = 0.05
    installation_main: FloatArray | None = None
    installation_sub: FloatArray | None = None
    main: ImuGrade = field(default_factory=ImuGrade)
    sub: ImuGrade = field(default_factory=ImuGrade)
    sliding: ImuGrade = field(default_factory=ImuGrade)
