"""The twin driven by a log: the main IMU as it was measured, all else simulated anew on the log's own stamps.

The ship moves as the main IMU's samples tell (:mod:`twin.recorded`), so that what is left between the replay and the
log is what the twin does not know of flexure and sensors. The main IMU's noise stays in its samples and is no motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physics import quaternions
from schemas.errors import DataError
from schemas.trial import ImuSeries, IntArray, Trial, Truth
from twin import sampling
from twin.bending import margin
from twin.config import Twin
from twin.effects import Effect
from twin.recorded import RecordedMotion, Remembered, recorded_scene
from twin.simulation import Simulation
from twin.world import (
    LEAD,
    NODES,
    STREAMS,
    Carried,
    Streams,
    World,
    attitude,
    built,
    draw,
    imu,
    in_slabs,
    phins,
    phins_clock,
    reach,
    samples,
    sub_clock,
)

FloatArray = NDArray[np.float64]

GAP = 1.5  # usual intervals between stamps that make a gap
FEWEST = 20  # samples of the main IMU without which there is no motion to speak of


@dataclass(frozen=True)
class Timeline:
    """When a unit measured: stamp (n,) ns and t (n,) s; edge (m,) s, ends of intervals without a break; kept (n,), the
    interval (counted from 1) that ends at each stamp. What lies in a gap is an interval that is not kept."""

    stamp: IntArray
    t: FloatArray
    edge: FloatArray
    kept: IntArray

    @classmethod
    def of(cls, stamp: IntArray, epoch: int) -> Timeline:
        """Intervals end at the stamps and begin at the stamp before, or a usual interval before after a gap."""
        t = np.asarray((stamp - epoch) * 1e-9, dtype=np.float64)
        step = np.diff(t)
        usual = float(np.median(step))
        after = np.flatnonzero(step > GAP * usual) + 1
        edge = np.insert(t, [0, *after], [t[0] - usual, *(t[after] - usual)])
        return cls(stamp, t, edge, np.searchsorted(edge, t))

    @property
    def rate(self) -> float:
        """Usual rate, Hz."""
        return 1e9 / float(np.median(np.diff(self.stamp)))

    def nodes(self, first: int, last: int, per_sample: int) -> FloatArray:
        """Quadrature nodes (s) of the intervals from edge first to edge last, ((last - first) per_sample + 1,)."""
        edge = self.edge[first : last + 1]
        share = np.arange(per_sample) / per_sample
        inner = edge[:-1, None] + np.diff(edge)[:, None] * share
        return np.concatenate([inner.ravel(), edge[-1:]])

    def every(self, per_sample: int) -> FloatArray:
        """All nodes."""
        return self.nodes(0, len(self.edge) - 1, per_sample)


def replay(
    twin: Twin,
    trial: Trial,
    rng: np.random.Generator,
    duration: float | None = None,
    ship: Remembered | None = None,
) -> Simulation:
    """The twin on the motion of a log, with a truth of its own.

    duration: s from the epoch to the end of the whole record, for a trial that is a piece of one. ship: what
    :func:`remembered` made of the log, which halves the time of every replay but the first.

    The main IMU, GNSS, thermometers, sled and rig are those of the log; the sub-IMU and each PHINS that the log has are
    drawn anew, on its stamps, gaps kept. Raises DataError for a log whose units hardly measured.
    """
    if min(len(trial.main), len(trial.sub)) < FEWEST:
        raise DataError(f"fewer than {FEWEST} samples: there is nothing to replay", channel="main or sub")
    streams = dict(zip(STREAMS, rng.spawn(len(STREAMS))))
    made, changed = built(twin)
    lines = _lines(trial)
    per_sample = sampling.substeps(lines["sub"].rate, changed.mount.lever_bandwidth)
    instants = _instants(lines, trial, changed, made, per_sample)
    scene = recorded_scene(trial, changed, reach(instants, changed.mount.lever_bandwidth), duration, ship)
    world = draw(scene, made, instants, per_sample, streams, trial.epoch)
    return Simulation(_trial(trial, world, lines, streams), _truth(trial, world), twin)


def remembered(twin: Twin, trial: Trial) -> Remembered:
    """The motion of a log for many replays, by twins that believe the same of the main IMU and of PHINS."""
    units = (trial.main, trial.sub, trial.phins_main, trial.phins_sub)
    stamps = [unit.stamp for unit in units if unit is not None and len(unit)]
    before = 2.0 * LEAD + margin(twin.mount.lever_bandwidth)
    first, last = (float(end - trial.epoch) * 1e-9 for end in (min(s[0] for s in stamps), max(s[-1] for s in stamps)))
    return Remembered(RecordedMotion(trial, twin, (first - before, last + before)))


def _lines(trial: Trial) -> dict[str, Timeline]:
    """Timelines of what is drawn anew; units with the same stamps share one."""
    lines: dict[str, Timeline] = {}
    for unit in ("sub", "phins_main", "phins_sub"):
        series: ImuSeries | None = getattr(trial, unit)
        if series is None or (unit != "sub" and (series.attitude is None or len(series) < FEWEST)):
            continue
        same = [line for line in lines.values() if np.array_equal(line.stamp, series.stamp)]
        lines[unit] = same[0] if same else Timeline.of(series.stamp, trial.epoch)
    return lines


def _instants(
    lines: Mapping[str, Timeline], trial: Trial, twin: Twin, made: Sequence[Effect], per_sample: int
) -> list[FloatArray]:
    """All times (s) at which the flexure is asked for."""
    stamped = lines["sub"].every(per_sample)
    found = [sub_clock(stamped, twin, made), trial.seconds(trial.main.stamp)]
    for unit in ("phins_main", "phins_sub"):
        if unit in lines:
            found += [phins_clock(unit, lines[unit].t, made), lines[unit].every(per_sample)]
    return found


def _trial(trial: Trial, world: World, lines: Mapping[str, Timeline], streams: Streams) -> Trial:
    beside_it = {id(line): line for unit, line in lines.items() if unit != "sub"}
    on_time = {key: _ideal(world, line) for key, line in beside_it.items()}
    gyro, accel = _sub(world, lines["sub"], on_time.get(id(lines["sub"])))
    sub = imu(world, "sub", trial.sub.stamp, gyro, accel, streams)
    beside: dict[str, ImuSeries | None] = {"phins_main": None, "phins_sub": None}
    for unit in beside:
        if unit in lines:
            under = on_time[id(lines[unit])].under(unit, lines[unit])
            beside[unit] = phins(world, unit, under, streams[unit])
    return replace(trial, sub=sub, phins_main=beside["phins_main"], phins_sub=beside["phins_sub"], notes=())


@dataclass(frozen=True)
class _Ideal:
    """Error-free samples (n, ...) of main IMU and deck at the stamps of a timeline; q_n: body to ENU."""

    main_gyro: FloatArray
    main_accel: FloatArray
    deck_gyro: FloatArray
    deck_accel: FloatArray
    q_n_m: FloatArray
    q_n_s: FloatArray

    def under(self, unit: str, line: Timeline) -> Carried:
        """What stands under a PHINS."""
        if unit == "phins_main":
            return Carried(line.stamp, line.t, line.rate, self.main_gyro, self.main_accel, self.q_n_m)
        return Carried(line.stamp, line.t, line.rate, self.deck_gyro, self.deck_accel, self.q_n_s)


def _ideal(world: World, line: Timeline) -> _Ideal:
    every = world.per_sample

    def at(t: FloatArray) -> tuple[FloatArray, ...]:
        motion = world.scene.motion(t)
        main, deck = sampling.main_body(motion), world.sub(motion)
        q_m_s = quaternions.multiply(quaternions.conjugate(main.q_i_b[every::every]), deck.q_i_b[every::every])
        q_n_m = motion.q_n_m[every::every]
        return (*samples(main, t, every), *samples(deck, t, every), q_n_m, quaternions.multiply(q_n_m, q_m_s))

    return _Ideal(*_sampled(at, line, every))


def _sub(world: World, line: Timeline, on_time: _Ideal | None) -> Sequence[FloatArray]:
    """Ideal rates and forces of the sub-IMU at the times its clock makes of its stamps."""
    if on_time is not None and np.array_equal(world.sub_clock(line.edge), line.edge):
        return on_time.deck_gyro, on_time.deck_accel

    def at(t: FloatArray) -> tuple[FloatArray, ...]:
        measured = world.sub_clock(t)
        return samples(world.sub(world.scene.motion(measured)), measured, world.per_sample)

    return _sampled(at, line, world.per_sample)


def _sampled(
    at: Callable[[FloatArray], tuple[FloatArray, ...]], line: Timeline, per_sample: int
) -> Sequence[FloatArray]:
    """Samples of a function of nodes, slab by slab, those of gaps left out."""
    last, size = len(line.edge) - 1, max(1, NODES // per_sample)
    parts = [at(line.nodes(k, min(k + size, last), per_sample)) for k in range(0, last, size)]
    return [np.concatenate(column)[line.kept - 1] for column in zip(*parts)]


def _truth(trial: Trial, world: World) -> Truth:
    """Deformation at every stamp of the main IMU."""
    stamp = trial.main.stamp
    t = trial.seconds(stamp)
    q_n_s = in_slabs(lambda part: attitude(world, "phins_sub", part), t)
    return Truth(stamp, quaternions.log(world.q_m_s(t)), np.array(world.phi(t)), world.flexure.at(t), stamp, q_n_s)
