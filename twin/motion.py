"""Exact motion of the main IMU: attitude, rates and specific force at any time, from closed forms.

The ship runs with a speed along a course; waves add surge, sway and heave in axes turned with the course, and pitch,
roll and heading about it. Angles, velocities and their derivatives are closed forms; latitude and longitude are the
integral of the velocity over the ellipsoid, once for the whole record.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from physics import earth, quaternions
from physics.units import DEG, KNOT
from twin.config import Ship
from twin.sea import Harmonics

FloatArray = NDArray[np.float64]

KNOT_STEP = 0.02  # s, between the points that carry the position


@dataclass(frozen=True)
class Steps:
    """A quantity that goes from value to value over smooth ramps (three continuous derivatives).

    start: initial value. times, ramps: (k,) s. changes: (k,) in the quantity's own unit.
    """

    start: float
    times: FloatArray
    ramps: FloatArray
    changes: FloatArray

    @classmethod
    def through(cls, start: float, levels: Iterable[tuple[float, float, float]]) -> Steps:
        """From (time, ramp, new value) of each step in order."""
        table = np.array(list(levels), dtype=float).reshape(-1, 3)
        return cls(start, table[:, 0], table[:, 1], np.diff(table[:, 2], prepend=start))

    def at(self, t: FloatArray) -> FloatArray:
        """Value and first two derivatives, (n, 3)."""
        out = np.zeros((len(t), 3))
        out[:, 0] = self.start
        for time, ramp, change in zip(self.times, self.ramps, self.changes):
            x = np.clip((t - time) / ramp, 0.0, 1.0)
            out[:, 0] += change * x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
            out[:, 1] += change / ramp * 140.0 * x**3 * (1.0 - x) ** 3
            out[:, 2] += change / ramp**2 * 420.0 * x**2 * (1.0 - x) ** 2 * (1.0 - 2.0 * x)
        return out


@dataclass(frozen=True)
class Motion:
    """The main IMU at times t (n,) s since the epoch.

    q_i_m: (n, 4) attitude in the inertial frame that the Earth-fixed one passes at t = 0. q_n_m: (n, 4) body to ENU.
    omega, omega_dot: (n, 3) rate against i and its derivative, m-axes. specific_force: (n, 3) m/s^2, m-axes.
    velocity: (n, 3) m/s, ENU. angles: (n, 3) rad, pitch, roll, heading. latitude, longitude, height: (n,) rad, rad, m.
    """

    t: FloatArray
    q_i_m: FloatArray
    q_n_m: FloatArray
    omega: FloatArray
    omega_dot: FloatArray
    specific_force: FloatArray
    velocity: FloatArray
    angles: FloatArray
    latitude: FloatArray
    longitude: FloatArray
    height: FloatArray


@dataclass(frozen=True)
class ShipMotion:
    """A ship under way on a realised sea; call :meth:`at` for the motion at any time within span (s, s)."""

    ship: Ship
    sea: Mapping[str, Harmonics]
    span: tuple[float, float]
    _speed: Steps = field(init=False)
    _course: Steps = field(init=False)
    _weave: Steps = field(init=False)
    _swell: Steps = field(init=False)
    _position: CubicSpline = field(init=False)

    def __post_init__(self) -> None:
        def steps(start: float, key: str, unit: float) -> Steps:
            levels = [(p.start, p.ramp, getattr(p, key)) for p in self.ship.phase if getattr(p, key) is not None]
            return Steps.through(start * unit, [(time, ramp, value * unit) for time, ramp, value in levels])

        object.__setattr__(self, "_speed", steps(self.ship.speed, "speed", KNOT))
        object.__setattr__(self, "_course", steps(self.ship.heading, "heading", DEG))
        object.__setattr__(self, "_weave", steps(0.0, "weave", DEG))
        object.__setattr__(self, "_swell", steps(1.0, "sea", 1.0))
        object.__setattr__(self, "_position", self._integrate())

    def at(self, t: FloatArray) -> Motion:
        """Everything at times t (n,) s."""
        angles, rates, accelerations = self._angles(t)
        velocity, velocity_dot = self._velocity(t)
        latitude, longitude, height = self._position(t).T
        q_n_m = quaternions.from_euler(angles[:, 2], angles[:, 0], angles[:, 1])
        q_i_n = earth.local_level(latitude, longitude + earth.RATE * t)
        earth_rate = earth.earth_rate(latitude)
        transport = earth.transport_rate(latitude, height, velocity)
        omega, omega_dot = _body_rates(angles, rates, accelerations)
        frame, frame_dot = _carried(
            q_n_m, omega, earth_rate + transport, _frame_rate_dot(latitude, height, velocity, velocity_dot)
        )
        coriolis = quaternions.cross(2.0 * earth_rate + transport, velocity)
        up = np.stack([np.zeros_like(t), np.zeros_like(t), earth.gravity(latitude, height)], axis=-1)
        force = quaternions.rotate(quaternions.conjugate(q_n_m), velocity_dot + coriolis + up)
        return Motion(
            t=t, q_i_m=quaternions.multiply(q_i_n, q_n_m), q_n_m=q_n_m, omega=omega + frame,
            omega_dot=omega_dot + frame_dot, specific_force=force, velocity=velocity, angles=angles,
            latitude=latitude, longitude=longitude, height=height,
        )  # fmt: skip

    def angles(self, t: FloatArray) -> FloatArray:
        """Pitch, roll and heading (n, 3) rad at times t (n,) s."""
        return self._angles(t)[0]

    def _angles(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pitch, roll, heading with first and second derivatives, each (n, 3)."""
        swell = self._swell.at(t)
        parts = [_product(swell, self.sea[name].at(t)) for name in ("pitch", "roll", "heading")]
        parts[2] = parts[2] + self._heading(t)
        stacked = np.stack(parts, axis=-1)
        return stacked[:, 0], stacked[:, 1], stacked[:, 2]

    def _heading(self, t: FloatArray) -> FloatArray:
        """Course with its derivatives, (n, 3)."""
        if not len(self._weave.times):
            return self._course.at(t)
        swing = Harmonics(np.ones(1), np.array([2.0 * np.pi / self.ship.weave_period]), np.zeros(1))
        return self._course.at(t) + _product(self._weave.at(t), swing.at(t))

    def _velocity(self, t: NDArray) -> tuple[FloatArray, FloatArray]:
        """Velocity and its derivative in ENU, each (n, 3)."""
        swell, course = self._swell.at(t), self._heading(t)
        surge, sway, heave = (_product_rate(swell, self.sea[name].at(t)) for name in ("surge", "sway", "heave"))
        ahead = self._speed.at(t)[:, :2] + surge
        c, s, turn = np.cos(course[:, 0]), np.sin(course[:, 0]), course[:, 1]
        velocity = np.stack([c * sway[:, 0] - s * ahead[:, 0], s * sway[:, 0] + c * ahead[:, 0], heave[:, 0]], axis=-1)
        starboard, forward = sway[:, 1] - turn * ahead[:, 0], ahead[:, 1] + turn * sway[:, 0]
        return velocity, np.stack([c * starboard - s * forward, s * starboard + c * forward, heave[:, 1]], axis=-1)

    def _integrate(self) -> CubicSpline:
        """Latitude, longitude (rad) and height (m) against time: dL/dt = v_N/(M + h), dl/dt = v_E/((N + h) cos L)."""
        count = int(np.ceil((self.span[1] - self.span[0]) / KNOT_STEP)) + 8
        t = self.span[0] + KNOT_STEP * (np.arange(count) - 3)
        velocity = self._velocity(t)[0]
        start = np.array([self.ship.latitude * DEG, self.ship.longitude * DEG, self.ship.height])
        path = np.tile(start, (count, 1))
        for _ in range(4):  # each round gains about four digits: the radii hardly change along the way
            meridian, transverse = earth.radii(path[:, 0])
            north = velocity[:, 1] / (meridian + path[:, 2])
            east = velocity[:, 0] / ((transverse + path[:, 2]) * np.cos(path[:, 0]))
            integral = CubicSpline(t, np.stack([north, east, velocity[:, 2]], axis=-1)).antiderivative()
            path = start + integral(t) - integral(np.zeros(1))
        return CubicSpline(t, path)


