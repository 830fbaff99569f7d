"""Taking effects out of a log: what is known of them is undone, exactly or to first order.

In the opposite order of how they came in: what acts on finished series (outliers, clipping, jitter), errors that the
twin can state (bias, scale, skew), errors of the sensors' own hooks, clocks, and at last bending that the motion
foretells. Bending is real: it is told to the estimator by taking it out, and put back into the answer
(:meth:`Compensated.restore`). An effect without an inverse is left in, and said so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG_PER_HOUR, MICRO_G
from schemas.products import Deformation
from schemas.trial import ImuSeries, IntArray, Trial
from twin import bent
from twin.config import Imu, Twin
from twin.effects import Effect
from twin.effects._repair import Repair
from twin.recorded import recorded_scene
from twin.sensors import gyro_matrix
from twin.world import built

FloatArray = NDArray[np.float64]

STATED = ("gyro_bias_dph", "gyro_scale_ppm", "gyro_nonorthogonality_arcsec", "accel_bias_ug")
SPARE_S = 5.0  # s of motion beyond the record that clocks may ask for


@dataclass(frozen=True)
class Compensated:
    """A log without the effects.

    trial: for the estimator. reference: the same with the deck's real bending left in, to score against. notes: what
    was done for each effect, a sentence each. bending: what :meth:`restore` puts back, None for nothing.
    """

    trial: Trial
    reference: Trial
    notes: tuple[str, ...]
    bending: bent.Bending | None = None

    def restore(self, deformation: Deformation) -> Deformation:
        """The deformation of the deck, bending that was taken out before put back in."""
        return deformation if self.bending is None else self.bending.restored(deformation)


def compensate(trial: Trial, effects: Sequence[Effect], twin: Twin) -> Compensated:
    """Take effects out of a log; twin: the one without them, that they are measured against.

    The twin's own effects are believed in and stay. Nothing is drawn and nothing invented: samples are changed, masked
    or moved in time.
    """
    twin = built(twin)[1]
    changed = reduce(lambda so_far, effect: effect.twin(so_far), effects, twin)
    first, last = _span(trial, (trial.main, trial.sub, trial.phins_main, trial.phins_sub))
    repair = Repair(trial, recorded_scene(trial, twin, (first - SPARE_S, last + SPARE_S)))
    late = [effect for effect in effects if _acts_late(effect)]
    repair = _each(repair, reversed(late))
    repair = replace(repair, trial=_restated(repair.trial, changed, twin))
    repair = _each(repair, reversed([effect for effect in effects if not _acts_late(effect)]))
    clean = _on_time(repair.trial, effects, changed.mount.time_delay - twin.mount.time_delay)
    clean = _with_lever(clean, changed, twin)
    known = _span(trial, (trial.main,))  # what the ship did before and after is nothing but guessed
    bending = bent.foretold(trial.epoch, known, repair.scene, effects, twin, changed)
    told = {note.split(":")[0] for note in repair.notes}
    others = [effect for effect in effects if effect.name not in told]
    notes = (*repair.notes, *(_told(effect, trial, twin) for effect in others))
    if bending is None:
        return Compensated(clean, clean, notes)
    straight = bent.without(clean, bending, changed, twin.mount.time_delay)
    return Compensated(straight, clean, notes, bending)


def _span(trial: Trial, units: Sequence[ImuSeries | None]) -> tuple[float, float]:
    """First and last instant (s) that any of some units speaks of."""
    stamps = [unit.stamp for unit in units if unit is not None and len(unit)]
    first, last = min(stamp[0] for stamp in stamps), max(stamp[-1] for stamp in stamps)
    return (float(first - trial.epoch) * 1e-9, float(last - trial.epoch) * 1e-9)


def _acts_late(effect: Effect) -> bool:
    return type(effect).imu is not Effect.imu


def _each(repair: Repair, effects: Iterable[Effect]) -> Repair:
    for effect in effects:
        repair = effect.compensate(repair)
    return repair


def _restated(trial: Trial, wrong: Twin, right: Twin) -> Trial:
    """Rates and forces of both units as they were if the errors were those of ``right``."""
    main = restated(trial.main, wrong.imu.main, right.imu.main)
    return replace(trial, main=main, sub=restated(trial.sub, wrong.imu.sub, right.imu.sub))


def restated(series: ImuSeries, wrong: Imu, right: Imu) -> ImuSeries:
    """omega = M_r M_w^-1 (omega_w - b_w) + b_r and f = f_w - b_w + b_r."""
    if all(getattr(wrong, name) == getattr(right, name) for name in STATED):
        return series
    matrices = [gyro_matrix(imu.gyro_scale_ppm, imu.gyro_nonorthogonality_arcsec) for imu in (wrong, right)]
    turn = matrices[1] @ np.linalg.inv(matrices[0])
    gyro_bias = [np.array(imu.gyro_bias_dph) * DEG_PER_HOUR for imu in (wrong, right)]
    accel_bias = (np.array(right.accel_bias_ug) - np.array(wrong.accel_bias_ug)) * MICRO_G
    return replace(series, gyro=(series.gyro - gyro_bias[0]) @ turn.T + gyro_bias[1], accel=series.accel + accel_bias)


def _on_time(trial: Trial, effects: Sequence[Effect], delay: float) -> Trial:
    """Stamps of the sub-IMU and of both PHINS moved to when they say they were measured."""
    sub = trial.seconds(trial.sub.stamp)
    true = reduce(lambda t, effect: effect.sub_clock(t), effects, sub) - delay
    main, beside = (_phins_on_time(trial, unit, effects) for unit in ("phins_main", "phins_sub"))
    return replace(trial, sub=_moved(trial.sub, true - sub), phins_main=main, phins_sub=beside)


def _phins_on_time(trial: Trial, unit: str, effects: Sequence[Effect]) -> ImuSeries | None:
    series: ImuSeries | None = getattr(trial, unit)
    if series is None:
        return None
    t = trial.seconds(series.stamp)
    return _moved(series, reduce(lambda at, effect: effect.phins_clock(unit, at), effects, t) - t)


def _moved(series: ImuSeries, by: FloatArray) -> ImuSeries:
    """The series with its stamps moved by (n,) s, in whole ns."""
    shift: IntArray = np.rint(by * 1e9).astype(np.int64)
    return replace(series, stamp=series.stamp + shift) if shift.any() else series


def _with_lever(trial: Trial, wrong: Twin, right: Twin) -> Trial:
    """The rig's lever arm, where it states one, put right: the effects measure it against the twin's."""
    change = np.array(wrong.mount.lever_arm) - np.array(right.mount.lever_arm)
    if trial.rig.lever_arm is None or not change.any():
        return trial
    return replace(trial, rig=replace(trial.rig, lever_arm=trial.rig.lever_arm + change))


def _told(effect: Effect, trial: Trial, twin: Twin) -> str:
    """What became of an effect that did not say so itself."""
    if effect.stays:
        return f"{effect.name}: left in; {effect.stays}"
    if effect.twin(twin).mount.lever_arm != twin.mount.lever_arm and trial.rig.lever_arm is None:
        return f"{effect.name}: left in; the rig states no lever arm, and the estimator finds it in the log"
    if effect.foretold or effect.bends:
        return f"{effect.name}: the bending it foretells is taken out before the estimate and put back afterwards"
    return f"{effect.name}: taken out of the log"
