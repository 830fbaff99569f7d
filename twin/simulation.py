"""From a twin to a trial with its truth: the ship's motion in closed form, all units sampled evenly.

The first stamp is the epoch; its interval begins one sample earlier.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physics import quaternions
from schemas.trial import IntArray, OdometrySeries, Trial, Truth
from twin import sampling, sensors
from twin.config import Twin
from twin.motion import ShipMotion
from twin.scene import Scene
from twin.sea import realise
from twin.sled import DeckPath
from twin.world import (
    NODES,
    STREAMS,
    Carried,
    Streams,
    World,
    built,
    draw,
    imu,
    phins,
    phins_clock,
    reach,
    samples,
    sub_clock,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Simulation:
    """A simulated trial, its truth, and the twin that made it (effects included)."""

    trial: Trial
    truth: Truth
    twin: Twin


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
    changed, epoch = world.scene.twin, world.epoch
    stamp = sensors.stamps(np.arange(sample_count(changed)) / changed.run.rate, epoch)
    trial = Trial(
        main=imu(world, "main", stamp, ideal.main_gyro, ideal.main_accel, streams),
        sub=imu(world, "sub", stamp, ideal.sub_gyro, ideal.sub_accel, streams),
        epoch=epoch,
        source=twin.name,
    )
    trial = _with_phins(trial, world, ideal, streams)
    trial = _with_aids(trial, world, streams)
    return Simulation(_with_sled(trial, world, streams), make_truth(world, ideal, stamp), twin)


def make_world(twin: Twin, streams: Streams) -> World:
    """Draw sea and flexure of a twin."""
    made, twin = built(twin)
    per_sample = sampling.substeps(twin.run.rate, twin.mount.lever_bandwidth)
    stamped = nodes(0, sample_count(twin), per_sample, twin.run.rate)
    measured = sub_clock(stamped, twin, made)
    stamps = stamped[per_sample::per_sample]
    clocks = [phins_clock(unit, stamps, made) for unit in ("phins_main", "phins_sub")]
    instants = [stamped, *(t for t in (measured, *clocks) if t is not stamped and t is not stamps)]
    span = reach(instants, twin.mount.lever_bandwidth)
    scene = Scene(twin, ShipMotion(twin.ship, realise(twin.sea, streams["sea"]), span))
    return draw(scene, made, instants, per_sample, streams, twin.run.start * 1_000_000_000)


def ideal_samples(world: World) -> Ideal:
    """Error-free samples of main and sub, worked out slab by slab."""
    n, size = sample_count(world.scene.twin), max(1, NODES // world.per_sample)
    slabs = [_slab(world, first, min(first + size, n)) for first in range(0, n, size)]
    return Ideal(*(np.concatenate(parts) for parts in zip(*slabs)))


def make_truth(world: World, ideal: Ideal, stamp: IntArray) -> Truth:
    """Deformation at every stamp of the main IMU, as it was then (no delay)."""
    t = np.arange(len(stamp)) / world.scene.twin.run.rate
    theta, phi = world.flexure.at(t), world.phi(t)
    return Truth(stamp, quaternions.log(world.q_m_s(t)), np.array(phi), theta, stamp, ideal.q_n_s)


def sample_count(twin: Twin) -> int:
    """Samples of the main IMU in the run."""
    return round(twin.run.duration * twin.run.rate)


def nodes(first: int, last: int, per_sample: int, rate: float) -> FloatArray:
    """Quadrature nodes (s) of the samples first..last-1, ((last - first) per_sample + 1,)."""
    return np.arange((first - 1) * per_sample, (last - 1) * per_sample + 1) / (per_sample * rate)


def _slab(world: World, first: int, last: int) -> tuple[FloatArray, ...]:
    """The fields of :class:`Ideal` for the samples first..last-1."""
    every = world.per_sample
    t = nodes(first, last, every, world.scene.twin.run.rate)
    motion = world.scene.motion(t)
    main, deck = sampling.main_body(motion), world.sub(motion)
    deck_samples = samples(deck, t, every)
    measured = world.sub_clock(t)
    sub_samples = deck_samples
    if measured is not t and not np.array_equal(measured, t):
        sub_samples = samples(world.sub(world.scene.motion(measured)), measured, every)
    q_m_s = quaternions.multiply(quaternions.conjugate(main.q_i_b[every::every]), deck.q_i_b[every::every])
    q_n_m = motion.q_n_m[every::every]
    return (*samples(main, t, every), *sub_samples, *deck_samples, q_n_m, quaternions.multiply(q_n_m, q_m_s))


def _with_phins(trial: Trial, world: World, ideal: Ideal, streams: Streams) -> Trial:
    """The trial with a PHINS beside each IMU, if the twin has them."""
    if not world.scene.twin.channels.phins:
        return trial
    stamp, rate = trial.main.stamp, world.scene.twin.run.rate
    t = np.arange(len(stamp)) / rate
    main = Carried(stamp, t, rate, ideal.main_gyro, ideal.main_accel, ideal.q_n_m)
    deck = Carried(stamp, t, rate, ideal.deck_gyro, ideal.deck_accel, ideal.q_n_s)
    return replace(
        trial,
        phins_main=phins(world, "phins_main", main, streams["phins_main"]),
        phins_sub=phins(world, "phins_sub", deck, streams["phins_sub"]),
    )


def _with_aids(trial: Trial, world: World, streams: Streams) -> Trial:
    """The trial with GNSS and thermometers, if the twin has them."""
    channels, scene = world.scene.twin.channels, world.scene
    if channels.gnss:
        trial = replace(trial, gnss=sensors.gnss(scene, trial.epoch, streams["gnss"]))
    if channels.temperature:
        main, sub = (sensors.temperature(scene, unit, trial.epoch, streams["temperature"]) for unit in ("main", "sub"))
        trial = replace(trial, temperature_main=main, temperature_sub=sub)
    return trial


def _with_sled(trial: Trial, world: World, streams: Streams) -> Trial:
    """The trial with the sliding SINS and its odometry, if the twin has a deck."""
    deck, run = world.scene.twin.deck, world.scene.twin.run
    if deck is None or deck.start >= run.duration:
        return trial
    path = DeckPath(deck)
    parts = [_sled_run(world, path, *record) for record in path.records(run.duration)]
    t, gyro, accel, position, velocity = (np.concatenate(column) for column in zip(*parts))
    series = imu(world, "sliding", sensors.stamps(t, trial.epoch), gyro, accel, streams)
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
    t = nodes(first, last, every, twin.run.rate)
    motion, sled = world.scene.motion(t), path.at(t, moves, forward)
    bent = quaternions.exp(path.deck.flexure_scale * world.flexure.at(t))
    q_m_b = quaternions.multiply(bent, sled.q_m_sled)
    force = sampling.force_at(motion, np.array(path.deck.origin) + sled.position, sled.velocity, sled.acceleration)
    body = sampling.Body(
        quaternions.multiply(motion.q_i_m, q_m_b), quaternions.rotate(quaternions.conjugate(q_m_b), force)
    )
    return t[every::every], *samples(body, t, every), sled.position[every::every], sled.velocity[every::every]
