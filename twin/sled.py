"""A SINS slid along a path on the deck: its runs, its motion over the ship, its deck line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from physics import quaternions
from physics.units import ARCMIN, DEG
from twin.config import Deck

FloatArray = NDArray[np.float64]

GRID = 0.02  # m, between the points that carry the deck line


@dataclass(frozen=True)
class SledMotion:
    """The sled against the hull at times (n,).

    q_m_sled: (n, 4), without flexure. position, velocity, acceleration: (n, 3) in the deck frame (hull axes), m, m/s,
    m/s^2. arc_length: (n,) m from the deck's edge.
    """

    q_m_sled: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    arc_length: FloatArray


@dataclass(frozen=True)
class DeckPath:
    """The path of a sled: dR/ds = [k(s)]x R with the curvature k in hull axes, dp/ds = R t, t the path's direction."""

    deck: Deck

    def curvature(self, s: FloatArray) -> FloatArray:
        """k(s) (n, 3) rad/m about x (vertical), y (torsion), z (horizontal), s (n,) m from the deck's edge."""
        return np.stack([_profile(p, s) for p in self.deck.profiles], axis=-1)

    def at(self, t: FloatArray, start: float, forward: bool) -> SledMotion:
        """The sled at times t (n,) s of a run that starts to move at ``start``."""
        travelled, speed, acceleration = self._progress(t - start)
        if not forward:
            travelled, speed, acceleration = self.deck.length - travelled, -speed, -acceleration
        rotation, position, direction, bend = self._line
        mounting = quaternions.exp(np.array(self.deck.mounting_arcmin) * ARCMIN)
        v, a = speed[:, None], acceleration[:, None]
        return SledMotion(
            q_m_sled=quaternions.multiply(quaternions.exp(rotation(travelled)), mounting),
            position=position(travelled),
            velocity=direction(travelled) * v,
            acceleration=bend(travelled) * v**2 + direction(travelled) * a,
            arc_length=travelled,
        )

    def records(self, duration: float) -> list[tuple[float, float, float, bool]]:
        """Start, end and start of motion (s) and direction of each recorded run that begins within the duration."""
        deck = self.deck
        length = 2.0 * deck.pause + deck.length / deck.speed + deck.ramp
        starts = deck.start + np.arange(deck.passes) * (length + deck.turnaround)
        return [
            (
                float(start),
                min(float(start) + length, duration),
                float(start) + deck.pause,
                not (deck.alternate and k % 2),
            )
            for k, start in enumerate(starts)
            if start < duration
        ]

    def _progress(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance, speed and acceleration (n,) since the sled started to move."""
        cruise = self.deck.length / self.deck.speed
        up, down = _ramp(t, self.deck.ramp), _ramp(t - cruise, self.deck.ramp)
        return tuple(self.deck.speed * (x - y) for x, y in zip(up, down))  # type: ignore[return-value]

    @cached_property
    def _line(self) -> tuple[CubicSpline, CubicSpline, CubicSpline, CubicSpline]:
        """Rotation vector of the hull-to-sled turn, position, and its first two derivatives, against arc length."""
        count = int(np.ceil(self.deck.length / GRID)) + 1
        s = np.linspace(0.0, self.deck.length, count)
        middle = 0.5 * (s[1:] + s[:-1])
        mean = (self.curvature(s[1:]) + 4.0 * self.curvature(middle) + self.curvature(s[:-1])) / 6.0
        q = np.concatenate([[[0.0, 0.0, 0.0, 1.0]], quaternions.exp(mean * np.diff(s)[:, None])])
        reach = 1
        while reach < count:  # running product of the turns, later ones on the left, by doubling
            q[reach:] = quaternions.multiply(q[reach:], q[:-reach])
            reach *= 2
        along = np.array([-np.sin(self.deck.angle * DEG), np.cos(self.deck.angle * DEG), 0.0])
        tangent = CubicSpline(s, quaternions.rotate(q, np.broadcast_to(along, (count, 3))))
        edge = np.array([0.0, 0.0, self.deck.height]) - along * self.deck.length
        position = CubicSpline(s, edge + tangent.antiderivative()(s))
        return CubicSpline(s, quaternions.log(q)), position, tangent, tangent.derivative()


def _profile(p: tuple[float, float, float, float, float], s: FloatArray) -> FloatArray:
    """a + b exp(-s/l) + c sin(2 pi s/L)."""
    return p[0] + p[1] * np.exp(-s / p[2]) + p[3] * np.sin(2.0 * np.pi * s / p[4])


def _ramp(t: FloatArray, ramp: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A smooth rise from 0 to 1 over ramp s: its integral, itself, its derivative."""
    x = np.clip(t / ramp, 0.0, 1.0)
    integral = ramp * x**5 * (7.0 - 14.0 * x + 10.0 * x**2 - 2.5 * x**3) + np.maximum(t - ramp, 0.0)
    rise = x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
    return integral, rise, 140.0 / ramp * (x * (1.0 - x)) ** 3
