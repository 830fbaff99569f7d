"""What the two units observed together, at the steps of the filter.

Attitude: ``z = Log(Y R_ref^T)`` at each step, ``Y = A_m^T R_0 A_s`` (:mod:`physics.matching`). Velocity: the mean over
each step of the velocity of the sub-IMU relative to the main one in m-axes, ``u = A_m^T V - omega x r``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from physics import matching
from physics.rotations import log, skew
from schemas.errors import DataError
from schemas.products import Alignment, BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial

STEP_S = 0.2  # s: z is free of noise at each instant, so a few hertz carry all there is
LONG_RECORD_S = 4 * 3600.0  # s: beyond it the step is doubled, so that memory stays bounded
SHORTEST_S = 10.0  # s
SPIKE_SIGMA = 12.0  # of the local spread of second differences
SPIKE_WINDOW = 101  # samples
MARGIN_S = 2.0  # s: more than any delay that is looked for


@dataclass(frozen=True)
class Paired:
    """Both units on the axis of the main one, full rate: what does not depend on alignment.

    main, sub: cleaned units. main_path, sub_path: integrated. stamp: (n,) ns of the main samples on the axis.
    """

    main: matching.Unit
    sub: matching.Unit
    main_path: matching.Strapdown
    sub_path: matching.Strapdown
    spikes: tuple[int, int]

    def between(self, begin: float, end: float) -> Paired:
        """The part from begin to end, s; the sub-IMU's with a margin for any delay."""
        return Paired(
            _cut_unit(self.main, begin, end), _cut_unit(self.sub, begin - MARGIN_S, end + MARGIN_S),
            _cut_path(self.main_path, begin, end), _cut_path(self.sub_path, begin - MARGIN_S, end + MARGIN_S), self.spikes,
        )  # fmt: skip


@dataclass(frozen=True)
class Linearisation:
    """Where the problem is linearised: R_0 ~ R_m_s at the start, R_ref = Exp(static), delay (s), drift of the delay
    (s/s, about the middle of the record), lever arm r (3,) m, coupling B (3, 3) of flexure into the lever arm
    (nominally -[r x]), gyro_bias (3,) rad/s and scale (3, 3): errors of the sub's gyro in its own axes."""

    R_0: FloatArray
    R_ref: FloatArray
    delay: float
    drift: float
    lever_arm: FloatArray
    coupling: FloatArray
    gyro_bias: FloatArray
    scale: FloatArray

    @classmethod
    def at(cls, alignment: Alignment, lever_arm: FloatArray | None = None) -> Linearisation:
        """Where an alignment and, if known, a lever arm say to begin."""
        r = np.zeros(3) if lever_arm is None else lever_arm
        delay = float(alignment.time_delay.value)
        return cls(alignment.rotation, alignment.rotation, delay, 0.0, r, -skew(r), np.zeros(3), np.zeros((3, 3)))


@dataclass(frozen=True)
class Observations:
    """Full rate (n samples) and per step (N steps of ``every`` samples).

    t: (n,) s. good: (n,) bool, measured by both units. Y, A_m: (n,) rotations. rate_s_m: (n, 3) rad/s, sub rate in
    m-axes at the stamps. index: (N,) sample of each step's end. z: (N, 3) rad. u: (N, 3) m/s mean over the step, NaN
    where the step has gaps. The remaining arrays are the geometry that the model's matrices are made of.
    """

    t: FloatArray
    good: BoolArray
    jump_s: FloatArray
    Y: Rotation
    A_m: Rotation
    rate_s_m: FloatArray
    increments_s_m: FloatArray
    index: IntArray
    dt: FloatArray
    z: FloatArray
    u: FloatArray
    A_end: FloatArray
    A_mid: FloatArray
    A_integral: FloatArray
    A_start: FloatArray
    omega: FloatArray
    force_i: FloatArray
    force_s_m: FloatArray
    centred: FloatArray


def _cut_unit(unit: matching.Unit, begin: float, end: float) -> matching.Unit:
    part = slice(*np.searchsorted(unit.t, [begin, end]))
    return matching.Unit(unit.t[part], unit.gyro[part], unit.accel[part], unit.filled[part])


def _cut_path(path: matching.Strapdown, begin: float, end: float) -> matching.Strapdown:
    part = slice(*np.searchsorted(path.t, [begin, end]))
    return matching.Strapdown(path.t[part], path.attitude[part], path.velocity[part])


