"""References for ``R_m_s`` at the times of an estimate: truth, and two PHINS with known installation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics import quaternions, rotations
from physics.interpolation import BoolArray, attitude_samples, slerp_quaternions, usual_interval
from schemas.installation import main_installation, sub_installation
from schemas.products import Alignment
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial, Truth


@dataclass(frozen=True)
class Reference:
    """Another source's ``R_m_s``, where it has one.

    rotation: (k, 4) quaternions at the times where valid (n,) is true. interval: s between its own samples.
    constant_std: (3,) rad, uncertainty of a constant part of it (installation), m-axes.
    """

    name: str
    rotation: FloatArray
    valid: BoolArray
    interval: float
    constant_std: FloatArray


def truth_reference(truth: Truth, at: IntArray) -> Reference | None:
    """Truth at the times ``at`` (n,) ns; None when it holds nothing."""
    good = np.isfinite(truth.total).all(axis=1)
    if not good.any():
        return None
    stamp = truth.stamp[good]
    rotation, valid = slerp_quaternions(stamp, quaternions.exp(truth.total[good]), at)
    return Reference("truth", rotation, valid, usual_interval(stamp) * 1e-9, np.zeros(3))


def phins_reference(trial: Trial, alignment: Alignment, at: IntArray) -> tuple[Reference | None, str]:
    """``R_m_s = R_m_pm R_n_pm^T R_n_ps R_s_ps^T`` from both PHINS at the times ``at`` (n,) ns.

    The installation ``R_imu_phins`` is the rig's where it is stated, else the alignment's estimate. Returns the
    reference, or None and a sentence that says why there is none. PHINS stamps are PHINS's own clock: the sub-IMU's
    time delay does not act on them.
    """
    units = [_attitude(trial.phins_main), _attitude(trial.phins_sub)]
    if units[0] is None or units[1] is None:
        return None, ""
    main, sub = main_installation(trial.rig, alignment), sub_installation(trial.rig, alignment)
    if main is None or sub is None:
        return None, "not scored against PHINS: the installation of a PHINS on its IMU is neither stated nor observable"
    (n_pm, main_ok), (n_ps, sub_ok) = slerp_quaternions(*units[0], at), slerp_quaternions(*units[1], at)
    both = main_ok & sub_ok
    pm_ps = quaternions.multiply(quaternions.conjugate(n_pm[both[main_ok]]), n_ps[both[sub_ok]])
    m_ps = quaternions.multiply(_quaternion(main[0]), pm_ps)
    rotation = quaternions.multiply(m_ps, quaternions.conjugate(_quaternion(sub[0])))
    interval = max(usual_interval(unit[0]) for unit in units if unit is not None) * 1e-9
    return Reference("phins", rotation, both, interval, np.hypot(main[1], sub[1])), ""


def _attitude(series: ImuSeries | None) -> tuple[IntArray, FloatArray] | None:
    return attitude_samples(series.stamp, series.attitude) if series is not None else None


def _quaternion(matrix: FloatArray) -> FloatArray:
    return quaternions.exp(rotations.log(matrix))
