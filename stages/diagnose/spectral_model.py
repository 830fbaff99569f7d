"""The spectrum that a twin predicts for the rate residual, with nuisances and with effects whose parameters are free.

    S_i(w) = H[ flexure_i(w; mu_i, b_i^2, sigma_i) ] + (N_m^2 + N_s^2) / T + ...    about each m-axis i

flexure_i is the spectrum of increments of theta over the sample interval T, divided by T^2 (:mod:`physics.whittle`,
exact with its aliases); effects act on it, and add noise, by their hooks ``flexure_density`` and ``noise_density``.
Everything is positive and fitted in natural logarithms. Nuisances: mu, b^2, sigma of each axis and N_s. They are never
exactly the twin's: within TOLERANCE they are free; beyond, it takes an effect that releases them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from physics import whittle
from physics.units import ARCMIN, DEG_PER_SQRT_HOUR
from schemas.rig import FloatArray
from stages.diagnose.spectral_data import Grid, Spectra
from twin import effects
from twin.config import Twin
from twin.effects import Effect
from twin.effects._parameters import AXES
from twin.effects.gyro_bandwidth import GyroBandwidth

NUISANCES = 10
FLEXURE, NOISE = slice(0, 9), 9
DAMPING, STIFFNESS, STD = slice(0, 3), slice(3, 6), slice(6, 9)
TOLERANCE = np.log([1.4] * 3 + [1.55] * 3 + [1.2] * 3 + [1.1])  # of mu, b^2, sigma, sub-IMU's ARW; factors either way
RELEASED = 4.0  # natural log, either way, of a nuisance that an effect releases
WIDE = 1.5  # natural-log standard deviation of the weak prior on a released nuisance
RELEASES = {"flexure_parameters": FLEXURE, "gyro_random_walk": slice(NOISE, NOISE + 1)}
LEAST_ARCMIN, LEAST_ARW = 1e-3, 1e-6  # arcmin, deg/sqrt(h): a twin's zero
BEYOND = 2.0  # factor by which a fit may leave the prior range of an effect's parameter


@dataclass(frozen=True)
class Slot:
    """An effect that acts by its densities, with free parameters. variant: its axis where it has one, the form of a
    low-pass."""

    name: str
    variant: str = ""

    @property
    def axis(self) -> str:
        """x, y or z, or empty."""
        return self.variant if self.variant in AXES else ""

    @cached_property
    def effect(self) -> type[Effect]:
        """Its class."""
        return effects.get(self.name)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of its free parameters."""
        return tuple(item.name for item in self.effect.parameters())

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, p) natural logs."""
        prior = np.array([item.prior for item in self.effect.parameters()]).T
        return np.log(prior * np.array([[1.0 / BEYOND], [BEYOND]]))

    @cached_property
    def axes(self) -> tuple[int, ...]:
        """Axes of m on which it can be seen."""
        return (AXES.index(self.axis),) if self.axis else (0, 1, 2)  # type: ignore[arg-type]

    def at(self, x: FloatArray) -> Effect:
        """The effect with parameters exp(x)."""
        values = {name: float(np.exp(value)) for name, value in zip(self.parameters, x)}
        if self.variant in LOW_PASSES:
            return LOW_PASSES[self.variant].model_construct(**values)  # type: ignore[arg-type]
        if self.axis:
            values["axis"] = self.axis  # type: ignore[assignment]
        return self.effect.model_construct(**values)  # type: ignore[arg-type]


def variants(name: str) -> tuple[str, ...]:
    """What an effect is tried as: about each axis, as each form of low-pass, or as it is."""
    if name == "gyro_bandwidth":
        return ("", *LOW_PASSES)
    return AXES if "axis" in effects.get(name).model_fields else ("",)


@dataclass(frozen=True)
class Model:
    """A twin's spectrum on a grid. own: the twin's effects that act by their densities. slots: effects with free
    parameters. released: names of effects that free nuisances. share: (g,) places in time, one unless it moves."""

    twin: Twin
    own: tuple[Effect, ...]
    grid: Grid
    slots: tuple[Slot, ...] = ()
    released: frozenset[str] = frozenset()

    @classmethod
    def of(cls, twin: Twin, grid: Grid) -> Model:
        """The twin's own, with nothing but nuisances free."""
        own = tuple(effects.build(spec.name, spec.parameters) for spec in twin.effect)
        for effect in own:
            twin = effect.twin(twin)
        return cls(twin, own, grid)

    def plus(self, name: str, variant: str = "") -> Model:
        """With another effect."""
        if name in RELEASES:
            return replace(self, released=self.released | {name})
        return replace(self, slots=(*self.slots, Slot(name, variant)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects in it."""
        return (*(slot.name for slot in self.slots), *sorted(self.released))

    @cached_property
    def moves(self) -> bool:
        """Whether the spectrum changes over the record."""
        ones = np.ones(1)
        acting = [*self.own, *(slot.at(slot.bounds.mean(axis=0)) for slot in self.slots)]
        return any(
            not np.array_equal(
                effect.flexure_density(axis, ones, 0.01, ones, 0.0), effect.flexure_density(axis, ones, 0.01, ones, 1.0)
            )
            for effect in acting
            for axis in range(3)
        )

    @cached_property
    def believed(self) -> FloatArray:
        """(10,) natural logs of the nuisances as the twin has them."""
        flexure = self.twin.flexure
        damping, frequency = np.array(flexure.damping), np.array(flexure.frequency)
        std = np.maximum(flexure.std_arcmin, LEAST_ARCMIN) * ARCMIN
        arw = max(self.twin.imu.sub.gyro_arw, LEAST_ARW) * DEG_PER_SQRT_HOUR
        return np.log(np.concatenate([damping, damping**2 + frequency**2, std, [arw]]))

    @cached_property
    def bounds(self) -> FloatArray:
        """(2, p)."""
        room = TOLERANCE.copy()
        for name in self.released:
            room[RELEASES[name]] = RELEASED
        nuisances = self.believed + room * np.array([[-1.0], [1.0]])
        return np.concatenate([nuisances, *(slot.bounds for slot in self.slots)], axis=1)

    @cached_property
    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Centre and standard deviation (p,) of a weak prior."""
        centres = [self.believed, *(slot.bounds.mean(axis=0) for slot in self.slots)]
        spreads = [np.full(NUISANCES, WIDE), *(0.5 * np.diff(slot.bounds, axis=0)[0] for slot in self.slots)]
        return np.concatenate(centres), np.concatenate(spreads)

    def axes_of(self, index: int) -> tuple[int, ...]:
        """Axes on which parameter ``index`` acts."""
        if index < NUISANCES:
            return (0, 1, 2) if index == NOISE else (index % 3,)
        return self._slot_of(index).axes

    def _slot_of(self, index: int) -> Slot:
        ends = np.cumsum([len(slot.parameters) for slot in self.slots])
        return self.slots[int(np.searchsorted(ends, index - NUISANCES, side="right"))]

    def acting(self, x: FloatArray) -> list[Effect]:
        """The twin's own effects and the slots with parameters x, in the order of the simulation's hooks."""
        out, first = list(self.own), NUISANCES
        for slot in self.slots:
            out.append(slot.at(x[first : first + len(slot.parameters)]))
            first += len(slot.parameters)
        return sorted(out, key=lambda effect: _ORDER.get(effect.name, 1))

    def spectrum(self, x: FloatArray, axis: int, shares: Sequence[float] | FloatArray) -> FloatArray:
        """(g, k) spectrum about an axis as Hann segments see it, at each place in time."""
        T, omega = self.grid.interval, self.grid.points
        flexure = _flexure(self.grid, *x[[axis, 3 + axis, 6 + axis]])
        main = self.twin.imu.main.gyro_arw * DEG_PER_SQRT_HOUR
        noise = np.full(len(omega), (main**2 + np.exp(2.0 * x[NOISE])) / T)
        acting, out = self.acting(x), []
        for share in shares:
            a, b = flexure, noise
            for effect in acting:
                a = effect.flexure_density(axis, omega, T, a, share)
                b = effect.noise_density(axis, omega, T, b, share)
            out.append(self.grid.seen(a + b))
        return np.stack(out)

    def data(self, spectra: Spectra) -> Spectra:
        """Spectra as this model needs them: pooled over time unless it moves."""
        return spectra if self.moves else spectra.pooled


class _BeforeSampling(GyroBandwidth):
    """The low-pass acts on the rate itself, before it is averaged over samples and folded: what the effect of that
    name takes as folded first. Far above the flexure's own frequency theta falls as f^-4, which tells the aliases."""

    def flexure_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """Multiplied by the mean of |H|^2 over the aliases."""
        folded = np.maximum(omega, 1e-6)[:, None] + 2.0 * np.pi * np.arange(-3, 4)
        passed = 1.0 / (1.0 + (folded / (2.0 * np.pi * interval * self.cutoff)) ** 2)
        weight = folded**-4
        return np.asarray(density * (passed * weight).sum(axis=1) / weight.sum(axis=1))


class _Recursive(GyroBandwidth):
    """The low-pass is computed from sample to sample, y_k = a y_{k-1} + (1 - a) x_k, a = exp(-2 pi cutoff T)."""

    def flexure_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """Multiplied by |H|^2 of the recursion."""
        a = np.exp(-2.0 * np.pi * self.cutoff * interval)
        return np.asarray(density * (1.0 - a) ** 2 / (1.0 - 2.0 * a * np.cos(omega) + a * a))


LOW_PASSES: dict[str, type[GyroBandwidth]] = {"before sampling": _BeforeSampling, "recursive": _Recursive}

# The sea's flexure is scaled before a mode is added to it, and low-passed after.
_ORDER = {"nonstationary_sea": 0, "second_mode": 1, "slamming": 1, "gyro_bandwidth": 2}


@lru_cache(maxsize=64)
def _flexure(grid: Grid, damping: float, stiffness: float, std: float) -> FloatArray:
    """At the points of a grid; parameters in natural logs. Kept, since most steps of a fit move other parameters."""
    mu, b2, sigma = np.exp([damping, stiffness, std])
    return whittle.increment_spectrum(grid.points, mu, b2, sigma, 0.0, grid.interval) / grid.interval**2
