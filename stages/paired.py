"""What the two units observed together, at the steps of the filter.

Attitude: ``z = Log(Y R_ref^T)`` at each step, ``Y = A_m^T R_0 A_s`` (:mod:`physics.matching`). Velocity: the mean over
each step of the velocity of the sub-IMU relative to the main one in m-axes, ``u = A_m^T V - omega x r``.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from physics import matching
from physics.rotations import skew
from schemas import scratch
from schemas.errors import DataError
from schemas.products import Alignment, BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial
from stages import paths
from stages.motion import fast_level, likely, main_noise
from stages.slabs import beside, slabs
from stages.unfit import unfit

STEP_S = 0.2  # s: z is free of noise at each instant, so a few hertz carry all there is
LONG_RECORD_S = 3700.0  # s: beyond it the step is doubled, which halves time and memory
SHORTEST_S = 10.0  # s
CARRIED_GAP_S = 0.1  # s: a longer gap is carried by the other unit, a shorter one by a straight line
DULL_SHARE = 0.05  # of the interval, by which the instants lie between samples
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
            _cut_path(self.main_path, begin, end), _cut_path(self.sub_path, begin - MARGIN_S, end + MARGIN_S),
            self.spikes,
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
    """Full rate (n samples) and per step (N steps of a fixed number of samples).

    t: (n,) s. good: (n,) bool, measured by both units. main, sub: integrated paths in the inertial frame of the main
    IMU at the first sample (sub: ``R_0 A_s`` and its velocity). index: (N,) sample of each step's end. dt: (N,) s.
    jump_s: (N,) s bridged within the step, gap_end: (N,) s, when the last of it ended. z: (N, 3) rad at the ends.
    u: (N, 3) m/s, mean over the step, NaN where it has gaps. A_start, A_end, A_mid: (N, 3, 3) of A_m. omega: (N, 3)
    rad/s, mean. rate_m: (N, 3) rad/s of the main IMU at the ends. force_i: (N, 3) m/s^2, mean specific force of
    the sub in i, and force_m: (N, 3), of the main IMU in m, both less the white noise of the step.
    centred: (N,) s from the middle. dulled: the sub-IMU was
    interpolated between its samples, which dulls what is fast. What multiplies the delay
    comes from the main IMU, because the sub's own flexure would correlate with it. main_noise: rad^2/s of the main gyro
    and its standard error. motion, rate_motion: (N, 3) rad/s, omega and rate_m less their likely noise;
    A_motion: (N, 3, 3), A_end without what that noise adds up to; bending: (N, 3) rad/s, mean rate of z over the step,
    likewise. They multiply what is unknown (:mod:`stages.motion`).
    """

    t: FloatArray
    good: BoolArray
    main: matching.Strapdown
    sub: matching.Strapdown
    index: IntArray
    dt: FloatArray
    jump_s: FloatArray
    gap_end: FloatArray
    z: FloatArray
    u: FloatArray
    A_start: FloatArray
    A_end: FloatArray
    A_mid: FloatArray
    omega: FloatArray
    motion: FloatArray
    A_motion: FloatArray
    bending: FloatArray
    rate_m: FloatArray
    rate_motion: FloatArray
    force_i: FloatArray
    force_m: FloatArray
    centred: FloatArray
    main_noise: tuple[float, float]
    dulled: bool = False

    @property
    def A_integral(self) -> FloatArray:
        """(N, 3, 3) s, integral of A_m over each step."""
        return np.asarray(self.A_mid * self.dt[:, None, None])

    def total(self, d: FloatArray, delay: FloatArray) -> FloatArray:
        """(n, 4) ``Exp(-A_m^T d + omega_s delay) Y``: R_m_s, given d (N, 3) and delay (N,), s, at the steps."""
        total = scratch.empty((len(self.t), 4))
        for part in slabs(len(self.t)):
            total[part] = self.total_at(part, d, delay)
            scratch.release(total, self.main.attitude, self.sub.attitude)
        return total

    def total_at(self, rows: slice | IntArray, d: FloatArray, delay: FloatArray) -> FloatArray:
        """Some rows of :meth:`total`."""
        t = self.t[rows]
        shift = self.spread(self.rate_m, t) * self.spread(delay[:, None], t)
        return matching.deformation(self.main.attitude[rows], self.sub.attitude[rows], self.spread(d, t), shift)

    def rates(self) -> FloatArray:
        """(n, 3) rad/s, rate of the main IMU at the samples, linear between steps: it multiplies small delays."""
        return self.spread(self.rate_m)

    def spread(self, x: FloatArray, at: FloatArray | None = None) -> FloatArray:
        """(n, c) at full rate, or at times ``at``, of values (N, c) at the steps: linear, but held on either side of a
        bridged gap."""
        at = self.t if at is None else at
        steps, jump_s, gap_end, x = self._about(at, x)
        after = np.flatnonzero(jump_s > 0.0)
        # Two nodes at the end of each gap: the drift may have jumped there by far more than it ever moves in a step.
        nodes = np.concatenate([steps, np.nextafter(gap_end[after], -np.inf), gap_end[after]])
        values = np.concatenate([x, x[after - 1], x[after]])
        order = np.argsort(nodes, kind="stable")
        return np.stack([np.interp(at, nodes[order], column) for column in values[order].T], axis=1)

    def _about(self, at: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The steps on either side of times ``at``: when they end, their gaps and what of x is theirs."""
        steps = self.t[self.index]
        if not len(at):
            return steps[:1], np.zeros(1), self.gap_end[:1], x[:1]
        first, last = np.searchsorted(steps, [at.min(), at.max()])
        near = slice(max(int(first) - 2, 0), int(last) + 2)
        jump_s = self.jump_s[near].copy()
        jump_s[0] = 0.0  # its gap lies before
        return steps[near], jump_s, self.gap_end[near], x[near]


