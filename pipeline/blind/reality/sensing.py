"""From the continuous world to what the instruments write: interval means, errors, noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.blind.reality.causes import Cause
from pipeline.blind.reality.flexure import Bending, Lever
from pipeline.blind.reality.motion import ShipPath, State
from pipeline.blind.reality.nature import Nature, PhinsUnit, Unit, Warmth
from pipeline.blind.reality.turns import Turns
from schemas.trial import GnssSeries, IntArray, ScalarSeries

FloatArray = NDArray[np.float64]

NODES = 4  # sub-intervals of a sample: 400 Hz at 100 Hz
BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0
LEAD = 400  # sub-intervals in which a low-pass forgets how it began
SLAB = 12_000  # samples worked on at a time


@dataclass(frozen=True)
class World:
    """Everything of a log that is fixed before an instrument looks at it."""

    nature: Nature
    causes: tuple[Cause, ...]
    ship: ShipPath
    bending: Bending
    lever: Lever

    def stamped(self) -> FloatArray:
        """Stamps (n,) s since the epoch."""
        return np.arange(round(self.nature.duration * self.nature.rate)) / self.nature.rate

    def sub_clock(self, t: FloatArray) -> FloatArray:
        """When the sub-IMU measured what it stamps t."""
        for cause in self.causes:
            t = cause.sub_clock(t)
        return t - self.nature.delay

    def static(self, t: FloatArray) -> FloatArray:
        """Phi at times t, (n, 3) rad, or (1, 3) where it is constant."""
        phi = self.nature.deck.static[None]
        for cause in self.causes:
            more = cause.mount(t)
            phi = phi if more is None else phi + more
        return phi

    def relative(self, t: FloatArray) -> Turns:
        """R_m_s at times t."""
        return Turns.of_vectors(self.bending.at(t)) @ Turns.of_vectors(self.static(t))


@dataclass(frozen=True)
class Samples:
    """Error-free means over the sample intervals: rate (n, 3) rad/s, force (n, 3) m/s^2."""

    rate: FloatArray
    force: FloatArray


def nodes(stamp: FloatArray, rate: float) -> FloatArray:
    """The instants (4 n + 1,) on which the means of consecutive samples stamped ``stamp`` rest."""
    return np.arange(round(stamp[0] * rate) * NODES - NODES, round(stamp[-1] * rate) * NODES + 1) / (NODES * rate)


def ideal(world: World) -> tuple[Samples, Samples, Samples]:
    """Samples of main, sub (by its own clock) and of the deck at the sub's place (by the right clock)."""
    stamp = world.stamped()
    slabs = [_slab(world, stamp[k : k + SLAB]) for k in range(0, len(stamp), SLAB)]
    return tuple(
        Samples(np.concatenate([s[unit].rate for s in slabs]), np.concatenate([s[unit].force for s in slabs]))
        for unit in range(3)
    )  # type: ignore[return-value]


def _slab(world: World, stamp: FloatArray) -> tuple[Samples, Samples, Samples]:
    t = nodes(stamp, world.nature.rate)
    state = world.ship.at(t)
    main = Samples(mean_rate(state.R_i_m[::NODES], t[::NODES]), mean_force(state.force))
    deck = _sub_samples(world, t, state)
    measured = world.sub_clock(t)
    if np.array_equal(measured, t):
        return main, deck, deck
    return main, _sub_samples(world, measured, world.ship.at(measured)), deck


def _sub_samples(world: World, t: FloatArray, state: State) -> Samples:
    R_m_s = world.relative(t)
    attitude = state.R_i_m @ R_m_s
    rate = mean_rate(attitude[::NODES], t[::NODES])
    for cutoff in (c.cutoff() for c in world.causes):
        if np.isfinite(cutoff):
            rate = rate + _lag(_fine_rate(world, attitude, t), t[1] - t[0], cutoff)
    force = R_m_s.inverse.apply(lever_force(state, world.nature.deck.lever, world.lever.at(t)))
    return Samples(rate, mean_force(force))


