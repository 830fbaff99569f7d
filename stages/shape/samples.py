"""Samples of the sled grouped by run, and what all deck-shape methods need of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.errors import DataError
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, OdometrySeries, Trial
from stages.shape.rates import Unit, unit
from stages.shape.track import CRUISE_SHARE, SPEED_FLOOR, Track, track

REST = 15.0  # s of standstill kept before and after a run: bias, misalignment and noise show there without curvature


@dataclass(frozen=True)
class Sled:
    """The sled's gyro samples near its runs, in time.

    stamp: (n,) ns. unit: their intervals and rates. run: (n,) index of the run they belong to. s0, s1: (n,) m, arc
    length at begin and end of each interval.
    """

    stamp: IntArray
    unit: Unit
    run: IntArray
    s0: FloatArray
    s1: FloatArray

    @property
    def s(self) -> FloatArray:
        """Arc length (n,) m at the middle of each sample."""
        return 0.5 * (self.s0 + self.s1)

    @property
    def speed(self) -> FloatArray:
        """Speed along the path (n,) m/s, negative when the sled goes back."""
        return np.asarray((self.s1 - self.s0) / (self.unit.end - self.unit.begin))

    def where(self, keep: BoolArray) -> Sled:
        """The samples of a mask."""
        u = Unit(self.unit.begin[keep], self.unit.end[keep], self.unit.rate[keep])
        return Sled(self.stamp[keep], u, self.run[keep], self.s0[keep], self.s1[keep])


def sliding_channels(trial: Trial) -> tuple[ImuSeries, OdometrySeries]:
    """The sled's two channels; DataError naming the one that is missing."""
    if trial.sliding is None or not len(trial.sliding):
        raise DataError("no deck shape: the log has no sliding inertial unit", file=trial.source or None)
    if trial.sled is None or not len(trial.sled.stamp):
        raise DataError("no deck shape: the log has no odometry of the sliding unit", file=trial.source or None)
    return trial.sliding, trial.sled


def load(trial: Trial) -> tuple[Track, Sled]:
    """The path with its runs and the sled's samples near them."""
    imu, odometry = sliding_channels(trial)
    try:
        path = track(odometry, trial.seconds(odometry.stamp))
        u = unit(imu, trial.seconds(imu.stamp))
    except DataError as error:
        raise error.located(file=trial.source or None, channel="sliding") from error
    finite = np.isfinite(imu.gyro).all(axis=1)
    sled = Sled(imu.stamp[finite], u, _run_of(path, u), path.arc_length(u.begin), path.arc_length(u.end))
    kept = sled.where((sled.run >= 0) & path.covered(u.begin, u.end))
    if not len(kept.stamp):
        raise DataError(
            "no deck shape: the sliding gyro and its odometry never cover a run together", file=trial.source or None
        )
    return path, kept


def _run_of(path: Track, u: Unit) -> IntArray:
    """Run (n,) of each sample, with standstill up to ``REST`` but no further than half-way to the next run; else -1."""
    begin, end = np.array([p.begin for p in path.passes]), np.array([p.end for p in path.passes])
    middle = 0.5 * (begin[1:] + end[:-1])
    index = np.searchsorted(middle, u.end)
    near = (u.begin > begin[index] - REST) & (u.end < end[index] + REST)
    return np.where(near, index, -1)


def reported(sled: Sled, path: Track, index: int) -> BoolArray:
    """Samples (n,) of one run at cruising speed: starts and stops are left out of its own curve."""
    run = path.passes[index]
    floor = max(SPEED_FLOOR, CRUISE_SHARE * run.cruise)
    inside = (sled.unit.begin >= run.begin) & (sled.unit.end <= run.end)
    return np.asarray((sled.run == index) & inside & (np.abs(sled.speed) > floor))
