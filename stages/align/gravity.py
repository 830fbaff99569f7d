"""Gravity as a second vector: the mean specific force seen by both units.

    mean(f_m + A r - R f_s) = mean(f_m) x e + bias,   A = [w']x + [w]x [w]x,   R_true = Exp(e) R

It knows the tilt and nothing of the angle about the vertical. Its weight is honest: accelerometer biases, a lever arm
that may be tens of metres off and the flexure left in a finite mean enter its covariance, so it counts in a calm sea
and hardly in a rough one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physics import rotations
from physics.units import DEG_PER_HOUR, MICRO_G, STANDARD_GRAVITY
from schemas.rig import FloatArray, Rig
from stages.align.tracks import Span, long_run_variance

ACCEL_BIAS_UNKNOWN = 2000.0 * MICRO_G  # m/s^2, one sigma where the rig states none
ACCEL_PER_GYRO = 50.0 * MICRO_G / DEG_PER_HOUR  # m/s^2 per rad/s: 10 mg goes with 200 deg/h, 1 mg with 20
LEVER_UNKNOWN = 30.0  # m, one sigma where the rig states none
NORM_RANGE = (0.97, 1.03)  # of g; a mean outside is no specific force (compensated, wrong unit)
CELL = 0.5  # s, specific forces are averaged over it


@dataclass(frozen=True)
class Gravity:
    """first, second: (3,) mean specific force, m-axes and s-axes. covariance: (3, 3) of their difference, m-axes."""

    first: FloatArray
    second: FloatArray
    covariance: FloatArray

    @property
    def profile(self) -> FloatArray:
        """(3, 3) Wahba profile of the pair of directions."""
        return np.outer(self.first, self.second) / (np.linalg.norm(self.first) * np.linalg.norm(self.second))

    def aid(self, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Information (3, 3) on the rotation error, and innovation (3,) weighted with it."""
        turned = rotation @ self.second
        design = -rotations.skew(turned)
        weighted = np.linalg.solve(self.covariance, design).T
        return weighted @ design, weighted @ (self.first - turned)

    def disagreement(self, rotation: FloatArray, covariance: FloatArray) -> float:
        """Tilt seen against a rotation with covariance (3, 3), over its standard deviation (of one axis)."""
        turned = rotation @ self.second
        across = rotations.skew(turned) / np.linalg.norm(turned) ** 2
        design = -rotations.skew(turned)
        spread = across @ (design @ covariance @ design.T + self.covariance) @ across.T
        return float(np.linalg.norm(across @ self.first) / np.sqrt(np.trace(spread) / 2.0))


def gravity(spans: Sequence[Span], delay: float, rig: Rig, rotation: FloatArray | None = None) -> Gravity | None:
    """The pair of mean specific forces, or None where either unit's accelerometers show no gravity.

    rotation: approximate R_m_s, needed for the covariance (without it, of biases and lever arm alone).
    """
    parts = zip(*(_means(span, delay) for span in spans))
    first, second, rate, rate_second = (np.concatenate(part) for part in parts)
    lever, lever_std = (np.zeros(3), LEVER_UNKNOWN) if rig.lever_arm is None else (rig.lever_arm, rig.lever_arm_std)
    whirl = rotations.skew(rate)
    centripetal = np.mean(whirl @ whirl, axis=0)
    forces = np.mean(first, axis=0) + centripetal @ lever, np.mean(second, axis=0)
    if not all(NORM_RANGE[0] < np.linalg.norm(force) / STANDARD_GRAVITY < NORM_RANGE[1] for force in forces):
        return None
    unknown = max(ACCEL_BIAS_UNKNOWN, ACCEL_PER_GYRO * _gyro_bias(rate, rate_second, rotation))
    bias = sum((unit.accel_bias_std or unknown) ** 2 for unit in (rig.main, rig.sub))
    tangential = rotations.skew((rate[-1] - rate[0]) / (len(rate) * CELL))
    covariance = bias * np.eye(3) + lever_std**2 * (centripetal @ centripetal.T + tangential @ tangential.T)
    if rotation is not None:
        covariance += long_run_variance(first - second @ rotation.T, CELL) / len(first) ** 2
    return Gravity(*forces, covariance)


def _gyro_bias(first: FloatArray, second: FloatArray, rotation: FloatArray | None) -> float:
    """rad/s, rms over axes and units of what gyro bias the mean rates (k, 3) leave room for: it tells the grade."""
    mean_first, mean_second = first.mean(axis=0), second.mean(axis=0)
    if rotation is None:
        return float(np.sqrt((mean_first @ mean_first + mean_second @ mean_second) / 6.0))
    return float(np.linalg.norm(mean_first - rotation @ mean_second) / np.sqrt(6.0))


def _means(span: Span, delay: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Specific forces of both units, the second read ``delay`` later, and their rates, (k, 3) each."""
    count = span.count(CELL)
    first, second = span.first, span.second
    force = first.specific_force(span.start, CELL, count), second.specific_force(span.start + delay, CELL, count)
    return *force, first.rate(span.start, CELL, count), second.rate(span.start + delay, CELL, count)
