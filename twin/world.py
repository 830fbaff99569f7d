"""A twin with everything random about ship and flexure drawn, and the instruments that stand in it.

Conventions: a gyro sample is the exact rotation increment over the interval that ends at its stamp, divided by its
length; an accelerometer sample the mean over the same interval; attitudes are instantaneous. A sub-IMU sample stamped t
was measured at t - delay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics import quaternions
from schemas.trial import ImuSeries, IntArray
from twin import bending, effects, sampling, sensors
from twin.config import Twin
from twin.effects import Effect
from twin.motion import Motion
from twin.scene import Scene

FloatArray = NDArray[np.float64]

LEAD = 16.0  # s, what the flexure's beginning before the record is a multiple of
NODES = 1 << 16  # quadrature nodes worked on at a time: bounds the memory, whatever the length of the record
STREAMS = (
    "sea",
    "flexure",
    "main",
    "sub",
    "sliding",
    "phins_main",
    "phins_sub",
    "gnss",
    "temperature",
    "odometry",
    "effects",
)
Streams = Mapping[str, np.random.Generator]


@dataclass(frozen=True)
class World:
    """What is drawn before any instrument measures. Times in s since the epoch (ns).

    draws: what each effect draws from. per_sample: quadrature steps per sample.
    """

    scene: Scene
    effects: tuple[Effect, ...]
    draws: tuple[np.random.Generator, ...]
    flexure: bending.FlexurePath
    lever: bending.LeverPath
    per_sample: int
    epoch: int

    def phi(self, t: FloatArray) -> FloatArray:
        """Static angle (n, 3) rad."""
        phi = sampling.static_angle(self.scene.twin.mount.static_arcmin, len(t))
        for effect in self.effects:
            phi = effect.mount(t, phi, self.scene)
        return phi

    def sub_clock(self, t: FloatArray) -> FloatArray:
        """When the sub-IMU measured what it stamps t."""
        return sub_clock(t, self.scene.twin, self.effects)

    def sub(self, motion: Motion) -> sampling.Body:
        """The deck at the sub-IMU, at the times of a motion."""
        arm = np.array(self.scene.twin.mount.lever_arm)
        return sampling.sub_body(motion, self.flexure.at(motion.t), self.phi(motion.t), arm, self.lever)

    def q_m_s(self, t: FloatArray) -> FloatArray:
        """R_m_s (n, 4)."""
        return quaternions.multiply(quaternions.exp(self.flexure.at(t)), quaternions.exp(self.phi(t)))


def built(twin: Twin) -> tuple[tuple[Effect, ...], Twin]:
    """The effects of a twin, and the twin as they change it."""
    made = tuple(effects.build(effect.name, effect.parameters) for effect in twin.effect)
    for effect in made:
        twin = effect.twin(twin)
    return made, twin


def sub_clock(t: FloatArray, twin: Twin, made: Sequence[Effect]) -> FloatArray:
    """Instants (n,) s at which the sub-IMU measured what it stamps t; t itself when its clock is right."""
    for effect in made:
        t = effect.sub_clock(t)
    return t - twin.mount.time_delay if twin.mount.time_delay else t


def phins_clock(unit: str, t: FloatArray, made: Sequence[Effect]) -> FloatArray:
    """Instants (n,) s of the attitudes of a PHINS stamped t."""
    for effect in made:
        t = effect.phins_clock(unit, t)
    return t


def reach(instants: Sequence[FloatArray], cutoff: float) -> tuple[float, float]:
    """First and last time (s) of the flexure that instants need; the first one is not moved by a delay."""
    spread = bending.margin(cutoff)
    earliest = min(float(t.min()) for t in instants) - spread
    return LEAD * float(np.floor(earliest / LEAD)), max(float(t.max()) for t in instants) + spread


def draw(
    scene: Scene,
    made: tuple[Effect, ...],
    instants: Sequence[FloatArray],
    per_sample: int,
    streams: Streams,
    epoch: int,
) -> World:
    """The world with its flexure drawn at an even grid and at all instants."""
    earliest, latest = reach(instants, scene.twin.mount.lever_bandwidth)
    step = 1.0 / (per_sample * scene.twin.run.rate)
    count = np.arange(int(np.floor(earliest / step)), int(np.ceil(latest / step)) + 1)
    grid = np.asarray(count * step, dtype=np.float64)
    path = bending.draw_path([grid, *instants], scene, made, streams["flexure"])
    lever = bending.lever_path(path, grid, scene.twin.mount.lever_bandwidth)
    return World(scene, made, effects.generators(made, streams["effects"]), path, lever, per_sample, epoch)


def samples(body: sampling.Body, t: FloatArray, every: int) -> tuple[FloatArray, FloatArray]:
    """Gyro and accelerometer samples of a body known at nodes t."""
    return sampling.mean_rate(body.q_i_b[::every], t[::every]), sampling.mean_force(body.force, every)


def imu(world: World, unit: str, stamp: IntArray, gyro: FloatArray, accel: FloatArray, streams: Streams) -> ImuSeries:
    """A unit's series from ideal samples: effects, errors, effects on the finished series."""
    scene, belief, draws = world.scene, getattr(world.scene.twin.imu, unit), world.draws
    t = np.asarray((stamp - world.epoch) * 1e-9, dtype=np.float64)
    for effect, rng in zip(world.effects, draws):
        gyro = effect.gyro(unit, t, gyro, accel, scene, rng)
        accel = effect.accel(unit, t, accel, scene, rng)
    gyro = sensors.spoil_gyro(gyro, belief, scene.twin.run.rate, streams[unit])
    accel = sensors.spoil_accel(accel, belief, scene.twin.run.rate, streams[unit])
    if unit == "sliding" and scene.twin.deck is not None:
        deck, rate = scene.twin.deck, scene.twin.run.rate
        gyro = gyro + sensors.outliers(len(gyro), rate, deck.outlier_rate, deck.outlier_size, streams[unit])
    return _finished(ImuSeries(stamp, gyro, accel), unit, world)


