"""What is really out there, in SI: the engineer's belief (a twin) with every nuisance off by a little."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCMIN, ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, KNOT, MICRO_G, PPM
from pipeline.blind.reality.waves import Lines, mixed, none, swell
from twin.config import Imu, Twin

FloatArray = NDArray[np.float64]

SKEW = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # order xy xz yx yz zx zy


@dataclass(frozen=True)
class Voyage:
    """Start (rad, rad, m), course rad, speed m/s, one turn (rad, begun at s, taking s), and the sea.

    pitch, roll, yaw, wander: lines in rad; surge, sway, heave: lines of velocity, m/s.
    """

    latitude: float
    longitude: float
    height: float
    heading: float
    speed: float
    pitch: Lines
    roll: Lines
    yaw: Lines
    wander: Lines
    surge: Lines
    sway: Lines
    heave: Lines
    turn: float = 0.0
    turn_start: float = 0.0
    turn_time: float = 1.0


@dataclass(frozen=True)
class Unit:
    """An inertial unit: gyro (I + M) w + b + noise, accelerometer f + a + noise; arw rad/sqrt(s), vrw (m/s)/sqrt(s)."""

    bias: FloatArray
    matrix: FloatArray
    arw: float
    accel_bias: FloatArray
    vrw: float


@dataclass(frozen=True)
class Deck:
    """Flexure per axis (mu, lambda, sigma; rad), correlation of its forcing, and how it moves the lever arm.

    The lever follows flexure with the gain 1 / (1 + (f / corner)^(2 order)), without lag.
    """

    damping: FloatArray
    frequency: FloatArray
    std: FloatArray
    correlation: FloatArray
    static: FloatArray
    lever: FloatArray
    corner: float
    order: int


@dataclass(frozen=True)
class PhinsUnit:
    """Attitude errors about east, north, up: drift std (3,) rad with time constant s, white noise rad; own noise."""

    drift: FloatArray
    tau: float
    noise: float
    installation_main: FloatArray
    installation_sub: FloatArray
    arw: float
    vrw: float


@dataclass(frozen=True)
class Warmth:
    """Temperatures in deg C: start + rise (1 - exp(-t/tau)) + swing sin(2 pi t / period), main and sub."""

    start: float
    rise: tuple[float, float]
    tau: tuple[float, float]
    swing: float
    period: float

    def at(self, unit: int, t: FloatArray) -> FloatArray:
        """(n,) deg C of main (0) or sub (1)."""
        warm = self.rise[unit] * -np.expm1(-np.maximum(t, 0.0) / self.tau[unit])
        return self.start + warm + self.swing * np.sin(2.0 * np.pi * t / self.period + unit)


@dataclass(frozen=True)
class Nature:
    """Everything a log follows from but the noise itself. delay s: of the sub-IMU. epoch ns."""

    duration: float
    rate: float
    epoch: int
    voyage: Voyage
    deck: Deck
    main: Unit
    sub: Unit
    phins: PhinsUnit
    warmth: Warmth
    delay: float = 0.0
    channels: frozenset[str] = field(default_factory=lambda: frozenset({"phins", "gnss", "temperature"}))

    def with_sub(self, **values: object) -> Nature:
        """With values of the sub-IMU replaced."""
        return replace(self, sub=replace(self.sub, **values))  # type: ignore[arg-type]

    def with_deck(self, **values: object) -> Nature:
        """With values of the deck replaced."""
        return replace(self, deck=replace(self.deck, **values))  # type: ignore[arg-type]


def actual(twin: Twin, voyage: Voyage, warmth: Warmth, epoch: int, rng: np.random.Generator) -> Nature:
    """Reality beside a twin: each nuisance drawn about what the twin says."""
    return Nature(
        duration=twin.run.duration, rate=twin.run.rate, epoch=epoch, voyage=voyage, deck=_deck(twin, rng),
        main=_unit(twin.imu.main, rng), sub=_unit(twin.imu.sub, rng), phins=_phins(twin, rng), warmth=warmth,
        delay=twin.mount.time_delay,
    )  # fmt: skip


def voyage(twin: Twin, spread: tuple[float, ...], turn: float, rng: np.random.Generator) -> Voyage:
    """A sea with standard deviations ``spread``: pitch, roll, yaw (rad), surge, sway, heave (m); a turn in rad."""
    pitch, roll, yaw, surge, sway, heave = spread
    wind = rng.uniform(5.0, 8.5)
    own = rng.uniform(7.5, 13.0)  # the ship's own period of roll
    taking = abs(turn) / (rng.uniform(0.3, 0.8) * DEG) + 20.0
    return Voyage(
        latitude=twin.ship.latitude * DEG, longitude=twin.ship.longitude * DEG, height=twin.ship.height,
        heading=twin.ship.heading * DEG, speed=twin.ship.speed * KNOT,
        pitch=mixed(pitch, wind, 0.2, rng), roll=mixed(roll, own, 0.25, rng), yaw=mixed(yaw, own * 1.1, 0.2, rng),
        wander=swell(0.25 * DEG, rng.uniform(60.0, 150.0), 4, rng),
        surge=_moving(surge, wind * 1.3, rng), sway=_moving(sway, own, rng), heave=_moving(heave, wind * 1.1, rng),
        turn=turn, turn_start=rng.uniform(0.15, 0.6) * twin.run.duration, turn_time=taking,
    )  # fmt: skip


def _moving(std: float, period: float, rng: np.random.Generator) -> Lines:
    return mixed(std, period, 0.3, rng).rate() if std > 0.0 else none()


def _near(value: float, share: float, rng: np.random.Generator) -> float:
    """The value times a log-normal factor, within two of its standard deviations."""
    return value * float(np.exp(share * np.clip(rng.standard_normal(), -2.0, 2.0)))


def _deck(twin: Twin, rng: np.random.Generator) -> Deck:
    belief = twin.flexure
    xy, xz, yz = belief.correlation
    return Deck(
        damping=np.array([_near(v, 0.1, rng) for v in belief.damping]),
        frequency=np.array([_near(v, 0.1, rng) for v in belief.frequency]),
        std=np.array([_near(v, 0.08, rng) for v in belief.std_arcmin]) * ARCMIN,
        correlation=np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]]),
        static=(np.array(twin.mount.static_arcmin) + 0.5 * rng.standard_normal(3)) * ARCMIN,
        lever=np.array(twin.mount.lever_arm),
        corner=float(np.exp(rng.uniform(np.log(1.6), np.log(8.0)))),
        order=int(rng.integers(2, 5)),
    )


def _unit(belief: Imu, rng: np.random.Generator) -> Unit:
    matrix = np.diag(belief.gyro_scale_ppm) * PPM
    for (row, column), value in zip(SKEW, belief.gyro_nonorthogonality_arcsec):
        matrix[row, column] = value * ARCSEC
    grade = belief.gyro_arw / 0.001
    return Unit(
        bias=(np.array(belief.gyro_bias_dph) + 0.003 * grade * rng.standard_normal(3)) * DEG_PER_HOUR,
        matrix=matrix * np.exp(0.1 * rng.standard_normal((3, 3))),
        arw=_near(belief.gyro_arw, 0.03, rng) * DEG_PER_SQRT_HOUR,
        accel_bias=(np.array(belief.accel_bias_ug) + 15.0 * grade * rng.standard_normal(3)) * MICRO_G,
        vrw=_near(belief.accel_vrw_ug, 0.1, rng) * MICRO_G,
    )


def _phins(twin: Twin, rng: np.random.Generator) -> PhinsUnit:
    belief = twin.phins
    off = 0.2 / 60.0 * rng.standard_normal((2, 3))
    return PhinsUnit(
        drift=np.array([_near(v, 0.15, rng) for v in belief.attitude_drift_arcmin]) * ARCMIN,
        tau=_near(belief.attitude_drift_tau, 0.2, rng),
        noise=_near(belief.attitude_noise_arcmin, 0.1, rng) * ARCMIN,
        installation_main=(np.array(belief.installation_main_deg) + off[0]) * DEG,
        installation_sub=(np.array(belief.installation_sub_deg) + off[1]) * DEG,
        arw=_near(belief.gyro_arw, 0.1, rng) * DEG_PER_SQRT_HOUR,
        vrw=_near(belief.accel_vrw_ug, 0.1, rng) * MICRO_G,
    )