def _product(envelope: FloatArray, signal: FloatArray) -> FloatArray:
    """Envelope times signal with two derivatives, all (n, 3)."""
    e, x = envelope, signal
    return np.stack(
        [
            e[:, 0] * x[:, 0],
            e[:, 1] * x[:, 0] + e[:, 0] * x[:, 1],
            e[:, 2] * x[:, 0] + 2.0 * e[:, 1] * x[:, 1] + e[:, 0] * x[:, 2],
        ],
        axis=-1,
    )


def _product_rate(envelope: FloatArray, signal: FloatArray) -> FloatArray:
    """First and second derivative (n, 2) of envelope times signal: a velocity and an acceleration."""
    return _product(envelope, signal)[:, 1:]


def _body_rates(angles: FloatArray, rates: FloatArray, accelerations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """omega_nm_m and its derivative from the Euler angles: Ry^T (Rx^T (0, 0, h') + (p', 0, 0)) + (0, r', 0)."""
    sp, cp, sr, cr = np.sin(angles[:, 0]), np.cos(angles[:, 0]), np.sin(angles[:, 1]), np.cos(angles[:, 1])
    (p1, r1, h1), (p2, r2, h2) = rates.T, accelerations.T
    ux, uy, uz = p1, h1 * sp, h1 * cp
    dx, dy, dz = p2, h2 * sp + h1 * p1 * cp, h2 * cp - h1 * p1 * sp
    omega = np.stack([cr * ux - sr * uz, uy + r1, sr * ux + cr * uz], axis=-1)
    turned = np.stack([-r1 * omega[:, 2], r2, r1 * omega[:, 0]], axis=-1)
    return omega, np.stack([cr * dx - sr * dz, dy, sr * dx + cr * dz], axis=-1) + turned


def _frame_rate_dot(
    latitude: FloatArray, height: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> FloatArray:
    """Derivative of omega_in_n (n, 3) along the way; the change of the radii (1e-3 of 1e-6 1/s) is left out."""
    meridian, transverse = earth.radii(latitude)
    lat_dot = velocity[:, 1] / (meridian + height)
    turning = earth.RATE * np.stack(
        [np.zeros_like(latitude), -np.sin(latitude) * lat_dot, np.cos(latitude) * lat_dot], axis=-1
    )
    turning[:, 2] += velocity[:, 0] / (transverse + height) / np.cos(latitude) ** 2 * lat_dot
    return turning + earth.transport_rate(latitude, height, acceleration)


def _carried(
    q_n_m: FloatArray, omega_nm: FloatArray, omega_in: FloatArray, omega_in_dot: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """omega_in and its derivative as seen in m: R_m_n w and R_m_n w' - omega_nm x (R_m_n w)."""
    q_m_n = quaternions.conjugate(q_n_m)
    seen = quaternions.rotate(q_m_n, omega_in)
    return seen, quaternions.rotate(q_m_n, omega_in_dot) - quaternions.cross(omega_nm, seen)