def _spikes(values: FloatArray) -> BoolArray:
    """Samples that stand out of both neighbours by many local spreads, any axis."""
    if len(values) < SPIKE_WINDOW:
        return np.zeros(len(values), bool)
    bend = np.zeros_like(values)
    bend[2:-2] = values[2:-2] - 0.25 * (values[:-4] + values[1:-3] + values[3:-1] + values[4:])
    blocks = np.abs(bend[: len(bend) // SPIKE_WINDOW * SPIKE_WINDOW]).reshape(-1, SPIKE_WINDOW, values.shape[1])
    local = 1.4826 * np.median(blocks, axis=1)
    spread = np.repeat(np.maximum(local, np.median(local, axis=0)), SPIKE_WINDOW, axis=0)
    spread = np.concatenate([spread, np.repeat(spread[-1:], len(values) - len(spread), axis=0)])
    high = np.abs(bend) > SPIKE_SIGMA * spread + 1e-12
    # A spike leaks a quarter of its height into its neighbours' bends; only the peaks are spikes.
    peak = np.abs(bend) >= np.maximum.reduce([np.roll(np.abs(bend), s, axis=0) for s in (-2, -1, 1, 2)])
    return np.any(high & peak, axis=1)


def clean_unit(series: ImuSeries, epoch: int) -> tuple[matching.Unit, int]:
    """A unit without gaps and spikes: both are bridged and marked as filled."""
    t = (series.stamp - epoch) * 1e-9
    gyro, accel = series.gyro, series.accel
    if series.instantaneous:
        gyro, accel = matching.interval_means(t, gyro), matching.interval_means(t, accel)
    bad = _spikes(gyro) | _spikes(accel)
    bad[[0, -1]] = False
    keep = ~bad
    unit = matching.bridge(t[keep], gyro[keep], accel[keep])
    return unit, int(bad.sum())


def pair(trial: Trial) -> Paired:
    """Clean and integrate both units."""
    main, spikes_main = clean_unit(trial.main, trial.epoch)
    sub, spikes_sub = clean_unit(trial.sub, trial.epoch)
    return Paired(main, sub, matching.strapdown(main), matching.strapdown(sub), (spikes_main, spikes_sub))


def _corrected_sub(paired: Paired, at: Linearisation) -> matching.Strapdown:
    """The sub-IMU's path with the known gyro errors taken out."""
    if not at.gyro_bias.any() and not at.scale.any():
        return paired.sub_path
    sub = paired.sub
    gyro = sub.gyro - at.gyro_bias - sub.gyro @ at.scale.T
    return matching.strapdown(matching.Unit(sub.t, gyro, sub.accel, sub.filled))


def _overlap(paired: Paired, at: Linearisation) -> tuple[slice, FloatArray]:
    """The main samples whose instant the sub-IMU saw, and those instants on the sub-IMU's clock."""
    t = paired.main.t
    middle = 0.5 * (t[0] + t[-1])
    on_sub = t + at.delay + at.drift * (t - middle)
    first = int(np.searchsorted(on_sub, paired.sub.t[0]))
    last = int(np.searchsorted(on_sub, paired.sub.t[-1], side="right"))
    if last - first < 5 or t[last - 1] - t[first] < SHORTEST_S:
        raise DataError(f"the two units overlap for less than {SHORTEST_S:.0f} s")
    return slice(first, last), on_sub[first:last]


def _sub_filled(sub: matching.Unit, on_sub: FloatArray) -> BoolArray:
    """Instants whose sub-IMU interval was bridged."""
    k = np.clip(np.searchsorted(sub.t, on_sub), 1, len(sub.t) - 1)
    return np.asarray(sub.filled[k] | sub.filled[k - 1])


def _jumps(t: FloatArray, bad: BoolArray) -> FloatArray:
    """(n,) s: at the first good sample after a bridged stretch its length, else 0."""
    jump = np.zeros(len(t))
    last_good = -1
    for k in np.flatnonzero(~bad):
        if last_good >= 0 and k - last_good > 1:
            jump[k] = t[k] - t[last_good]
        last_good = int(k)
    return jump


def observe(paired: Paired, at: Linearisation) -> Observations:
    """Observations about one linearisation."""
    inside, on_sub = _overlap(paired, at)
    t = paired.main.t[inside]
    sub = matching.interpolate(_corrected_sub(paired, at), on_sub)
    A_m = Rotation.from_quat(paired.main_path.attitude[inside])
    A_m = A_m[0].inv() * A_m
    A_s = Rotation.from_quat(sub.attitude)
    A_s = A_s[0].inv() * A_s
    R_0 = Rotation.from_matrix(at.R_0)
    Y = A_m.inv() * R_0 * A_s
    start = Rotation.from_quat(paired.main_path.attitude[inside.start]).inv()
    v_m = start.apply(paired.main_path.velocity[inside] - paired.main_path.velocity[inside.start])
    start_s = R_0 * Rotation.from_quat(sub.attitude[0]).inv()
    v_s = start_s.apply(sub.velocity - sub.velocity[0])
    bad = paired.main.filled[inside] | _sub_filled(paired.sub, on_sub)
    return _per_step(t, bad, A_m, Y, A_m.inv().apply(v_s - v_m), v_m, at)


def _per_step(
    t: FloatArray, bad: BoolArray, A_m: Rotation, Y: Rotation, v: FloatArray, v_m: FloatArray, at: Linearisation
) -> Observations:
    sample = float(np.median(np.diff(t)))
    step = STEP_S if t[-1] - t[0] <= LONG_RECORD_S else 2 * STEP_S
    every = max(1, round(step / sample))
    index = np.arange(0, len(t), every)
    matrices = A_m.as_matrix()
    turned = (A_m[:-1].inv() * A_m[1:]).as_rotvec()
    A_s = A_m * Y
    turned_s = Y[1:].apply((A_s[:-1].inv() * A_s[1:]).as_rotvec())
    rate = np.gradient(np.concatenate([[np.zeros(3)], np.cumsum(turned_s, axis=0)]), t, axis=0)
    dt = np.diff(t[index], prepend=t[0])
    mean = lambda x: _step_means(x, index)  # noqa: E731
    omega = (
        np.concatenate([[np.zeros(3)], np.add.reduceat(turned[: index[-1]], index[:-1])])
        / np.maximum(dt, 1e-9)[:, None]
    )
    A_mean = mean(matrices.reshape(-1, 9)).reshape(-1, 3, 3)
    A_start = matrices[np.concatenate([[0], index[:-1]])]
    force_i = np.zeros((len(index), 3))
    force_i[1:] = np.diff(v_m[index], axis=0) / dt[1:, None]
    u = mean(v) - _end_correction(v, t, index) - np.cross(omega, at.lever_arm)
    gap_in_step = np.concatenate([[True], np.add.reduceat(bad[: index[-1]].astype(int), index[:-1]) > 0]) | bad[index]
    u[gap_in_step] = np.nan
    z = log((Y[index] * Rotation.from_matrix(at.R_ref).inv()).as_matrix())
    z[bad[index]] = np.nan
    relative = A_m.apply(v)
    relative_i = np.zeros((len(index), 3))
    relative_i[1:] = np.diff(relative[index], axis=0) / dt[1:, None]
    force_i = force_i + relative_i  # what the sub-IMU feels: the lever arm's acceleration is not small beside gravity
    force_s_m = np.einsum("kji,kj->ki", A_mean, force_i)
    return Observations(
        t=t, good=~bad, jump_s=_jumps(t, bad), Y=Y, A_m=A_m, rate_s_m=rate, increments_s_m=turned_s, index=index, dt=dt, z=z, u=u,
        A_end=matrices[index], A_mid=A_mean, A_integral=A_mean * dt[:, None, None], A_start=A_start, omega=omega,
        force_i=force_i, force_s_m=force_s_m, centred=t[index] - 0.5 * (t[0] + t[-1]),
    )  # fmt: skip


def _end_correction(x: FloatArray, t: FloatArray, index: IntArray) -> FloatArray:
    """What trapezoid means over the steps lack, by Euler and Maclaurin: h^2/12 (x'(end) - x'(start)) / dt."""
    slope = np.gradient(x, t, axis=0)[index]
    h = (t[-1] - t[0]) / (len(t) - 1)
    out = np.zeros((len(index), x.shape[1]))
    out[1:] = h * h / 12.0 * np.diff(slope, axis=0) / np.diff(t[index])[:, None]
    return out


def _step_means(x: FloatArray, index: IntArray) -> FloatArray:
    """Trapezoid means (N, c) over the steps; the first is the first sample."""
    pairs = 0.5 * (x[:-1] + x[1:])[: index[-1]]
    sums = np.add.reduceat(pairs, index[:-1], axis=0)
    return np.concatenate([x[:1], sums / np.diff(index)[:, None]])
