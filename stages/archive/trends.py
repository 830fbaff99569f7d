"""Trends of an archive: the static angle over months, the flexure against the sea."""

from __future__ import annotations

import numpy as np

from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.archive.line import Line, fitted

MONTH_NS = 365.2425 / 12.0 * 86400.0 * 1e9
"""The mean month of the calendar, ns."""
NORMAL = 1.4826  # standard deviation of normal values over the median of their sizes


def months_since(stamp: IntArray, epoch: int) -> FloatArray:
    """Mean months from epoch to stamp (n,), both ns UTC."""
    return np.asarray((np.asarray(stamp, dtype=np.int64) - epoch) / MONTH_NS, dtype=float)


def drift(stamp: IntArray, angle: FloatArray, std: FloatArray, epoch: int) -> Line:
    """angle (n,) with std (n,) over months since epoch: the slope is in the angle's unit per month."""
    return fitted(months_since(stamp, epoch), angle, std)


def power_law(sea: FloatArray, flexure: FloatArray, log_std: FloatArray) -> Line:
    """ln flexure = value + slope (ln sea - centre): flexure grows as the slope-th power of the sea.

    log_std: (n,) standard deviation of ln flexure. Logs in which either is not positive are left out.
    """
    good = (np.asarray(sea) > 0) & (np.asarray(flexure) > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = np.where(good, np.log(sea), np.nan), np.where(good, np.log(flexure), np.nan)
    return fitted(x, y, log_std)


def apart(line: Line, x: FloatArray, y: FloatArray, std: FloatArray) -> FloatArray:
    """(n,) distance of the points from their line, in standard deviations of point, line and excess together.

    The excess is taken from the median distance where that is smaller: one point far off must not hide itself.
    """
    expected, uncertain = line.at(x)
    rest, own = np.asarray(y, dtype=float) - expected, np.asarray(std, dtype=float)
    if not len(rest):
        return rest
    usual = (NORMAL * np.median(np.abs(rest))) ** 2 - np.median(own**2)
    excess = min(line.excess**2, max(float(usual), 0.0))
    return np.asarray(rest / np.sqrt(own**2 + excess + uncertain**2))
