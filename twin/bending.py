"""The flexure of a trial at every instant some sensor asks for, and the part of it that moves the lever arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from physics import flexure_path
from physics.units import ARCMIN
from schemas.errors import DataError
from twin.config import Flexure
from twin.effects import Effect, generators
from twin.scene import Scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TICK = 1e-10  # s, instants closer than this are one
MARGIN = 2.0  # s of flexure before and after the record, and at least so many periods of the lever bandwidth


@dataclass(frozen=True)
class FlexurePath:
    """theta at a set of instants. tick: (n,) sorted, in units of TICK. theta: (n, 3) rad, m-axes."""

    tick: IntArray
    theta: FloatArray

    def at(self, t: FloatArray) -> FloatArray:
        """theta (k, 3) at times t (k,) s, all of them among the instants."""
        wanted = ticks(t)
        index = np.minimum(np.searchsorted(self.tick, wanted), len(self.tick) - 1)
        if not np.array_equal(self.tick[index], wanted):
            raise ValueError("flexure asked for at an instant it was not drawn at")
        return self.theta[index]


@dataclass(frozen=True)
class LeverPath:
    """The low-passed flexure that moves the lever arm, on an even grid: theta_f with two derivatives, (n, 3, 3)."""

    start: float
    step: float
    table: FloatArray

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """theta_f, its rate and acceleration, each (k, 3), by quintic Hermite interpolation (error < 1e-6 of each)."""
        x = (t - self.start) / self.step
        index = np.clip(np.floor(x).astype(np.int64), 0, len(self.table) - 2)
        return _quintic(self.table[index], self.table[index + 1], (x - index)[:, None], self.step)


def ticks(t: FloatArray) -> IntArray:
    """Times (s) as whole ticks."""
    return np.rint(np.asarray(t, dtype=float) / TICK).astype(np.int64)


def draw_path(
    instants: Sequence[FloatArray], scene: Scene, effects: Sequence[Effect], rng: np.random.Generator
) -> FlexurePath:
    """The flexure at the union of all instants, drawn exactly, the quasi-static sine and the effects added.

    The first instants are the base: what is asked for beside them does not change the path there.
    """
    tick, base = _union(instants)
    t, draws = np.asarray(tick * TICK, dtype=np.float64), generators(effects, rng)
    theta = _markov(scene.twin.flexure, t, base, rng)
    for effect in effects:
        theta = effect.sea_flexure(t, theta, scene)
    theta = theta + quasi_static(scene.twin.flexure, t)
    for effect, draw in zip(effects, draws):
        theta = effect.flexure(t, theta, scene, draw)
    if theta.shape != (len(t), 3) or not np.isfinite(theta).all():
        raise DataError("an effect left a flexure that is not a finite path")
    return FlexurePath(tick, theta)


def quasi_static(belief: Flexure, t: FloatArray) -> FloatArray:
    """amplitude sin(2 pi t / period) (n, 3) rad."""
    amplitude = np.array(belief.quasi_static_amplitude_arcmin) * ARCMIN
    return np.sin(2.0 * np.pi * t / belief.quasi_static_period)[:, None] * amplitude


def lever_path(path: FlexurePath, grid: FloatArray, cutoff: float) -> LeverPath:
    """theta_f = H theta with |H(f)| = 1 / (1 + (f/f_c)^4) and no phase, on an even grid (n,) s of the path's instants.

    theta'' is white in the model, so that some band has to be chosen in which the structure moves as a whole; H is a
    second-order Butterworth filter run forwards and backwards. The grid's ends (MARGIN) are not to be used.
    """
    step = (grid[-1] - grid[0]) / (len(grid) - 1)
    theta = path.at(grid)
    ramp = np.linspace(0.0, 1.0, len(grid))[:, None] * (theta[-1] - theta[0]) + theta[0]
    size = fft.next_fast_len(len(grid), real=True)
    table = np.empty((len(grid), 3, 3))
    omega = 2.0 * np.pi * fft.rfftfreq(size, step)
    gain = 1.0 / (1.0 + (omega / (2.0 * np.pi * cutoff)) ** 4)
    for axis in range(3):
        spectrum = fft.rfft(theta[:, axis] - ramp[:, axis], size) * gain
        for order in range(3):
            table[:, order, axis] = fft.irfft(spectrum * (1j * omega) ** order, size)[: len(grid)]
    table[:, 0] += ramp
    table[:, 1] += (theta[-1] - theta[0]) / (grid[-1] - grid[0])
    return LeverPath(float(grid[0]), float(step), table)


def margin(cutoff: float) -> float:
    """Seconds of flexure needed beyond either end of what is used."""
    return max(MARGIN, 6.0 / cutoff)


def _union(instants: Sequence[FloatArray]) -> tuple[IntArray, NDArray[np.bool_]]:
    """All instants in order (ticks), and which of them belong to the first set or lie outside it."""
    first = ticks(instants[0])
    tick = np.sort(np.concatenate([ticks(t) for t in instants]), kind="stable")  # sorted runs: quick to merge
    tick = tick[np.concatenate([[True], np.diff(tick) > 0])]
    nearest = first[np.minimum(np.searchsorted(first, tick), len(first) - 1)]
    return tick, (nearest == tick) | (tick < first[0]) | (tick > first[-1])


def _markov(belief: Flexure, t: FloatArray, base: NDArray[np.bool_], rng: np.random.Generator) -> FloatArray:
    """Second-order Gauss-Markov paths (n, 3) rad at increasing times, those of the base drawn first."""
    damping, frequency = np.array(belief.damping), np.array(belief.frequency)
    std = np.array(belief.std_arcmin) * ARCMIN
    axes = flexure_path.Axes(damping, damping**2 + frequency**2, std, correlation(belief))
    main, other = rng.spawn(2)
    step = np.diff(ticks(t[base])) * TICK
    drawn = flexure_path.draw(axes, step, main)
    theta = np.empty((len(t), 3))
    theta[base] = drawn[:, :, 0].T * std
    if not base.all():
        theta[~base] = flexure_path.between(axes, t[base], drawn, t[~base], other).T * std
    return theta


def correlation(belief: Flexure) -> FloatArray:
    """Correlation (3, 3) of the white forcing of the axes."""
    xy, xz, yz = belief.correlation
    return np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])


def _quintic(left: FloatArray, right: FloatArray, x: FloatArray, h: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Value, rate, acceleration at fraction x (k, 1) between nodes with value, rate, acceleration (k, 3, 3)."""
    a0, a1, a2 = left[:, 0], left[:, 1] * h, 0.5 * left[:, 2] * h * h
    p, v, a = right[:, 0] - a0 - a1 - a2, right[:, 1] * h - a1 - 2.0 * a2, right[:, 2] * h * h - 2.0 * a2
    a3 = 10.0 * p - 4.0 * v + 0.5 * a
    a4 = -15.0 * p + 7.0 * v - a
    a5 = 6.0 * p - 3.0 * v + 0.5 * a
    value = a0 + x * (a1 + x * (a2 + x * (a3 + x * (a4 + x * a5))))
    rate = a1 + x * (2.0 * a2 + x * (3.0 * a3 + x * (4.0 * a4 + x * 5.0 * a5)))
    acceleration = 2.0 * a2 + x * (6.0 * a3 + x * (12.0 * a4 + x * 20.0 * a5))
    return value, rate / h, acceleration / (h * h)