def _cut_unit(unit: matching.Unit, begin: float, end: float) -> matching.Unit:
    part = slice(*np.searchsorted(unit.t, [begin, end]))
    return matching.Unit(unit.t[part], unit.gyro[part], unit.accel[part], unit.filled[part])


def _cut_path(path: matching.Strapdown, begin: float, end: float) -> matching.Strapdown:
    part = slice(*np.searchsorted(path.t, [begin, end]))
    return matching.Strapdown(path.t[part], path.attitude[part], path.velocity[part])


def clean_unit(series: ImuSeries, epoch: int, despike: bool = True) -> tuple[matching.Unit, int]:
    """A unit without gaps and, unless told otherwise, clipped samples and spikes: all bridged and marked as filled."""
    t = scratch.shelved(np.asarray((series.stamp - epoch) * 1e-9, dtype=float))
    gyro, accel = series.gyro, series.accel
    bad = unfit(t, gyro, accel) if despike else np.zeros(len(gyro), bool)
    bad[[0, -1]] = False
    keep = ~bad if bad.any() else slice(None)  # nothing to leave out: no copy
    unit = matching.bridge(t[keep], gyro[keep], accel[keep])
    if series.instantaneous:
        means = matching.interval_means(unit.gyro), matching.interval_means(unit.accel)
        unit = matching.Unit(unit.t, *means, unit.filled)
    scratch.release(series.gyro, series.accel)
    t, gyro, accel = (scratch.shelved(part) for part in (unit.t, unit.gyro, unit.accel))
    return matching.Unit(t, gyro, accel, unit.filled), int(bad.sum())


