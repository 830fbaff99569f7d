"""Align: the constant part of the problem, before any filter runs.

    w_m(t) = R_m_s w_s(t + delay) + flexure rate + noise

A sub sample stamped t was measured at t - delay, so the sub-IMU's record is read ``delay`` later. Coarse over lags by
Wahba on rates (any angle, +-1.2 s), then maximum likelihood (:mod:`stages.align.likelihood`), with gravity as a
second vector. What the motion does not show is said to be not observable and keeps a stated fallback: no rotation
about the unobservable axis, no delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from physics import rotations
from physics.units import ARCMIN, DEG
from schemas.errors import DataError
from schemas.products import Alignment, Estimate, Status
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, Trial
from stages.align.gravity import Gravity, gravity
from stages.align.installation import installation
from stages.align.likelihood import PRIOR_ANGLE, PRIOR_DELAY, Fit, fit
from stages.align.phases import static_phases
from stages.align.tracks import SEGMENT_SHORTEST, Span, Track, cell_length, finite_rows, shared_spans, tracks
from stages.align.wahba import SEARCH_REACH, Coarse, rotation_between, search
from stages.slabs import beside, rows

CORRELATION_LEAST = 0.3  # share of common motion below which nothing is aligned
RATE_MOVING = 0.1 * DEG  # rad/s rms; a unit that shows more is moving and not merely noisy
ANGLE_ESTIMATED = 10.0 * ARCMIN  # rad, largest standard deviation (principal axis) of a plain estimate
ANGLE_WEAK = 2.0 * DEG  # rad, and of a weak one
DELAY_ESTIMATED = 2e-3  # s, largest standard deviation of a plain estimate
DELAY_WEAK = 0.1  # s, and of a weak one
GRAVITY_GATE = 4.0  # sigma by which gravity may contradict well-determined rates and still be used


@dataclass(frozen=True)
class _Found:
    """Fit, with what decides on status: reasons are empty where there is nothing to say."""

    fit: Fit
    at_edge: bool
    delay_known: bool
    notes: tuple[str, ...]


def align(trial: Trial) -> Alignment:
    """Static misalignment, time delay, installation deviations and static phases of a trial.

    Raises DataError where nothing at all can be said: a unit that is frozen or rigidly still while the other moves,
    units that do not move together, no common stretch of SEGMENT_SHORTEST.
    """
    with ThreadPoolExecutor(beside(len(trial.main))) as pool:  # one unit beside the other, here and below
        names = ("main IMU", "sub-IMU")
        main, sub = pool.map(lambda one, name: tracks(one, trial.epoch, name), (trial.main, trial.sub), names)
    for series, channel in ((trial.main, "main IMU"), (trial.sub, "sub-IMU")):
        _refuse_frozen(series, channel)
    step = cell_length(trial.main, trial.sub)
    spans = shared_spans(main, sub, SEGMENT_SHORTEST, (-SEARCH_REACH, SEARCH_REACH))
    if not spans:
        raise DataError(f"the main and sub-IMU share no uninterrupted stretch of {SEGMENT_SHORTEST:.0f} s to align on")
    down = gravity(spans, 0.0, trial.rig)
    coarse = search(main, sub, SEGMENT_SHORTEST, step, None if down is None else down.profile)
    assert coarse is not None
    found = _calm(coarse, down) if _is_calm(coarse) else _fine(main, sub, step, coarse, spans, trial)
    return _alignment(found, trial, main, sub)


def _refuse_frozen(series: ImuSeries, channel: str) -> None:
    gyro = rows(series.gyro, finite_rows(series.gyro))
    if np.all(gyro == gyro[0]):
        raise DataError("the gyros are frozen: every sample is the same", channel=channel)


def _is_calm(coarse: Coarse) -> bool:
    """True when neither unit moves; DataError when one does and the other does not follow."""
    if coarse.correlation >= CORRELATION_LEAST:
        return False
    moving = [rms > RATE_MOVING for rms in coarse.rms]
    if any(moving):
        share = f"{100.0 * coarse.correlation:.0f} % of their motion is common"
        raise DataError(f"the main and sub-IMU do not move together ({share}): not on one ship, or one is dead")
    return True


def _calm(coarse: Coarse, down: Gravity | None) -> _Found:
    profile = 1e-9 * np.eye(3) + (0.0 if down is None else down.profile)
    rotation, _ = rotation_between(profile)
    information = np.eye(3) / PRIOR_ANGLE**2 + (0.0 if down is None else down.aid(rotation)[0])
    covariance = np.zeros((4, 4))
    covariance[:3, :3], covariance[3, 3] = np.linalg.inv(information), PRIOR_DELAY**2
    note = f"calm sea: only {100.0 * coarse.correlation:.0f} % of the rates are common motion"
    return _Found(Fit(rotation, 0.0, covariance, np.full(3, PRIOR_ANGLE)), False, False, (note,))


def _fine(
    main: Sequence[Track], sub: Sequence[Track], step: float, coarse: Coarse, spans: Sequence[Span], trial: Trial
) -> _Found:
    down = gravity(spans, coarse.delay, trial.rig, coarse.rotation)
    start, notes = (coarse.rotation, coarse.delay), []
    alone = fit(main, sub, step, start, SEGMENT_SHORTEST)
    if down is not None and down.disagreement(alone.rotation, alone.covariance[:3, :3]) > GRAVITY_GATE:
        notes.append("specific force contradicts the rates and was not used for the misalignment")
        down = None
    found = alone
    if down is not None:
        found = fit(main, sub, step, (alone.rotation, alone.delay), SEGMENT_SHORTEST, aid=down.aid, flat=0)
    known = bool(np.sqrt(found.covariance[3, 3]) <= DELAY_WEAK)
    if not known:  # the covariance stays the joint one: the rotation is as uncertain as the delay makes it
        aid = None if down is None else down.aid
        held = fit(main, sub, step, (coarse.rotation, 0.0), SEGMENT_SHORTEST, aid=aid, hold_delay=True)
        found = Fit(held.rotation, 0.0, found.covariance, found.rates_alone)
    if coarse.at_edge:
        notes.append(f"the delay lies at the edge of the search, {coarse.delay:+.1f} s: it may be larger")
    return _Found(found, coarse.at_edge, known, tuple(notes))


def _alignment(found: _Found, trial: Trial, main: Sequence[Track], sub: Sequence[Track]) -> Alignment:
    covariance = found.fit.covariance[:3, :3]
    rig = trial.rig
    asked = (
        (main, trial.phins_main, rig.installation_main, trial, "PHINS at the main IMU"),
        (sub, trial.phins_sub, rig.installation_sub, trial, "PHINS at the sub-IMU"),
    )
    with ThreadPoolExecutor(beside(len(trial.main))) as pool:
        installation_main, installation_sub = pool.map(lambda one: _installed(*one), asked)
    return Alignment(
        rotation=found.fit.rotation,
        static=_static(found),
        covariance=covariance,
        time_delay=_delay(found),
        installation_main=installation_main,
        installation_sub=installation_sub,
        static_phases=static_phases(main),
        notes=found.notes,
    )


def _installed(
    unit: Sequence[Track], phins: ImuSeries | None, stated: FloatArray | None, trial: Trial, channel: str
) -> Estimate | None:
    if phins is None:
        return None
    if stated is not None:
        return Estimate(rotations.log(stated), np.zeros(3), reason="from the rig profile, taken as exact")
    return installation(unit, phins, trial.epoch, cell_length(trial.main, trial.sub), channel)


def _static(found: _Found) -> Estimate:
    value, covariance = rotations.log(found.fit.rotation), found.fit.covariance[:3, :3]
    spread, axes = np.linalg.eigh(covariance)
    worst, axis = float(np.sqrt(spread[-1])), _named(axes[:, -1])
    std = np.sqrt(np.diag(covariance))
    lost = found.fit.rates_alone > ANGLE_WEAK
    if worst > ANGLE_WEAK:
        return Estimate(value, std, Status.NOT_OBSERVABLE, _why_lost(found, axis))
    if lost.any():
        reason = f"the rates do not show the angle about {axis}; it rests on gravity and the accelerometer biases"
        return Estimate(value, std, Status.WEAK, reason)
    if worst > ANGLE_ESTIMATED:
        reason = f"too little motion: {worst / ARCMIN:.0f} arcmin are left open about {axis}"
        return Estimate(value, std, Status.WEAK, reason)
    return Estimate(value, std)


def _why_lost(found: _Found, axis: str) -> str:
    lost = int(np.count_nonzero(found.fit.rates_alone > ANGLE_WEAK))
    if lost == 1:
        return f"the ship turned about one axis only ({axis}): the angle about it is not observable from rates"
    return f"the ship hardly turned: the angle about {axis} is not observable from rates"


def _named(direction: FloatArray) -> str:
    """The body axis nearest to a direction, or its components."""
    nearest = int(np.argmax(np.abs(direction)))
    if abs(direction[nearest]) > 0.95:
        return "xyz"[nearest]
    return "the axis ({:.2f}, {:.2f}, {:.2f})".format(*direction * np.sign(direction[nearest]))


def _delay(found: _Found) -> Estimate:
    value = np.asarray(found.fit.delay)
    std = np.asarray(np.sqrt(found.fit.covariance[3, 3]))
    if not found.delay_known:
        reason = "the motion does not show the delay: too little of it, or a rotation looks the same"
        return Estimate(np.asarray(0.0), std, Status.NOT_OBSERVABLE, reason)
    if found.at_edge:
        return Estimate(value, std, Status.WEAK, found.notes[-1])
    if std > DELAY_ESTIMATED:
        return Estimate(value, std, Status.WEAK, f"too little motion: {1e3 * float(std):.1f} ms are left open")
    return Estimate(value, std)
