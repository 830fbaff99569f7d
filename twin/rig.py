"""The rig that belongs to a twin: what the owner of such an installation would state."""

from __future__ import annotations

import numpy as np

from physics.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G
from schemas.rig import ImuGrade, Rig
from twin.config import Imu, Twin
from twin.sensors import installation


def believed_rig(twin: Twin, lever_arm_std: float = 0.05) -> Rig:
    """Lever arm (m, with its standard deviation), installation of each PHINS there is, and the grades of the units.

    A simulated trial comes without it, as a log does; hand it over where an experiment supposes it known.
    """
    phins = twin.phins if twin.channels.phins else None
    return Rig(
        name=twin.name,
        lever_arm=np.array(twin.mount.lever_arm),
        lever_arm_std=lever_arm_std,
        installation_main=installation(phins.installation_main_deg) if phins else None,
        installation_sub=installation(phins.installation_sub_deg) if phins else None,
        main=_grade(twin.imu.main),
        sub=_grade(twin.imu.sub),
        sliding=_grade(twin.imu.sliding),
    )


def _grade(belief: Imu) -> ImuGrade:
    """Noise levels, and biases as the root mean square over the axes."""
    return ImuGrade(
        gyro_arw=belief.gyro_arw * DEG_PER_SQRT_HOUR,
        gyro_bias_std=float(np.sqrt(np.mean(np.square(belief.gyro_bias_dph)))) * DEG_PER_HOUR,
        accel_vrw=belief.accel_vrw_ug * MICRO_G,
        accel_bias_std=float(np.sqrt(np.mean(np.square(belief.accel_bias_ug)))) * MICRO_G,
    )
