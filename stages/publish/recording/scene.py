"""What the tabs of a recording share: the data, colours, names, and the span of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from physics.interpolation import usual_interval
from schemas import scratch
from schemas.products import Deformation, Result, Score
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial, Truth
from stages.slabs import slabs

AXES = ("x (pitch)", "y (roll)", "z (heading)")
Colour = tuple[int, int, int]
BLUE: Colour = (70, 140, 220)
GREEN: Colour = (60, 170, 90)
ORANGE: Colour = (240, 140, 40)
RED: Colour = (214, 60, 60)
GREY: Colour = (150, 150, 155)
PURPLE: Colour = (170, 110, 210)
AXIS_COLOURS: tuple[Colour, Colour, Colour] = ((225, 85, 80), (95, 185, 95), (85, 140, 230))
REFERENCE_COLOURS: dict[str, Colour] = {"truth": GREEN, "phins": ORANGE}
RMSE_COLOURS: dict[str, Colour] = {"truth": PURPLE, "phins": (225, 200, 100)}
REFERENCE_NAMES = {"truth": "truth", "phins": "PHINS"}
SENSOR_RATE = 20.0  # Hz, default of everything but the estimates; minimum and maximum are kept
SLOW_RATE = 1.0  # Hz, of bounds, running figures and what moves in 3D


@dataclass(frozen=True)
class Scene:
    """A result to be shown, with the trial it came from. rate: Hz of sensors, references and errors.

    estimate_rate: Hz of the estimates, None for all of them.
    """

    result: Result
    trial: Trial
    truth: Truth | None
    rate: float = SENSOR_RATE
    estimate_rate: float | None = None

    @property
    def deformation(self) -> Deformation:
        """The estimate."""
        return self.result.deformation

    @cached_property
    def scores(self) -> tuple[Score, ...]:
        """Scores against the references present, truth first."""
        return tuple(sorted(self.result.scores, key=lambda score: score.reference != "truth"))

    @cached_property
    def span(self) -> tuple[float, float]:
        """Start and end (s since the epoch) of everything drawn over time."""
        ends = [self.trial.main.stamp[[0, -1]], self.trial.sub.stamp[[0, -1]]]
        t = self.trial.seconds(np.concatenate(ends))
        return float(t.min()), float(t.max())

    @cached_property
    def sigma(self) -> FloatArray:
        """(n, 3) rad, the estimate's own standard deviation per axis; NaN where unknown."""
        covariance = self.deformation.covariance
        out = scratch.empty(covariance.shape[:2])
        for part in slabs(len(out)):
            variance = np.diagonal(covariance[part], axis1=1, axis2=2)
            out[part] = np.sqrt(np.where(variance >= 0, variance, np.nan))
        scratch.release(covariance, out)
        return out


def stride(stamp: IntArray, rate: float) -> int:
    """Every how many samples to take so that about ``rate`` a second are left."""
    if len(stamp) < 3:
        return 1
    return max(1, round(1e9 / (usual_interval(stamp) * rate)))


def channel_stamps(trial: Trial) -> dict[str, IntArray]:
    """Stamps of the inertial channels present, by short name; PHINS where it has an attitude."""
    units: dict[str, ImuSeries | None] = {
        "main_imu": trial.main,
        "sub_imu": trial.sub,
        "phins_main": trial.phins_main,
        "phins_sub": trial.phins_sub,
        "sliding": trial.sliding,
    }
    return {name: unit.stamp for name, unit in units.items() if unit is not None and len(unit)}
