"""Motion of the main IMU at any instant, from a table of the sea at 50 Hz joined by quintic polynomials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics import earth
from pipeline.blind.reality import paths
from pipeline.blind.reality.nature import Voyage
from pipeline.blind.reality.turns import Turns

FloatArray = NDArray[np.float64]

STEP = 0.02  # s, of the table; the sea's shortest period is a hundred times as long
SIGNALS = ("pitch", "roll", "yaw", "course", "surge", "sway", "heave")


@dataclass(frozen=True)
class State:
    """The main IMU at n instants: body to inertial and to ENU, rate and its derivative, specific force, m-axes.

    angles: (n, 3) pitch, roll, heading rad. velocity: (n, 3) m/s ENU. place: (n, 3) latitude, longitude rad, height m.
    """

    R_i_m: Turns
    R_n_m: Turns
    omega: FloatArray
    omega_dot: FloatArray
    force: FloatArray
    angles: FloatArray
    velocity: FloatArray
    place: FloatArray


@dataclass(frozen=True)
class ShipPath:
    """Signals (7, 3, k) with two derivatives and place (k, 3) with its rate, every STEP from ``first``."""

    voyage: Voyage
    first: float
    signals: FloatArray
    place: FloatArray
    place_dot: FloatArray

    @classmethod
    def over(cls, voyage: Voyage, start: float, end: float) -> ShipPath:
        """A table that covers start..end s."""
        t = STEP * np.arange(np.floor(start / STEP) - 2, np.ceil(end / STEP) + 3)
        lines = (voyage.pitch, voyage.roll, voyage.yaw, voyage.wander, voyage.surge, voyage.sway, voyage.heave)
        signals = np.stack([line.at(t) for line in lines])
        signals[3] += _turning(voyage, t)
        signals[3, 0] += voyage.heading
        place, rate = _travel(voyage, t, signals)
        return cls(voyage, float(t[0]), signals, place, rate)

    def at(self, t: FloatArray) -> State:
        """Everything at times t (n,) s."""
        s = paths.quintic(self.signals, self.first, STEP, t)
        velocity, acceleration = _velocity(self.voyage, s)
        place = paths.cubic(self.place, self.place_dot, self.first, STEP, t)
        angles = np.stack([s[0], s[1], s[2] + s[3]])
        R_n_m = Turns.about(2, angles[2, 0]) @ Turns.about(0, angles[0, 0]) @ Turns.about(1, angles[1, 0])
        R_m_n = R_n_m.inverse
        carried, carried_dot = _earth_and_travel(place, velocity, acceleration)
        seen = R_m_n.apply(carried)
        own, own_dot = _euler_rates(angles)
        down = np.zeros_like(velocity)
        down[:, 2] = -earth.gravity(place[:, 0], place[:, 2])
        coriolis = np.cross(earth.earth_rate(place[:, 0]) + carried, velocity)
        return State(
            R_i_m=_inertial(t, place) @ R_n_m, R_n_m=R_n_m, omega=own + seen,
            omega_dot=own_dot + R_m_n.apply(carried_dot) - np.cross(own, seen),
            force=R_m_n.apply(acceleration + coriolis - down),
            angles=angles[:, 0].T, velocity=velocity, place=place,
        )  # fmt: skip


def _turning(voyage: Voyage, t: FloatArray) -> FloatArray:
    """The turn as A (x - sin(2 pi x) / 2 pi), x from 0 to 1, with two derivatives (3, n)."""
    x = np.clip((t - voyage.turn_start) / voyage.turn_time, 0.0, 1.0)
    w = 2.0 * np.pi
    table = [x - np.sin(w * x) / w, (1.0 - np.cos(w * x)) / voyage.turn_time, w * np.sin(w * x) / voyage.turn_time**2]
    return voyage.turn * np.stack(table)


def _velocity(voyage: Voyage, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Velocity and acceleration (n, 3) in ENU from the signals (7, 3, n)."""
    course, turning = s[3, 0], s[3, 1]
    bow = np.stack([-np.sin(course), np.cos(course), np.zeros_like(course)], axis=-1)
    beam = np.stack([np.cos(course), np.sin(course), np.zeros_like(course)], axis=-1)
    ahead, aside = voyage.speed + s[4, 0], s[5, 0]
    velocity = ahead[:, None] * bow + aside[:, None] * beam
    acceleration = (s[4, 1] + aside * turning)[:, None] * bow + (s[5, 1] - ahead * turning)[:, None] * beam
    velocity[:, 2], acceleration[:, 2] = s[6, 0], s[6, 1]
    return velocity, acceleration


