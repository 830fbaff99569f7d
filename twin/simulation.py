"""From a twin to a trial with its truth.

Conventions: a gyro sample is the exact rotation increment over the interval that ends at its stamp, divided by its
length; an accelerometer sample the mean over the same interval; attitudes are instantaneous. A sub-IMU sample stamped t
was measured at t - delay. The first stamp is the epoch; its interval begins one sample earlier.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physics import quaternions
from schemas.trial import ImuSeries, OdometrySeries, Trial, Truth
from twin import bending, effects, sampling, sensors
from twin.config import Twin
from twin.effects import Effect
from twin.motion import Motion, ShipMotion
from twin.scene import Scene
from twin.sea import realise
from twin.sled import DeckPath

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


@dataclass(frozen=True)
class Simulation:
    """A simulated trial, its truth, and the twin that made it (effects included)."""

    trial: Trial
    truth: Truth
    twin: Twin


@dataclass(frozen=True)
class World:
    """A twin with everything random about ship and flexure drawn. Times in s since the epoch.

    draws: what each effect draws from. per_sample: quadrature steps per sample.
    """

    scene: Scene
    effects: tuple[Effect, ...]
    draws: tuple[np.random.Generator, ...]
    flexure: bending.FlexurePath
    lever: bending.LeverPath
    per_sample: int

    @property
    def samples(self) -> int:
        """Samples of the main IMU."""
        return sample_count(self.scene.twin)

    def nodes(self, first: int, last: int) -> FloatArray:
        """Nodes of the samples first..last-1, ((last - first) per_sample + 1,) s."""
        return _nodes(first, last, self.per_sample, self.scene.twin.run.rate)

    def phi(self, t: FloatArray) -> FloatArray:
        """Static angle (n, 3) rad."""
        phi = sampling.static_angle(self.scene.twin.mount.static_arcmin, len(t))
        for effect in self.effects:
            phi = effect.mount(t, phi, self.scene)
        return phi

    def sub_clock(self, t: FloatArray) -> FloatArray:
        """When the sub-IMU measured what it stamps t."""
        return _sub_clock(t, self.scene.twin, self.effects)

    def sub(self, motion: Motion) -> sampling.Body:
        """The deck at the sub-IMU, at the times of a motion."""
        arm = np.array(self.scene.twin.mount.lever_arm)
        return sampling.sub_body(motion, self.flexure.at(motion.t), self.phi(motion.t), arm, self.lever)


@dataclass(frozen=True)
class Ideal:
    """Error-free samples (n, ...) of main, sub (as stamped) and deck (the sub's place, no delay); q_n: body to ENU."""

    main_gyro: FloatArray
    main_accel: FloatArray
    sub_gyro: FloatArray
    sub_accel: FloatArray
    deck_gyro: FloatArray
    deck_accel: FloatArray
    q_n_m: FloatArray
    q_n_s: FloatArray


def simulate(twin: Twin, rng: np.random.Generator | None = None) -> Simulation:
    """A trial with its truth; the generator defaults to the seed of the twin. Raises ``DataError`` for unknown effects.

    Each instrument draws from a stream of its own, so that leaving a channel out changes no other.
    """
    source = np.random.default_rng(twin.run.seed) if rng is None else rng
    streams = dict(zip(STREAMS, source.spawn(len(STREAMS))))
    world = make_world(twin, streams)
    ideal = ideal_samples(world)
    changed, epoch = world.scene.twin, twin.run.start * 1_000_000_000
    stamp = sensors.stamps(np.arange(world.samples) / changed.run.rate, epoch)
    trial = Trial(
        main=_imu(world, "main", stamp, ideal.main_gyro, ideal.main_accel, streams),
        sub=_imu(world, "sub", stamp, ideal.sub_gyro, ideal.sub_accel, streams),
        epoch=epoch,
        source=twin.name,
    )
    trial = _with_phins(trial, world, ideal, streams)
    trial = _with_aids(trial, world, streams)
    return Simulation(_with_sled(trial, world, streams), make_truth(world, ideal, stamp), twin)


def make_world(twin: Twin, streams: dict[str, np.random.Generator]) -> World:
    """Draw sea and flexure of a twin."""
    built = tuple(effects.build(effect.name, effect.parameters) for effect in twin.effect)
    for effect in built:
        twin = effect.twin(twin)
    per_sample = sampling.substeps(twin.run.rate, twin.mount.lever_bandwidth)
    stamped = _nodes(0, sample_count(twin), per_sample, twin.run.rate)
    measured = _sub_clock(stamped, twin, built)
    stamps = stamped[per_sample::per_sample]
    clocks = [_phins_clock(unit, stamps, built) for unit in ("phins_main", "phins_sub")]
    others = [t for t in (measured, *clocks) if t is not stamped and t is not stamps]
    spread = bending.margin(twin.mount.lever_bandwidth)
    earliest = min(t.min() for t in (stamped, *others)) - spread
    earliest = LEAD * np.floor(earliest / LEAD)  # a start that a delay does not move: the same flexure is drawn
    latest = max(t.max() for t in (stamped, *others)) + spread
    scene = Scene(twin, ShipMotion(twin.ship, realise(twin.sea, streams["sea"]), (earliest, latest)))
    step = 1.0 / (per_sample * twin.run.rate)
    count = np.arange(int(np.floor(earliest / step)), int(np.ceil(latest / step)) + 1)
    grid = np.asarray(count * step, dtype=np.float64)
    path = bending.draw_path([grid, stamped, *others], scene, built, streams["flexure"])
    lever = bending.lever_path(path, grid, twin.mount.lever_bandwidth)
    return World(scene, built, effects.generators(built, streams["effects"]), path, lever, per_sample)


def ideal_samples(world: World) -> Ideal:
    """Error-free samples of main and sub, worked out slab by slab."""
    n, size = world.samples, max(1, NODES // world.per_sample)
    slabs = [_slab(world, first, min(first + size, n)) for first in range(0, n, size)]
    return Ideal(*(np.concatenate(parts) for parts in zip(*slabs)))


def make_truth(world: World, ideal: Ideal, stamp: NDArray[np.int64]) -> Truth:
    """Deformation at every stamp of the main IMU, as it was then (no delay)."""
    t = np.arange(world.samples) / world.scene.twin.run.rate
    theta, phi = world.flexure.at(t), world.phi(t)
    total = quaternions.log(quaternions.multiply(quaternions.exp(theta), quaternions.exp(phi)))
    return Truth(stamp, total, np.array(phi), theta, stamp, ideal.q_n_s)


def sample_count(twin: Twin) -> int:
    """Samples of the main IMU in the run."""
    return round(twin.run.duration * twin.run.rate)


def _nodes(first: int, last: int, per_sample: int, rate: float) -> FloatArray:
    return np.arange((first - 1) * per_sample, (last - 1) * per_sample + 1) / (per_sample * rate)


def _sub_clock(t: FloatArray, twin: Twin, built: Sequence[Effect]) -> FloatArray:
    for effect in built:
        t = effect.sub_clock(t)
    return t - twin.mount.time_delay if twin.mount.time_delay else t


def _phins_clock(unit: str, t: FloatArray, built: Sequence[Effect]) -> FloatArray:
    for effect in built:
        t = effect.phins_clock(unit, t)
    return t


def _slab(world: World, first: int, last: int) -> tuple[FloatArray, ...]:
    """The fields of :class:`Ideal` for the samples first..last-1."""
    t, every = world.nodes(first, last), world.per_sample
    motion = world.scene.motion(t)
    main, deck = sampling.main_body(motion), world.sub(motion)
    deck_samples = _samples(deck, t, every)
    measured = world.sub_clock(t)
    sub_samples = deck_samples
    if measured is not t and not np.array_equal(measured, t):
        sub_samples = _samples(world.sub(world.scene.motion(measured)), measured, every)
    q_m_s = quaternions.multiply(quaternions.conjugate(main.q_i_b[every::every]), deck.q_i_b[every::every])
    q_n_m = motion.q_n_m[every::every]
    return (*_samples(main, t, every), *sub_samples, *deck_samples, q_n_m, quaternions.multiply(q_n_m, q_m_s))


def _samples(body: sampling.Body, t: FloatArray, every: int) -> tuple[FloatArray, FloatArray]:
    """Gyro and accelerometer samples of a body known at nodes t."""
    return sampling.mean_rate(body.q_i_b[::every], t[::every]), sampling.mean_force(body.force, every)


def _imu(
    world: World,
    unit: str,
    stamp: NDArray[np.int64],
    gyro: FloatArray,
    accel: FloatArray,
    streams: dict[str, np.random.Generator],
) -> ImuSeries:
    """A unit's series from ideal samples: effects, errors, effects on the finished series."""
    scene, belief, draws = world.scene, getattr(world.scene.twin.imu, unit), world.draws
    t = np.asarray((stamp - scene.twin.run.start * 1_000_000_000) * 1e-9, dtype=np.float64)
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


def _with_phins(trial: Trial, world: World, ideal: Ideal, streams: dict[str, np.random.Generator]) -> Trial:
    """The trial with a PHINS beside each IMU, if the twin has them."""
    if not world.scene.twin.channels.phins:
        return trial
    belief, stamp = world.scene.twin.phins, trial.main.stamp
    main = _phins(
        world,
        "phins_main",
        stamp,
        ideal.main_gyro,
        ideal.main_accel,
        ideal.q_n_m,
        belief.installation_main_deg,
        streams,
    )
    sub = _phins(
        world, "phins_sub", stamp, ideal.deck_gyro, ideal.deck_accel, ideal.q_n_s, belief.installation_sub_deg, streams
    )
    return replace(trial, phins_main=main, phins_sub=sub)


def _phins(
    world: World, unit: str, stamp: NDArray[np.int64], gyro: FloatArray, accel: FloatArray, q_n_imu: FloatArray,
    angles_deg: Sequence[float], streams: dict[str, np.random.Generator],
) -> ImuSeries:  # fmt: skip
    """A PHINS: rates, force and attitude in its own axes, R_n_phins = R_n_imu R_imu_phins."""
    scene, rng = world.scene, streams[unit]
    t = np.arange(world.samples) / scene.twin.run.rate
    attitude = sensors.phins_attitude(
        _attitude_as_stamped(world, unit, t, q_n_imu), angles_deg, scene.twin.phins, scene.twin.run.rate, rng
    )
    for effect, own in zip(world.effects, world.draws):
        attitude = effect.attitude(unit, t, attitude, scene, own)
    turn, noise = sensors.installation(angles_deg), sensors.phins_noise(scene.twin.phins)
    series = ImuSeries(
        stamp=stamp,
        gyro=sensors.spoil_gyro(gyro @ turn, noise, scene.twin.run.rate, rng),
        accel=sensors.spoil_accel(accel @ turn, noise, scene.twin.run.rate, rng),
        attitude=attitude,
    )
    return _finished(series, unit, world)


def _attitude_as_stamped(world: World, unit: str, t: FloatArray, q_n_imu: FloatArray) -> FloatArray:
    """The attitude of the unit's place at the times its clock says; q_n_imu when the clock is right."""
    measured = _phins_clock(unit, t, world.effects)
    if np.array_equal(measured, t):
        return q_n_imu

    def attitude(part: FloatArray) -> FloatArray:
        q_n_m = world.scene.motion(part).q_n_m
        if unit == "phins_main":
            return q_n_m
        theta, phi = quaternions.exp(world.flexure.at(part)), quaternions.exp(world.phi(part))
        return quaternions.multiply(q_n_m, quaternions.multiply(theta, phi))

    return _in_slabs(attitude, measured)


def _in_slabs(function: Callable[[FloatArray], FloatArray], t: FloatArray) -> FloatArray:
    return np.concatenate([function(t[k : k + NODES]) for k in range(0, len(t), NODES)])


def _with_aids(trial: Trial, world: World, streams: dict[str, np.random.Generator]) -> Trial:
    """The trial with GNSS and thermometers, if the twin has them."""
    channels, scene = world.scene.twin.channels, world.scene
    if channels.gnss:
        trial = replace(trial, gnss=sensors.gnss(scene, trial.epoch, streams["gnss"]))
    if channels.temperature:
        main, sub = (sensors.temperature(scene, unit, trial.epoch, streams["temperature"]) for unit in ("main", "sub"))
        trial = replace(trial, temperature_main=main, temperature_sub=sub)
    return trial


def _with_sled(trial: Trial, world: World, streams: dict[str, np.random.Generator]) -> Trial:
    """The trial with the sliding SINS and its odometry, if the twin has a deck."""
    deck, run = world.scene.twin.deck, world.scene.twin.run
    if deck is None or deck.start >= run.duration:
        return trial
    path = DeckPath(deck)
    parts = [_sled_run(world, path, *record) for record in path.records(run.duration)]
    t, gyro, accel, position, velocity = (np.concatenate(column) for column in zip(*parts))
    series = _imu(world, "sliding", sensors.stamps(t, trial.epoch), gyro, accel, streams)
    every, rng = max(1, round(run.rate / deck.odometry_rate)), streams["odometry"]
    odometry = OdometrySeries(
        stamp=sensors.stamps(t[::every], trial.epoch),
        position=position[::every] + deck.position_std * rng.standard_normal((len(t[::every]), 3)),
        velocity=velocity[::every] + deck.velocity_std * rng.standard_normal((len(t[::every]), 3)),
    )
    return replace(trial, sliding=series, sled=odometry)


def _sled_run(
    world: World, path: DeckPath, start: float, end: float, moves: float, forward: bool
) -> tuple[FloatArray, ...]:
    """Stamps, ideal gyro and accelerometer, position and velocity of one recorded run."""
    twin, every = world.scene.twin, world.per_sample
    first, last = int(np.ceil(start * twin.run.rate - 1e-6)), int(np.ceil(end * twin.run.rate - 1e-6))
    t = world.nodes(first, last)
    motion, sled = world.scene.motion(t), path.at(t, moves, forward)
    bent = quaternions.exp(path.deck.flexure_scale * world.flexure.at(t))
    q_m_b = quaternions.multiply(bent, sled.q_m_sled)
    force = sampling.force_at(motion, np.array(path.deck.origin) + sled.position, sled.velocity, sled.acceleration)
    body = sampling.Body(
        quaternions.multiply(motion.q_i_m, q_m_b), quaternions.rotate(quaternions.conjugate(q_m_b), force)
    )
    return t[every::every], *_samples(body, t, every), sled.position[every::every], sled.velocity[every::every]