def lever_force(state: State, arm: FloatArray, bent: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
    """f + w' x rho + w x (w x rho) + 2 w x rho' + rho'' (n, 3) in m-axes, rho = r + a x r + a x (a x r) / 2."""
    a, a1, a2 = bent
    r = np.broadcast_to(arm, a.shape)
    ar, ar1, ar2 = np.cross(a, r), np.cross(a1, r), np.cross(a2, r)
    rho = r + ar + 0.5 * np.cross(a, ar)
    rho1 = ar1 + 0.5 * (np.cross(a1, ar) + np.cross(a, ar1))
    rho2 = ar2 + 0.5 * (np.cross(a2, ar) + 2.0 * np.cross(a1, ar1) + np.cross(a, ar2))
    w = state.omega
    return state.force + np.cross(state.omega_dot, rho) + np.cross(w, np.cross(w, rho) + 2.0 * rho1) + rho2


def mean_rate(attitude: Turns, t: FloatArray) -> FloatArray:
    """Rotation increments over the intervals by their lengths, (n, 3) rad/s."""
    return (attitude[:-1].inverse @ attitude[1:]).vectors / np.diff(t)[:, None]


def mean_force(force: FloatArray) -> FloatArray:
    """Boole's rule over each sample interval, (n, 3)."""
    n = (len(force) - 1) // NODES
    inner = np.einsum("j,njk->nk", BOOLE[:-1], force[:-1].reshape(n, NODES, 3))
    return inner + BOOLE[-1] * force[NODES::NODES]


def _fine_rate(world: World, attitude: Turns, t: FloatArray) -> FloatArray:
    """Mean rates over the sub-intervals, LEAD of them from before the first."""
    early = t[0] + (t[1] - t[0]) * np.arange(-LEAD, 0)
    before = world.ship.at(early).R_i_m @ world.relative(early)
    return mean_rate(Turns(np.concatenate([before.q, attitude.q])), np.concatenate([early, t]))


def _lag(fine: FloatArray, step: float, cutoff: float) -> FloatArray:
    """What a low-pass tau y' + y = u adds to the means (n, 3), u held over the fine steps (LEAD + 4 n, 3)."""
    tau = 1.0 / (2.0 * np.pi * cutoff)
    a = np.exp(-step / tau)
    after, _ = lfilter([1.0 - a], [1.0, -a], fine, axis=0, zi=a * fine[:1])
    before = np.concatenate([fine[:1], after[:-1]])
    difference = (before - fine) * (1.0 - a) * tau / step
    return difference[LEAD:].reshape(-1, NODES, 3).mean(axis=1)


def spoiled(samples: Samples, unit: Unit, rate: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Rate and force with the unit's errors and noise."""
    n = samples.rate.shape
    gyro = samples.rate + samples.rate @ unit.matrix.T + unit.bias + unit.arw * np.sqrt(rate) * rng.standard_normal(n)
    return gyro, samples.force + unit.accel_bias + unit.vrw * np.sqrt(rate) * rng.standard_normal(n)


def wandering(n: int, std: FloatArray, tau: float, step: float, rng: np.random.Generator) -> FloatArray:
    """First-order Gauss-Markov processes (n, 3), stationary from the start."""
    keep = np.exp(-step / tau)
    shocks = std * np.sqrt(1.0 - keep**2) * rng.standard_normal((n, 3))
    shocks[0] = std * rng.standard_normal(3)
    return lfilter([1.0], [1.0, -keep], shocks, axis=0)


def phins_attitude(world: World, unit: str, rng: np.random.Generator) -> FloatArray:
    """Quaternions (n, 4) of R_n_phins = Exp(e) R_n_imu R_imu_phins, the error e about east, north, up."""
    t, phins = world.stamped(), world.nature.phins
    taken = t
    for cause in world.causes:
        taken = cause.phins_clock(taken)
    error = wandering(len(t), phins.drift, phins.tau, 1.0 / world.nature.rate, rng)
    error += phins.noise * rng.standard_normal((len(t), 3))
    R_n_m = world.ship.at(taken).R_n_m
    if unit == "main":
        return (Turns.of_vectors(error) @ R_n_m @ seat(phins, unit)).xyzw
    for cause in world.causes:
        more = cause.attitude(t)
        error = error if more is None else error + R_n_m.apply(more)
    return (Turns.of_vectors(error) @ R_n_m @ world.relative(taken) @ seat(phins, unit)).xyzw


def seat(phins: PhinsUnit, unit: str) -> Turns:
    """R_imu_phins = Rz(heading) Rx(pitch) Ry(roll) of a unit."""
    angles = phins.installation_main if unit == "main" else phins.installation_sub
    pitch, roll, heading = (Turns.about(axis, angles[k : k + 1]) for k, axis in enumerate((0, 1, 2)))
    return heading @ pitch @ roll


def fixes(world: World, rng: np.random.Generator) -> GnssSeries:
    """One fix a second, half of its error slow."""
    t = np.arange(0.0, np.floor(world.nature.duration))
    place = world.ship.at(t).place
    slow = wandering(len(t), np.array([0.8, 0.8, 1.6]), 40.0, 1.0, rng)
    metres = slow + np.array([0.9, 0.9, 1.8]) * rng.standard_normal((len(t), 3))
    radius = 6.371e6
    return GnssSeries(
        stamp=instants(t, world.nature.epoch),
        latitude=place[:, 0] + metres[:, 1] / radius,
        longitude=place[:, 1] + metres[:, 0] / (radius * np.cos(place[:, 0])),
        altitude=place[:, 2] + metres[:, 2],
        covariance=np.broadcast_to(np.diag([1.5, 1.5, 6.0]), (len(t), 3, 3)).copy(),
    )


def thermometer(warmth: Warmth, unit: int, nature: Nature, rng: np.random.Generator) -> ScalarSeries:
    """A reading a second, deg C."""
    t = np.arange(0.0, np.floor(nature.duration))
    return ScalarSeries(instants(t, nature.epoch), warmth.at(unit, t) + 0.01 * rng.standard_normal(len(t)))


def instants(t: FloatArray, epoch: int) -> IntArray:
    """Stamps in ns."""
    return epoch + np.rint(np.asarray(t) * 1e9).astype(np.int64)


def longest(world_causes: Sequence[Cause], duration: float, delay: float) -> float:
    """How far (s) a clock of the sub-IMU or of the PHINS strays from the right one."""
    t = np.linspace(0.0, duration, 1000)
    stray = abs(delay)
    for cause in world_causes:
        stray += float(np.abs(cause.sub_clock(t) - t).max() + np.abs(cause.phins_clock(t) - t).max())
    return stray
