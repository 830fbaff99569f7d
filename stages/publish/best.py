"""The value to tell: the estimator's own where it refined one, else the alignment's."""

from __future__ import annotations

from schemas.products import Deformation, Estimate
from stages.publish.rows import known_rows


def time_delay(deformation: Deformation) -> Estimate:
    """Time delay, s (> 0: the sub-IMU's stamps are late), with standard deviation."""
    return deformation.parameters.get("time_delay", deformation.alignment.time_delay)


def static_angle(deformation: Deformation) -> Estimate:
    """Static angle (3,) rad, m-axes: the estimator's ``static_angle``, else the time mean of its static part."""
    if "static_angle" in deformation.parameters:
        return deformation.parameters["static_angle"]
    static = deformation.alignment.static
    known = known_rows(deformation.static_part)
    if not len(known):
        return static
    return Estimate(known.mean(axis=0), static.std, static.status, static.reason)