def pair(trial: Trial, alignment: Alignment | None = None, despike: bool = True) -> Paired:
    """Clean and integrate both units. With an alignment, the other unit, turned, carries one across its own gaps."""
    with ThreadPoolExecutor(beside(len(trial.main))) as pool:  # one unit beside the other
        cleaned = pool.map(lambda series: clean_unit(series, trial.epoch, despike), (trial.main, trial.sub))
        (main, spikes_main), (sub, spikes_sub) = cleaned
        if alignment is not None:
            delay = float(alignment.time_delay.value)
            main = _carried(main, sub, alignment.rotation, delay, ~sub.filled)
            # Where both have a gap the sub follows the bridged main, so that the angle between them is held.
            sub = _carried(sub, main, alignment.rotation.T, -delay, np.ones(len(main.t), bool))
        main_path, sub_path = pool.map(paths.integrated, (main, sub))
    return Paired(main, sub, main_path, sub_path, (spikes_main, spikes_sub))


def _carried(
    unit: matching.Unit, other: matching.Unit, turn: FloatArray, delay: float, usable: BoolArray
) -> matching.Unit:
    """The unit with its long gaps taken from the other one, which saw the instant t at its stamp t + delay.

    usable: which samples of the other one may serve. The mean difference of the rates, its bias, is added.
    """
    at = unit.t[unit.filled] + delay
    inside = (at >= other.t[0]) & (at <= other.t[-1])
    k = np.clip(np.searchsorted(other.t, at), 0, len(other.t) - 1)
    taken = inside & usable[k] & _in_long_gap(unit)
    rows = np.flatnonzero(unit.filled)[taken]
    if not len(rows):
        return unit
    gyro, accel = unit.gyro.copy(), unit.accel.copy()
    bias = _rate_difference(unit, other, turn, delay, usable)
    for target, source, offset in ((gyro, other.gyro, bias), (accel, other.accel, np.zeros(3))):
        target[rows] = _seen_at(source, other.t, at[taken]) @ turn.T + offset
    return matching.Unit(unit.t, gyro, accel, unit.filled)


def _seen_at(values: FloatArray, t: FloatArray, at: FloatArray) -> FloatArray:
    return np.stack([np.interp(at, t, column) for column in values.T], axis=1)


def _rate_difference(
    unit: matching.Unit, other: matching.Unit, turn: FloatArray, delay: float, usable: BoolArray
) -> FloatArray:
    """Mean (3,) of the unit's rate less the other one's, turned, where both measured: how far their biases differ."""
    at = unit.t + delay
    k = np.clip(np.searchsorted(other.t, at), 0, len(other.t) - 1)
    both = ~unit.filled & usable[k] & ~other.filled[k] & (at >= other.t[0]) & (at <= other.t[-1])
    if not both.any():
        return np.zeros(3)
    return np.asarray((unit.gyro[both] - _seen_at(other.gyro, other.t, at[both]) @ turn.T).mean(axis=0))


def mean_rate_difference(paired: Paired, alignment: Alignment) -> FloatArray:
    """(3,) rad/s, s-axes: mean rate of the sub less the main one's, where both measured."""
    main, sub = paired.main, paired.sub
    return _rate_difference(sub, main, alignment.rotation.T, -float(alignment.time_delay.value), ~main.filled)


def _in_long_gap(unit: matching.Unit) -> BoolArray:
    """Of the bridged samples, those of gaps longer than CARRIED_GAP_S."""
    good = np.flatnonzero(~unit.filled)
    bridged = np.flatnonzero(unit.filled)
    after = np.minimum(np.searchsorted(good, bridged), len(good) - 1)
    length = unit.t[good[after]] - unit.t[good[np.maximum(after - 1, 0)]]
    return np.asarray(length > CARRIED_GAP_S)


def _corrected_sub(paired: Paired, at: Linearisation) -> matching.Strapdown:
    """The sub-IMU's path with the known gyro errors taken out."""
    if not at.gyro_bias.any() and not at.scale.any():
        return paired.sub_path
    return paths.integrated(paired.sub, at.gyro_bias, at.scale)


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


