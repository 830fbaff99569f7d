"""Trials from analytic attitudes: every sample is exact, whatever the delay.

Attitudes are sums of sinusoids in Euler angles, so they can be taken at any instant; a gyro sample is the rotation
vector between the attitudes at the two ends of its interval. No code of the project is used but the containers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.rig import Rig
from schemas.trial import ImuSeries, Trial

ARCMIN = np.pi / 180.0 / 60.0
DEG = np.pi / 180.0
EPOCH = 1_700_000_000_123_456_789
GRAVITY = np.array([0.0, 0.0, 9.81])
EARTH_RATE = np.array([0.0, 5.2e-5, 5.1e-5])  # rad/s, ENU


@dataclass(frozen=True)
class Waves:
    """sum of amplitude * sin(omega t + phase), each (k, 3)."""

    amplitude: np.ndarray
    omega: np.ndarray
    phase: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        return np.stack(
            [
                np.sin(np.multiply.outer(t, self.omega[:, axis]) + self.phase[:, axis]) @ self.amplitude[:, axis]
                for axis in range(3)
            ],
            axis=1,
        )


def sea(rng: np.random.Generator, rms_deg=(2.0, 3.0, 1.0), period=9.0, lines=24) -> Waves:
    """Pitch, roll, heading: narrow-band sea around a period, random phases."""
    omega = 2.0 * np.pi / period * rng.uniform(0.7, 1.8, (lines, 3))
    amplitude = (omega * period / 2.0 / np.pi) ** -3.0
    amplitude *= np.array(rms_deg) * DEG * np.sqrt(2.0) / np.linalg.norm(amplitude, axis=0)
    return Waves(amplitude, omega, rng.uniform(0.0, 2.0 * np.pi, (lines, 3)))


def lines(rows: list[tuple[int, float, float, float]]) -> Waves:
    """Rows of (axis: 0 pitch, 1 roll, 2 heading; amplitude deg; period s; phase deg)."""
    amplitude, omega, phase = (np.zeros((len(rows), 3)) for _ in range(3))
    for row, (axis, size, period, angle) in enumerate(rows):
        amplitude[row, axis], omega[row, axis], phase[row, axis] = size * DEG, 2.0 * np.pi / period, angle * DEG
    return Waves(amplitude, omega, phase)


def flexure(rng: np.random.Generator, std_arcmin=(3.0, 2.0, 4.0), mu=0.12, b=0.5, count=1500) -> Waves:
    """Second-order Gauss-Markov flexure as random sinusoids of spectrum 1/((b^2 - w^2)^2 + 4 mu^2 w^2), up to 5 Hz."""
    edges = np.concatenate(([1e-3], np.geomspace(1e-2, 30.0, count)))
    omega = rng.uniform(edges[:-1], edges[1:], (3, count)).T
    power = np.diff(edges)[:, None] / ((b**2 - omega**2) ** 2 + 4.0 * mu**2 * omega**2)
    scale = np.array(std_arcmin) * ARCMIN * np.sqrt(2.0)
    amplitude = np.sqrt(power / power.sum(axis=0)) * scale * np.sqrt(rng.exponential(1.0, omega.shape))
    return Waves(amplitude, omega, rng.uniform(0.0, 2.0 * np.pi, omega.shape))


@dataclass(frozen=True)
class World:
    """What the helper builds a trial from."""

    motion: Waves
    bend: Waves | None = None
    mount: Rotation = field(default_factory=Rotation.identity)
    delay: float = 0.0
    lever: np.ndarray | None = None

    def main(self, t: np.ndarray) -> Rotation:
        pitch, roll, heading = self.motion.at(t).T
        return Rotation.from_euler("ZXY", np.stack([heading, pitch, roll], axis=1))

    def sub(self, t: np.ndarray) -> Rotation:
        bent = self.mount if self.bend is None else Rotation.from_rotvec(self.bend.at(t)) * self.mount
        return self.main(t) * bent


def unit(world: World, name: str, start: float, duration: float, rate: float) -> ImuSeries:
    """Perfect gyros and accelerometers of ``main`` or ``sub``; the sub is stamped ``delay`` late."""
    step = 1.0 / rate
    stamps = start + step * np.arange(1, int(duration * rate) + 1)
    measured = stamps - (world.delay if name == "sub" else 0.0)
    ends = np.concatenate(([measured[0] - step], measured))
    attitude = getattr(world, name)(ends)
    inertial = Rotation.from_rotvec(np.multiply.outer(ends, EARTH_RATE)) * attitude
    gyro = (inertial[:-1].inv() * inertial[1:]).as_rotvec() / step
    middle = measured - 0.5 * step
    force = getattr(world, name)(middle).inv().apply(_acceleration(world, name, middle) + GRAVITY)
    return ImuSeries(nanoseconds(stamps), gyro, force, attitude[1:].as_quat())


def _acceleration(world: World, name: str, t: np.ndarray) -> np.ndarray:
    if world.lever is None or name == "main":
        return np.zeros((len(t), 3))
    h = 0.05
    before, now, after = (world.main(t + shift).apply(world.lever) for shift in (-h, 0.0, h))
    return (before - 2.0 * now + after) / h**2


def nanoseconds(t: np.ndarray) -> np.ndarray:
    return EPOCH + np.round(np.asarray(t) * 1e9).astype(np.int64)


def trial(world: World, duration: float = 300.0, rate: float = 20.0, sub_rate: float | None = None) -> Trial:
    main = unit(world, "main", 0.0, duration, rate)
    sub = unit(world, "sub", 0.0, duration, sub_rate or rate)
    bare = [replace(series, attitude=None) for series in (main, sub)]
    return Trial(bare[0], bare[1], EPOCH, rig=Rig())


def noisy(
    series: ImuSeries, rng: np.random.Generator, arw_deg_rt_h: float = 0.001, bias_dph=(0.0, 0.0, 0.0)
) -> ImuSeries:
    step = np.median(np.diff(series.stamp)) * 1e-9
    white = arw_deg_rt_h * DEG / 60.0 / np.sqrt(step) * rng.standard_normal(series.gyro.shape)
    return replace(series, gyro=series.gyro + white + np.array(bias_dph) * DEG / 3600.0)


def error(estimate: np.ndarray, truth: Rotation) -> np.ndarray:
    """Log(R_est R_true^T), rad."""
    return (Rotation.from_matrix(estimate) * truth.inv()).as_rotvec()
