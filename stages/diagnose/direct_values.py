"""Values of the sub-IMU's gyros: a lattice they lie on, and a range at which they stop."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCSEC, DEG, NS
from schemas.diagnosis import Finding, ParameterEstimate, Place
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, Trial
from twin.effects._parameters import AXES

SMALLEST = 60  # closest values of an axis from which the step of a lattice is taken
OFF_LATTICE = 0.02  # steps by which values may miss their lattice
ON_LATTICE = 0.98  # share of values that lie on it
SHARED = 0.5  # share of values that stand with another one on their level, from which one alone is doubted
FINEST = 1e-9  # of the largest value: closer values are one, and a finer lattice is that of the numbers themselves
MOST_NATS = 1e6  # enough
REPEATS = 4  # samples at an extreme that make a range of it
SAME = 1e-12  # of the extreme: values this close are equal
DWELL = 5.0  # times as many samples as at the levels below may stand at the crest of a wave
TOP_LEVELS = 5  # of a lattice, below its extreme, that say how many samples to expect there

BoolArray = NDArray[np.bool_]


def lattice(values: FloatArray) -> float:
    """Step of the lattice that values (n,) lie on, 0 where there is none."""
    size = float(np.abs(values).max())
    levels, met = np.unique(values, return_counts=True)
    if met[met > 1].sum() > SHARED * len(values):
        levels = levels[met > 1]  # a wild sample lies on no lattice
    if size == 0.0 or len(levels) < 8:
        return 0.0
    apart = np.diff(levels)
    apart = np.sort(apart[apart > FINEST * size])[:SMALLEST]
    if len(apart) < 8:
        return 0.0
    step = _common(apart)
    if step <= FINEST * size:
        return 0.0
    return _sharpened(values, step)


def _common(differences: FloatArray) -> float:
    """Greatest common measure of differences (k,), by Euclid with a tolerance."""
    measure = float(differences[0])
    for other in differences[1:]:
        a, b = float(other), measure
        while b > OFF_LATTICE * measure:
            a, b = b, a - b * np.floor(a / b + 0.25 * OFF_LATTICE)
            if abs(a - b) < OFF_LATTICE * a:
                b = 0.0
        measure = a
    return measure


def _sharpened(values: FloatArray, step: float) -> float:
    """The step fitted to larger and larger values, 0 where the larger ones leave the lattice."""
    for reach in np.geomspace(16.0, max(np.abs(values).max() / step, 17.0), 24):
        part = values[np.abs(values) <= reach * step]
        count = np.rint(part / step)
        if not count.any():
            continue
        if np.mean(np.abs(part / step - count) < OFF_LATTICE * 4.0) < ON_LATTICE:
            return 0.0
        step = float(part @ count / (count @ count))
    count = np.rint(values / step)
    return step if np.mean(np.abs(values / step - count) < OFF_LATTICE) > ON_LATTICE else 0.0


def quantization(trial: Trial) -> Finding | None:
    """``gyro_quantization`` where the sub-IMU's increments of angle lie on a lattice and the main IMU's do not."""
    steps = _steps(trial.sub)
    if not steps.all() or np.ptp(steps) > 1e-3 * steps.mean():
        return None
    if np.any(_steps(trial.main) > 0.3 * steps.mean()):
        return None
    interval = float(np.median(np.diff(trial.sub.stamp))) * NS
    step, evidence = float(steps.mean()), _lattice_nats(trial.sub.gyro, steps)
    arcsec = step * interval / ARCSEC
    parameters = {"step": ParameterEstimate(arcsec, max(float(np.std(steps)) / step, 1e-6) * arcsec, "arcsec")}
    places = tuple(Place("sub.gyro", axis, (0.1 / interval, 0.5 / interval), None, evidence / 3.0) for axis in AXES)
    return Finding("gyro_quantization", parameters, evidence, places=places)


def _steps(series: ImuSeries) -> FloatArray:
    """Lattice (3,) of odd samples of each axis: the even ones are for the test."""
    return np.array([lattice(series.gyro[1::2, axis]) for axis in range(3)])


def _lattice_nats(gyro: FloatArray, steps: FloatArray) -> float:
    """Even samples on the lattice of the odd ones, against values that know of no lattice."""
    off = np.abs(gyro[::2] / steps - np.rint(gyro[::2] / steps))
    on = int(np.count_nonzero(off < OFF_LATTICE))
    missed = off.size - on
    return float(min(on * np.log(0.5 / OFF_LATTICE) - missed * np.log(0.5 / OFF_LATTICE), MOST_NATS))


def clipped(gyro: FloatArray) -> BoolArray:
    """Samples (n,) with some axis at the range of the unit."""
    limit = _limit(gyro)
    if limit == 0.0:
        return np.zeros(len(gyro), bool)
    return np.asarray((np.abs(gyro) >= limit * (1.0 - SAME)).any(axis=1))


def _limit(gyro: FloatArray) -> float:
    """Largest absolute rate, if enough samples of any axis repeat it."""
    size = np.abs(gyro)
    limit = float(size.max())
    return limit if limit > 0.0 and np.count_nonzero(size >= limit * (1.0 - SAME)) >= REPEATS else 0.0


def saturation(trial: Trial) -> Finding | None:
    """``gyro_saturation`` where the largest rate of the sub-IMU is met again and again, exactly."""
    gyro = trial.sub.gyro
    limit = _limit(gyro)
    if limit == 0.0 or _limit(trial.main.gyro) == limit:
        return None
    size = np.abs(gyro)
    at = size >= limit * (1.0 - SAME)
    evidence = _excess_nats(size[~at], limit, int(at.sum()))
    if evidence <= 0.0:
        return None
    interval = float(np.median(np.diff(trial.sub.stamp))) * NS
    counts = at.sum(axis=0)
    places = tuple(
        Place("sub.gyro", AXES[axis], (0.0, 0.5 / interval), None, evidence * counts[axis] / counts.sum())
        for axis in np.argsort(-counts)
        if counts[axis]
    )
    parameters = {"limit": ParameterEstimate(limit / DEG, max(limit / DEG * 1e-6, 1e-9), "deg/s")}
    return Finding("gyro_saturation", parameters, evidence, places=places)


def _excess_nats(below: FloatArray, limit: float, count: int) -> float:
    """Repeats of the extreme against what the values just below it make likely."""
    levels = np.unique(below)[-TOP_LEVELS:]
    usual = np.count_nonzero(below >= levels[0]) / len(levels) if len(levels) else 0.0
    expected = DWELL * usual if usual > 1.5 else 1e-3  # values that know of no lattice do not repeat
    return float(min(count * np.log(count / expected) - (count - expected), MOST_NATS)) if count > expected else 0.0
