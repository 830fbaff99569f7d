"""Causes in the deck and in how the sub-IMU sits on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from typing_extensions import override

from physics.units import ARCMIN, DEG
from pipeline.blind.reality import paths
from pipeline.blind.reality.causes import Cause
from pipeline.blind.reality.flexure import STEP, Bend, Restoring, grid, random_path
from pipeline.blind.reality.motion import ShipPath
from pipeline.blind.reality.nature import Nature

FloatArray = NDArray[np.float64]

LAG = 20.0  # s, of bending behind heel
LAG_STEP = 0.05  # s, of its integration


class LeverArm(Cause):
    """The sub-IMU stands elsewhere."""

    @override
    def nature(self, nature: Nature) -> Nature:
        return nature.with_deck(lever=nature.deck.lever + self.vector())


class StaticMisalignment(Cause):
    """Another static angle."""

    @override
    def nature(self, nature: Nature) -> Nature:
        return nature.with_deck(static=nature.deck.static + self.vector() * ARCMIN)


class MisalignmentStep(Cause):
    """The mounting slips at a time."""

    @override
    def mount(self, t: FloatArray) -> FloatArray | None:
        return np.where(t[:, None] >= self.number("time"), self.vector() * ARCMIN, 0.0)


class ThermalBending(Cause):
    """The deck bends slowly in the sun."""

    @override
    def bend(self, ship: ShipPath, nature: Nature, rng: np.random.Generator) -> Bend | None:
        amplitude, w = self.vector("amplitude") * ARCMIN, 2.0 * np.pi / self.number("period")
        return lambda t: np.outer(np.sin(w * t), amplitude)


class FlexureParameters(Cause):
    """Another deck: mu, lambda, sigma per axis; an axis left out stays as it is."""

    @override
    def nature(self, nature: Nature) -> Nature:
        deck = nature.deck
        for key, unit in (("damping", 1.0), ("frequency", 1.0), ("std_arcmin", ARCMIN)):
            field = key.removesuffix("_arcmin")
            given = self.parameters.get(key, (None, None, None))
            values = [old if new is None else new * unit for new, old in zip(given, getattr(deck, field))]
            deck = replace(deck, **{field: np.array(values)})  # type: ignore[arg-type]
        return replace(nature, deck=deck)


class SecondMode(Cause):
    """Another mode on one axis, shaken by noise of its own."""

    @override
    def reshape(self, t: FloatArray, path: FloatArray, nature: Nature, rng: np.random.Generator) -> FloatArray:
        alone = replace(
            nature.deck,
            damping=np.full(3, self.number("damping")),
            frequency=np.full(3, self.number("frequency")),
            std=np.full(3, self.number("std_arcmin") * ARCMIN),
            correlation=np.eye(3),
        )
        mode = random_path(alone, t, (Restoring(),) * 3, np.ones(len(t)), rng)
        out = path.copy()
        out[:, self.axis] += mode[:, self.axis]
        return out


class AxisCoupling(Cause):
    """The axes are shaken together."""

    @override
    def nature(self, nature: Nature) -> Nature:
        more = np.zeros((3, 3))
        for i, j, key in ((0, 1, "xy"), (0, 2, "xz"), (1, 2, "yz")):
            more[i, j] = more[j, i] = float(self.parameters.get(key, 0.0))
        return nature.with_deck(correlation=nature.deck.correlation + more)


class AmplitudeStiffening(Cause):
    """The deck is stiffer the more it bends."""

    @override
    def restoring(self, axis: int, nature: Nature) -> Restoring | None:
        return Restoring(gain=self.number("gain") / ARCMIN**2)


class WaveForcedBending(Cause):
    """The deck bends with the roll."""

    @override
    def bend(self, ship: ShipPath, nature: Nature, rng: np.random.Generator) -> Bend | None:
        share = self.vector() * ARCMIN / DEG
        return lambda t: np.outer(paths.quintic(ship.signals[1:2], ship.first, 0.02, t)[0, 0], share)


class HeelBending(Cause):
    """The deck follows lateral force through a lag of 20 s, begun well before the record."""

    @override
    def bend(self, ship: ShipPath, nature: Nature, rng: np.random.Generator) -> Bend | None:
        first = ship.first + 1.0
        t = first + LAG_STEP * np.arange(int((nature.duration + 20.0 - first) / LAG_STEP))
        force = ship.at(np.minimum(t, ship.first + 0.02 * (ship.signals.shape[2] - 3))).force[:, 0]
        follows = np.empty_like(force)
        follows[0] = force[: int(3 * LAG / LAG_STEP)].mean()
        share = 0.5 * LAG_STEP / LAG
        for k in range(len(force) - 1):  # trapezoidal rule
            follows[k + 1] = ((1.0 - share) * follows[k] + share * (force[k] + force[k + 1])) / (1.0 + share)
        rate = (force - follows) / LAG
        size = self.vector() * ARCMIN
        return lambda t: paths.cubic(follows[:, None], rate[:, None], first, LAG_STEP, t) * size


class Slamming(Cause):
    """Blows at random times set the deck ringing."""

    @override
    def bend(self, ship: ShipPath, nature: Nature, rng: np.random.Generator) -> Bend | None:
        count = max(1, round(self.number("rate") / 60.0 * nature.duration))
        blows = rng.uniform(0.05, 0.95, count) * nature.duration
        decay, w = self.number("damping"), self.number("frequency")
        size, axis = self.number("amplitude") * ARCMIN / w, self.axis

        def ringing(t: FloatArray) -> FloatArray:
            out = np.zeros((len(t), 3))
            for blow in blows:
                since = t - blow
                live = np.flatnonzero((since > 0.0) & (since * decay < 30.0))
                out[live, axis] += size * np.exp(-decay * since[live]) * np.sin(w * since[live])
            return out

        return ringing


class NonstationarySea(Cause):
    """The forcing grows evenly from its value at the start to ``growth`` times it at the end."""

    @override
    def strength(self, t: FloatArray, nature: Nature) -> FloatArray:
        return 1.0 + (self.number("growth") - 1.0) * np.clip(t / nature.duration, 0.0, 1.0)


class BoucWen(Cause):
    """Outside the list. Part of the stiffness is hysteretic and yields; the size is brought back to the deck's."""

    listed = False

    @override
    def restoring(self, axis: int, nature: Nature) -> Restoring | None:
        yields = self.number("yield_sigmas") * nature.deck.std[axis]
        return Restoring(share=1.0 - self.number("hysteretic_share"), yields=yields)

    @override
    def reshape(self, t: FloatArray, path: FloatArray, nature: Nature, rng: np.random.Generator) -> FloatArray:
        return (path - path.mean(axis=0)) * (nature.deck.std / path.std(axis=0))


class FractionalSpectrum(Cause):
    """Outside the list. The spectrum falls by another power: times (1 + (f / knee)^2)^(-order), the size kept."""

    listed = False

    @override
    def reshape(self, t: FloatArray, path: FloatArray, nature: Nature, rng: np.random.Generator) -> FloatArray:
        size = fft.next_fast_len(len(path), real=True)
        f = fft.rfftfreq(size, STEP)
        gain = (1.0 + (f / self.number("knee")) ** 2) ** (-0.5 * self.number("order"))
        bent = fft.irfft(fft.rfft(path, size, axis=0) * gain[:, None], size, axis=0)[: len(path)]
        return bent * (path.std(axis=0) / bent.std(axis=0))


def span(nature: Nature) -> tuple[float, float]:
    """First and last instant (s) of the integration."""
    t = grid(nature.duration)
    return float(t[0]), float(t[-1])