def _finished(series: ImuSeries, unit: str, world: World) -> ImuSeries:
    for effect, rng in zip(world.effects, world.draws):
        series = effect.imu(unit, series, world.scene, rng)
    return series


@dataclass(frozen=True)
class Carried:
    """What stands under a PHINS: its stamps (n,) ns and s, their rate (Hz), ideal samples and attitude of the IMU."""

    stamp: IntArray
    t: FloatArray
    rate: float
    gyro: FloatArray
    accel: FloatArray
    q_n_imu: FloatArray


def phins(world: World, unit: str, under: Carried, rng: np.random.Generator) -> ImuSeries:
    """A PHINS: rates, force and attitude in its own axes, R_n_phins = R_n_imu R_imu_phins."""
    belief, rate = world.scene.twin.phins, under.rate
    angles = belief.installation_main_deg if unit == "phins_main" else belief.installation_sub_deg
    attitude = sensors.phins_attitude(_as_stamped(world, unit, under), angles, belief, rate, rng)
    for effect, own in zip(world.effects, world.draws):
        attitude = effect.attitude(unit, under.t, attitude, world.scene, own)
    turn, noise = sensors.installation(angles), sensors.phins_noise(belief)
    series = ImuSeries(
        stamp=under.stamp,
        gyro=sensors.spoil_gyro(under.gyro @ turn, noise, rate, rng),
        accel=sensors.spoil_accel(under.accel @ turn, noise, rate, rng),
        attitude=attitude,
    )
    return _finished(series, unit, world)


def _as_stamped(world: World, unit: str, under: Carried) -> FloatArray:
    """The attitude of the unit's place at the times its clock says; the one there is when the clock is right."""
    measured = phins_clock(unit, under.t, world.effects)
    if np.array_equal(measured, under.t):
        return under.q_n_imu
    return in_slabs(lambda part: attitude(world, unit, part), measured)


def attitude(world: World, unit: str, t: FloatArray) -> FloatArray:
    """Attitude (n, 4), body to ENU, of the main IMU or, for ``phins_sub``, of the deck at the sub-IMU."""
    q_n_m = world.scene.motion(t).q_n_m
    return q_n_m if unit == "phins_main" else quaternions.multiply(q_n_m, world.q_m_s(t))


def in_slabs(function: Callable[[FloatArray], FloatArray], t: FloatArray) -> FloatArray:
    """Values of a function at many times, worked out piece by piece."""
    return np.concatenate([function(t[k : k + NODES]) for k in range(0, len(t), NODES)])