def _jumps(t: FloatArray, bad: BoolArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """(N,) s: length of the bridged stretches that end within each step, and the instant at which the last one ends."""
    good = np.flatnonzero(~bad)
    resumed = np.diff(good) > 1
    ends, length = good[1:][resumed], np.diff(t[good])[resumed]
    step = np.searchsorted(index, ends)
    inside = (step > 0) & (step < len(index))
    total, last = np.zeros(len(index)), t[index].copy()
    np.add.at(total, step[inside], length[inside])
    last[step[inside]] = t[ends[inside]]
    return total, last


def observe(paired: Paired, at: Linearisation) -> Observations:
    """Observations about one linearisation."""
    inside, on_sub = _overlap(paired, at)
    t = paired.main.t[inside]
    sub = paths.interpolated(_corrected_sub(paired, at), on_sub, at.R_0)
    main = paths.restarted(
        matching.Strapdown(t, paired.main_path.attitude[inside], paired.main_path.velocity[inside]), np.eye(3)
    )
    bad = paired.main.filled[inside] | _sub_filled(paired.sub, on_sub)
    obs = _per_step(bad, main, sub, paired.main.gyro[inside], at)
    return replace(obs, dulled=_between_samples(paired.sub.t, on_sub) > DULL_SHARE)


def _between_samples(t: FloatArray, at: FloatArray) -> float:
    """Usual distance of instants from the nearest sample, as a share of the interval."""
    k = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    nearest = np.minimum(np.abs(at - t[k]), np.abs(at - t[k - 1]))
    return float(np.median(nearest) / np.median(np.diff(t)))


def _per_step(
    bad: BoolArray, main: matching.Strapdown, sub: matching.Strapdown, gyro_m: FloatArray, at: Linearisation
) -> Observations:
    t = main.t
    index = np.arange(0, len(t), _samples_per_step(t))
    dt = np.diff(t[index], prepend=t[0])
    A_end, A_mid, u = paths.step_means(main, sub, index)
    A_mid -= _end_correction(lambda k: Rotation.from_quat(main.attitude[k]).as_matrix(), t, index)
    u -= _end_correction(lambda k: _relative_velocity(main, sub, k), t, index)
    omega = _mean_rates(gyro_m, t, index)
    u -= np.cross(omega, at.lever_arm)
    u[_with_gaps(bad, index)] = np.nan
    Y = Rotation.from_quat(main.attitude[index]).inv() * Rotation.from_quat(sub.attitude[index])
    z = (Y * Rotation.from_matrix(at.R_ref).inv()).as_rotvec()
    z[bad[index]] = np.nan
    jump_s, gap_end = _jumps(t, bad, index)
    noise = main_noise(t, main.attitude, sub.attitude, ~bad)
    step = float(np.median(dt[1:]))
    rate_m = _rates_at(main, index)
    motion, rate_motion = _motion(omega, rate_m, t, index, noise[0])
    force_i, force_m, bending = np.zeros((3, len(index), 3))
    force_i[1:] = np.diff(sub.velocity[index], axis=0) / dt[1:, None]
    force_m[1:] = np.einsum("kji,kj->ki", A_mid[1:], np.diff(main.velocity[index], axis=0) / dt[1:, None])
    bending[1:] = np.nan_to_num(np.diff(z, axis=0) / dt[1:, None])
    paths.let_go(main)
    paths.let_go(sub)
    for x in (force_i, force_m, bending):
        x[1:] = likely(x[1:], fast_level(x[1:]), step)
    return Observations(
        t=t, good=~bad, main=main, sub=sub, index=index, dt=dt, jump_s=jump_s, gap_end=gap_end, z=z, u=u,
        A_start=np.concatenate([A_end[:1], A_end[:-1]]), A_end=A_end, A_mid=A_mid, omega=omega, motion=motion,
        A_motion=_behind(motion, omega, A_mid, dt) @ A_end, bending=bending, rate_m=rate_m,
        rate_motion=rate_motion, force_i=force_i, force_m=force_m, centred=t[index] - 0.5 * (t[0] + t[-1]),
        main_noise=noise,
    )  # fmt: skip


def _samples_per_step(t: FloatArray) -> int:
    step = STEP_S if t[-1] - t[0] <= LONG_RECORD_S else 2 * STEP_S
    return max(1, round(step / float(np.median(np.diff(t)))))


def _relative_velocity(main: matching.Strapdown, sub: matching.Strapdown, k: IntArray) -> FloatArray:
    return np.asarray(Rotation.from_quat(main.attitude[k]).inv().apply(sub.velocity[k] - main.velocity[k]))


def _mean_rates(gyro: FloatArray, t: FloatArray, index: IntArray) -> FloatArray:
    """Mean body rate over the steps: a rotation vector holds the coning within its sample, a mean rate does not."""
    omega = np.zeros((len(index), 3))
    for part, rows, ends in paths.steps(index):
        if len(ends) > 1:
            first = max(rows.start - 1, 0)
            turned = gyro[first + 1 : rows.stop] * np.diff(t[first : rows.stop])[:, None]
            angle = turned - np.cross(np.concatenate([turned[:1], turned[:-1]]), turned) / 12.0
            angle = angle[rows.start - first :]
            omega[max(part.start, 1) : part.stop] = np.add.reduceat(angle, ends[:-1]) / np.diff(t[rows][ends])[:, None]
        scratch.release(gyro)
    return omega


def _motion(
    omega: FloatArray, rate: FloatArray, t: FloatArray, index: IntArray, noise: float
) -> tuple[FloatArray, FloatArray]:
    """What is likely behind mean rates over the steps (the first has none) and rates at their ends, (N, 3) each."""
    step, T = (float(np.median(np.diff(x))) for x in (t[index], t))
    motion = np.concatenate([omega[:1], likely(omega[1:], noise / step, step)])
    return motion, likely(rate, noise / (2.0 * T), step)


def _behind(motion: FloatArray, omega: FloatArray, A_mid: FloatArray, dt: FloatArray) -> FloatArray:
    """(N, 3, 3), i-axes: takes out of the attitudes what their rates hold beyond the likely motion."""
    beyond = np.einsum("kij,kj->ki", A_mid, omega - motion) * dt[:, None]
    return np.asarray(Rotation.from_rotvec(-np.cumsum(beyond, axis=0)).as_matrix())


def _rates_at(path: matching.Strapdown, index: IntArray) -> FloatArray:
    """(N, 3) rad/s, body rate at samples ``index``, from their neighbours."""
    after, before = np.minimum(index + 1, len(path.t) - 1), np.maximum(index - 1, 0)
    turned = Rotation.from_quat(path.attitude[before]).inv() * Rotation.from_quat(path.attitude[after])
    return np.asarray(turned.as_rotvec() / (path.t[after] - path.t[before])[:, None])


def _with_gaps(bad: BoolArray, index: IntArray) -> BoolArray:
    """(N,) steps that hold a bridged sample."""
    within = np.add.reduceat(bad[: index[-1]].astype(int), index[:-1]) > 0
    return np.asarray(np.concatenate([[True], within]) | bad[index])


def _end_correction(at: Callable[[IntArray], FloatArray], t: FloatArray, index: IntArray) -> FloatArray:
    """Excess of trapezoid means of ``at`` (samples), by Euler and Maclaurin: h^2/12 (x'(end) - x'(start))/dt."""
    after, before = np.minimum(index + 1, len(t) - 1), np.maximum(index - 1, 0)
    high, low = at(after), at(before)
    column = (-1, *[1] * (high.ndim - 1))
    slope = (high - low) / (t[after] - t[before]).reshape(column)
    h = (t[-1] - t[0]) / (len(t) - 1)
    out = np.zeros_like(slope)
    out[1:] = h * h / 12.0 * np.diff(slope, axis=0) / np.diff(t[index]).reshape(column)
    return out
