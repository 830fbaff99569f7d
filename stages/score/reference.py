"""References for ``R_m_s`` at the times of an estimate: truth, and two PHINS with known installation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics import quaternions, rotations
from schemas import scratch
from schemas.installation import main_installation, sub_installation
from schemas.products import Alignment, BoolArray
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial, Truth
from stages.attitudes import At, Attitudes, attitudes, attitudes_of, gathered
from stages.slabs import rows


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
    """Truth at the times ``at`` (n,) ns in order; None when it holds nothing."""
    good = np.asarray(np.isfinite(truth.total).all(axis=1))
    if not good.any():
        return None
    stamp, total = (scratch.shelved(rows(part, good)) for part in (truth.stamp, truth.total))
    known = attitudes(stamp, total, quaternions.exp)
    return Reference("truth", *gathered(known.at, at), known.usual * 1e-9, np.zeros(3))


def phins_reference(trial: Trial, alignment: Alignment, at: IntArray) -> tuple[Reference | None, str]:
    """``R_m_s = R_m_pm R_n_pm^T R_n_ps R_s_ps^T`` from both PHINS at the times ``at`` (n,) ns in order.

    The installation ``R_imu_phins`` is the rig's where it is stated, else the alignment's estimate. Returns the
    reference, or None and a sentence that says why there is none. PHINS stamps are PHINS's own clock: the sub-IMU's
    time delay does not act on them.
    """
    units = attitudes_of(trial.phins_main), attitudes_of(trial.phins_sub)
    if units[0] is None or units[1] is None:
        return None, ""
    main, sub = main_installation(trial.rig, alignment), sub_installation(trial.rig, alignment)
    if main is None or sub is None:
        return None, "not scored against PHINS: the installation of a PHINS on its IMU is neither stated nor observable"
    seen = gathered(_between(units[0], units[1], _quaternion(main[0]), _quaternion(sub[0])), at)
    interval = max(unit.usual for unit in units if unit is not None) * 1e-9
    return Reference("phins", *seen, interval, np.hypot(main[1], sub[1])), ""


def _between(main: Attitudes, sub: Attitudes, q_m_pm: FloatArray, q_s_ps: FloatArray) -> At:
    """``R_m_s`` from the attitudes of two PHINS and their installations, quaternions (4,)."""

    def at(times: IntArray) -> tuple[FloatArray, BoolArray]:
        (n_pm, main_ok), (n_ps, sub_ok) = main.at(times), sub.at(times)
        both = main_ok & sub_ok
        pm_ps = quaternions.multiply(quaternions.conjugate(n_pm[both[main_ok]]), n_ps[both[sub_ok]])
        m_ps = quaternions.multiply(q_m_pm, pm_ps)
        return quaternions.multiply(m_ps, quaternions.conjugate(q_s_ps)), both

    return at


def _quaternion(matrix: FloatArray) -> FloatArray:
    return quaternions.exp(rotations.log(matrix))
