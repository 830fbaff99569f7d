"""How a PHINS sits on its IMU: what the rig states, else what the alignment found."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.products import Alignment, Estimate, Status
from schemas.rig import FloatArray, Rig


def main_installation(rig: Rig, alignment: Alignment) -> tuple[FloatArray, FloatArray] | None:
    """``R_imu_phins`` (3, 3) at the main IMU and its standard deviation (3,) rad; None when unknown."""
    return _known(rig.installation_main, alignment.installation_main)


def sub_installation(rig: Rig, alignment: Alignment) -> tuple[FloatArray, FloatArray] | None:
    """``R_imu_phins`` (3, 3) at the sub-IMU and its standard deviation (3,) rad; None when unknown."""
    return _known(rig.installation_sub, alignment.installation_sub)


def _known(stated: FloatArray | None, estimated: Estimate | None) -> tuple[FloatArray, FloatArray] | None:
    if stated is not None:
        return np.asarray(stated, dtype=float), np.zeros(3)
    if estimated is None or estimated.status is Status.NOT_OBSERVABLE or not np.isfinite(estimated.value).all():
        return None
    matrix: FloatArray = Rotation.from_rotvec(estimated.value).as_matrix()
    return matrix, np.nan_to_num(np.asarray(estimated.std, dtype=float))