def _travel(voyage: Voyage, t: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Latitude, longitude, height (k, 3) and their rates; the start is where t = 0. Hermite's rule, three rounds."""
    velocity, acceleration = _velocity(voyage, s)
    start = np.array([voyage.latitude, voyage.longitude, voyage.height])
    place = np.tile(start, (len(t), 1))
    for _ in range(3):
        meridian, transverse = earth.radii(place[:, 0])
        scale = np.stack(
            [1.0 / (meridian + place[:, 2]), 1.0 / ((transverse + place[:, 2]) * np.cos(place[:, 0])), np.ones(len(t))],
            axis=-1,
        )
        rate = velocity[:, [1, 0, 2]] * scale
        bend = acceleration[:, [1, 0, 2]] * scale
        steps = 0.5 * STEP * (rate[:-1] + rate[1:]) + STEP**2 / 12.0 * (bend[:-1] - bend[1:])
        way = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        zero = int(np.argmin(np.abs(t)))
        place = start + way - way[zero]
    return place, rate


def _earth_and_travel(
    place: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """omega_in in ENU, of the Earth and of travelling over it, and its derivative, each (n, 3)."""
    latitude, height = place[:, 0], place[:, 2]
    meridian, transverse = earth.radii(latitude)
    north, east = 1.0 / (meridian + height), 1.0 / (transverse + height)
    tangent, secant = np.tan(latitude), 1.0 / np.cos(latitude)
    lat_dot = velocity[:, 1] * north
    spin = earth.RATE
    omega = np.stack(
        [-lat_dot, spin / secant + velocity[:, 0] * east, spin * np.sin(latitude) + velocity[:, 0] * east * tangent], -1
    )
    change = np.stack(
        [
            -acceleration[:, 1] * north,
            -spin * np.sin(latitude) * lat_dot + acceleration[:, 0] * east,
            spin * lat_dot / secant + east * (acceleration[:, 0] * tangent + velocity[:, 0] * secant**2 * lat_dot),
        ],
        axis=-1,
    )
    return omega, change


def _inertial(t: FloatArray, place: FloatArray) -> Turns:
    """R_i_n: east, north, up as seen in the frame that the Earth-fixed one passes at t = 0."""
    return Turns.about(2, place[:, 1] + earth.RATE * t + 0.5 * np.pi) @ Turns.about(0, 0.5 * np.pi - place[:, 0])


def _euler_rates(angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """omega_nm in m and its derivative from pitch, roll, heading (3, 3, n) with two derivatives.

    In the frame pitched but not rolled the rate is (p', h' sin p, h' cos p); rolling turns it about y and adds r'.
    """
    (p, p1, p2), (r, r1, r2), (_, h1, h2) = angles
    sp, cp = np.sin(p), np.cos(p)
    before = np.stack([p1, h1 * sp, h1 * cp], axis=-1)
    growth = np.stack([p2, h2 * sp + h1 * p1 * cp, h2 * cp - h1 * p1 * sp], axis=-1)
    unrolled = Turns.about(1, -r)
    omega = unrolled.apply(before)
    omega_dot = unrolled.apply(growth) - np.cross(np.outer(r1, [0.0, 1.0, 0.0]), omega)
    omega[:, 1] += r1
    omega_dot[:, 1] += r2
    return omega, omega_dot
