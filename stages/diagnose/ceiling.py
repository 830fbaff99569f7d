"""A generic model that could explain nearly anything of mean effects: what it gains on top of the named ones.

Families of regressors without a name: matrices and transfer functions from the ship's rates and forces to the gyros,
accelerometers and the deck, products and powers of rates, gains and clocks that change with time, slow PHINS errors,
constants beyond their tolerance.
Held out, a family gains nothing where the named effects are enough; where one does, it says what is not named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from physics.flexure import driven
from physics.units import STANDARD_GRAVITY
from schemas.rig import FloatArray
from stages.diagnose import slow, whitening
from stages.diagnose.baseline import Baseline
from stages.diagnose.evidence import Gram, Table, combined, held_out, solve
from stages.diagnose.latency import main_column, main_match
from stages.diagnose.regressors import error_periods
from twin.effects._prediction import LogView, OnAxis, Signals, on_axis

LAGS_S = (-0.6, -0.2, 0.2, 0.6)
HARMONICS = (1, 2, 3, 5)
PIECE_S, SHORTEST_SWING_S = 5.0, 20.0  # s, of a clock that swings
SWINGING = "a clock that swings"
SWINGING_PHINS, PHINS_PERIODS = "a PHINS that swings", 2
MAIN_PHINS = "an error of the main PHINS that follows the motion"
SLOW_BENDING = "slow bending"


@dataclass(frozen=True)
class Family:
    """gain: (b,) held-out nats per block. place: channel and axis at which it says the unnamed sits."""

    name: str
    gain: FloatArray
    channel: str
    axis: str


CONSTANTS = {"gyro bias": "sub.gyro", "accel bias": "sub.accel", "static": "sub.gyro"}  # nuisances by name
Made = Callable[[LogView], list[Signals]]


def families(
    base: Baseline, view: LogView, found: Gram, white: FloatArray, kept: list[int], y: FloatArray
) -> tuple[Family, ...]:
    """What each family gains on top of the regressors ``kept`` of a Gram, whitened columns ``white``, best first.

    y: (N, m) whitened innovations, false gyro samples taken out: blocks that do not hold one know nothing of it.
    """
    width = base.whitened.values.shape[1]
    out = _main_phins(base, view, found, white[:, width:], kept, y[:, width:])
    y = y[:, :width]
    known = Table.of(
        [found.names[k] for k in kept], white[:, : y.shape[1]], y, base.t, found.precision[kept], chosen=kept
    )
    swinging = _swinging_clock(base, view, found, white, kept, y)
    found_here = {SWINGING: ("sub.stamp", swinging), SWINGING_PHINS: ("phins_sub.attitude", _swinging_phins(base))}
    for name, (channel, made) in {**FAMILIES, **found_here}.items():
        if channel.startswith("phins") and base.match is None:
            continue
        raw = base.response.many(made(view))[:, :width]
        own = _of_unit_size(whitening.whitened_in_place(base.whitened, np.ascontiguousarray(raw)))
        out.append(_family(name, channel, known, own, y))
    out += [_constant(found, kept, name, channel) for name, channel in CONSTANTS.items()]
    return tuple(sorted(out, key=lambda family: -family.gain.sum()))


def _constant(found: Gram, kept: list[int], name: str, channel: str) -> Family:
    """A constant that a twin knows to its tolerance, beyond that: held out it costs nothing, so that what it saves is
    told, the cost of its prior less a nat an axis."""
    own = [k for k in kept if found.names[k] in [f"{name} {axis}" for axis in "xyz"] and found.total[k, k] > 0.0]
    free = found.precision.copy()
    free[own] = 0.0
    lesser, greater = (solve(found.total, precision, kept) for precision in (found.precision, free))
    nats = greater.gain - lesser.gain - len(own)
    size = np.abs(lesser.value[[kept.index(k) for k in own]])
    axis = "xyz"[int(np.argmax(size))] if own else ""
    blocks = len(found.blocks)
    return Family(f"{name} beyond what the twin allows", np.full(blocks, nats / blocks), channel, axis)


def _family(name: str, channel: str, known: Table, own: FloatArray, y: FloatArray) -> Family:
    """A family of whitened columns (N, m, K) of unit size beside known ones."""
    before, names = len(known.gram.names), [f"{name} {k}" for k in range(own.shape[2])]
    joint = known.widened(names, own, np.full(len(names), 1.0 / 400.0))
    gained = held_out(joint, range(before), range(before, before + len(names)))
    return Family(name, gained, channel, _axis(own, y))


def _main_phins(
    base: Baseline, view: LogView, found: Gram, white: FloatArray, kept: list[int], y: FloatArray
) -> list[Family]:
    """What an error of the main PHINS that follows the ship's rates gains in the channels (N, 3) of its own; nothing
    without a pair of PHINS, whose latency could not be named either."""
    match = main_match(base) if y.shape[1] and base.match is not None else None
    if match is None:
        return []
    seen = [k for k in kept if white[:, :, k].any()]
    known = Table.of([found.names[k] for k in seen], white, y, base.t, found.precision[seen], chosen=seen)
    signals = [Signals(phins_main=x) for x in _matrix(view.omega_m)]
    own = _of_unit_size(np.stack([main_column(base, match, signal) for signal in signals], axis=2))
    told = np.einsum("nmk,nm->k", own, np.nan_to_num(y)) ** 2
    axis = "xyz"[int(np.argmax([told[i::3].sum() for i in range(3)]))]  # the channels' own are those of inertial space
    return [replace(_family(MAIN_PHINS, "phins_main.attitude", known, own, y), axis=axis)]


def _swinging_phins(base: Baseline) -> Made:
    """Errors of the PHINS at the periods with which their innovations ring most, any phase."""
    periods = error_periods(base)[:PHINS_PERIODS]
    return lambda view: [
        Signals(phins=x)
        for period in periods
        for wave in (np.sin, np.cos)
        for x in _each_axis(wave(2.0 * np.pi * view.t / period))
    ]


def _of_unit_size(columns: FloatArray) -> FloatArray:
    """Columns (N, m, K) over their sizes, those without any left out."""
    size = np.sqrt(np.einsum("nmk,nmk->k", columns, columns))
    if not size.all():
        columns, size = columns[:, :, size > 0.0], size[size > 0.0]
    columns /= size
    return columns


def _swinging_clock(base: Baseline, view: LogView, found: Gram, white: FloatArray, kept: list[int], y: FloatArray
) -> Made:  # fmt: skip
    """A clock error of one period: the one that the delay, demodulated in short pieces, swings with most."""
    steady = whitening.whiten_columns(base.whitened, base.response.many([_late(view, np.ones(len(view.t)))]))[:, :, 0]
    values = solve(found.total, found.precision, kept).value
    left = np.nan_to_num(y - combined(white[:, : y.shape[1]], kept, values))
    starts = np.arange(0, len(base.t), max(1, round(PIECE_S / float(np.median(np.diff(base.t))))))
    t = base.t[starts] + 0.5 * PIECE_S
    weight, moment = (np.add.reduceat(np.sum(steady * x, axis=1), starts) for x in (steady, left))
    frequency = np.arange(0.5 / (t[-1] - t[0]), 1.0 / SHORTEST_SWING_S, 0.25 / (t[-1] - t[0]))
    best = frequency[int(np.argmax([_swing(weight, moment, 2.0 * np.pi * f * t) for f in frequency]))]
    swings = [function(2.0 * np.pi * best * view.t) for function in (np.sin, np.cos)]
    return lambda view: [_late(view, s) for s in (np.ones(len(view.t)), *swings)]


def _swing(weight: FloatArray, moment: FloatArray, phase: FloatArray) -> float:
    """Nats that a sine beside a constant gains, given the information (k,) of each piece and its score (k,)."""
    X = np.stack([np.ones(len(phase)), np.sin(phase), np.cos(phase)])
    score, information = X @ moment, (X * weight) @ X.T + 1e-12 * weight.sum() * np.eye(3)
    return float(0.5 * score @ np.linalg.solve(information, score))


def _axis(own: FloatArray, y: FloatArray) -> str:
    y = np.nan_to_num(y)
    gain = [float(np.sum(np.einsum("nmk,nm->mk", own[:, i::3], y[:, i::3]) ** 2)) for i in range(3)]
    return "xyz"[int(np.argmax(gain))]


def _each_axis(values: FloatArray) -> list[OnAxis]:
    return [on_axis(axis, values) for axis in range(3)]


def _matrix(values: FloatArray) -> list[OnAxis]:
    return [one for column in values.T for one in _each_axis(column)]


def _lagged(view: LogView, values: FloatArray) -> list[OnAxis]:
    return [on_axis(axis, np.interp(view.t - lag, view.t, values[:, axis])) for lag in LAGS_S for axis in range(3)]


def _slow(view: LogView) -> list[FloatArray]:
    return list(slow.waves(view.t, HARMONICS).T)


def _diagonal(values: FloatArray) -> list[OnAxis]:
    return [on_axis(axis, values[:, axis]) for axis in range(3)]


def _gyro_matrix(view: LogView) -> list[Signals]:
    return [Signals(gyro=x) for x in _matrix(view.omega_s) + _matrix(view.force_s / STANDARD_GRAVITY)]


def _gyro_transfer(view: LogView) -> list[Signals]:
    return [Signals(gyro=x) for x in _diagonal(view.omega_dot_s) + _lagged(view, view.omega_s)]


def _gyro_powers(view: LogView) -> list[Signals]:
    w = view.omega_s
    products = np.stack([w[:, 0] * w[:, 1], w[:, 1] * w[:, 2], w[:, 2] * w[:, 0]], axis=1)
    powers = _diagonal(np.abs(w) * w) + _diagonal(w**3) + _matrix(w**2) + _matrix(products)
    return [Signals(gyro=x) for x in powers]


def _gyro_gain_in_time(view: LogView) -> list[Signals]:
    return [Signals(gyro=on_axis(axis, s * view.omega_s[:, axis])) for s in _slow(view) for axis in range(3)]


def _gyro_drift(view: LogView) -> list[Signals]:
    return [Signals(gyro=on_axis(axis, s)) for s in _slow(view) for axis in range(3)]


def _clock(view: LogView) -> list[Signals]:
    return [_late(view, s) for s in (np.ones(len(view.t)), *_slow(view))]


def _late(view: LogView, by: FloatArray) -> Signals:
    """The sub-IMU late by (n,) s."""
    return Signals(gyro=-by[:, None] * view.omega_dot_s, accel=-by[:, None] * view.jerk_s)


def _accel_matrix(view: LogView) -> list[Signals]:
    return [Signals(accel=x) for x in _matrix(view.force_s) + _diagonal(view.jerk_s) + _matrix(view.omega_dot_s)]


def _accel_drift(view: LogView) -> list[Signals]:
    return [Signals(accel=on_axis(axis, s)) for s in _slow(view) for axis in range(3)]


def _bending(view: LogView) -> list[Signals]:
    return [Signals(bending=x) for x in _matrix(view.force_m - view.force_m.mean(axis=0)) + _matrix(view.omega_m)]


def _slow_bending(view: LogView) -> list[Signals]:
    return [Signals(bending=on_axis(axis, s)) for s in _slow(view) for axis in range(3)]


def _phins_drift(view: LogView) -> list[Signals]:
    return [Signals(phins=on_axis(axis, s)) for s in _slow(view) for axis in range(3)]


def _phins_motion(view: LogView) -> list[Signals]:
    return [Signals(phins=x) for x in _matrix(view.omega_m) + _matrix(view.force_m - view.force_m.mean(axis=0))]


def _restoring(view: LogView) -> list[Signals]:
    """Bending under moments that are no line: a stiffness or damping that changes with the size of the bending."""
    size = np.maximum(view.theta.std(axis=0), 1e-9)
    x, v = view.foretold[0] / size, view.foretold[1] / (size * np.sqrt(view.stiffness))
    moments = [moment * size * view.stiffness for moment in (x**3, np.abs(x) * v, x**2 * v)]
    return [Signals(bending=on_axis(axis, _answer(view, axis, moment[:, axis])))
            for moment in moments for axis in range(3)]  # fmt: skip


def _answer(view: LogView, axis: int, moment: FloatArray) -> FloatArray:
    damping, stiffness = view.answering[:, axis]
    return driven(damping, stiffness, view.interval, moment)


FAMILIES: Mapping[str, tuple[str, Made]] = {
    "rates and forces seen by the gyros": ("sub.gyro", _gyro_matrix),
    "a transfer function of the gyros": ("sub.gyro", _gyro_transfer),
    "powers and products of rates": ("sub.gyro", _gyro_powers),
    "a gain of the gyros that changes in time": ("sub.gyro", _gyro_gain_in_time),
    "a wandering bias of the gyros": ("sub.gyro", _gyro_drift),
    "a clock that runs unevenly": ("sub.stamp", _clock),
    "forces and rates seen by the accelerometers": ("sub.accel", _accel_matrix),
    "a wandering bias of the accelerometers": ("sub.accel", _accel_drift),
    "bending that follows the ship's motion": ("sub.gyro", _bending),
    SLOW_BENDING: ("sub.gyro", _slow_bending),
    "a deck whose restoring moment is no line": ("sub.gyro", _restoring),
    "a slow error of the PHINS": ("phins_sub.attitude", _phins_drift),
    "an error of the PHINS that follows the motion": ("phins_sub.attitude", _phins_motion),
}
