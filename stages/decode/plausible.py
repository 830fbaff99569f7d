"""Do the values contradict the declared units, signs and axes? Each check returns a sentence, or None.

Every sentence names the rig key that would mend it. Nothing is converted on suspicion. The checks abstain where the
motion is too small to tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics import quaternions
from physics.units import STANDARD_GRAVITY
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray
from stages.decode.windows import regular, window_size, windows

ACCEL_PLAUSIBLE = (5.0, 30.0)
"""m/s^2, median norm of specific force of anything that sails, drives or flies for minutes."""
UNIT_FACTOR = 15.0
"""Rates too large by more than this: deg/s taken as rad/s is 57.3."""
MIN_WINDOWS = 20
TURNING_RATE = 0.01
"""rad/s RMS of pitch and roll rates below which they are too small to be deg/s of a moving ship."""
MIN_RATE = 2e-4
"""rad/s RMS of the attitude's rate below which it cannot judge a gyro."""
SHARED = (0.9, 0.8)
"""Least canonical correlation of two units' rates: of the best direction, and of all three, to compare them."""
MAX_ANGLE = np.deg2rad(20.0)
FEW_SECONDS = 12
"""Fewer seconds together than this do not tell whether two units follow each other."""
MAX_LAG_S = 30
"""Clocks are looked for that differ by up to so much."""
FOLLOWS = 0.95
"""Least canonical correlation of the rates of two units that move strongly on one ship; it is 0.98 or more."""
STRONG_RATE = 5e-3
"""rad/s RMS of both units' rates that neither flexure nor noise makes."""


def specific_force(accel: FloatArray, role: str) -> str | None:
    """Unit and gravity from the median norm: g makes 1, mg 1000, gravity removed less than either."""
    norm = float(np.median(np.linalg.norm(accel[:: max(len(accel) // 20_000, 1)], axis=1)))
    steady = float(np.linalg.norm(np.mean(accel, axis=0))) / max(norm, 1e-12)
    if ACCEL_PLAUSIBLE[0] <= norm <= ACCEL_PLAUSIBLE[1]:
        return None
    if 0.5 < norm < 2.0 and steady > 0.7:
        return f'the specific force has a median norm of {norm:.3g}: it looks like g; rig key {role}.accel_unit = "g"'
    if 500.0 < norm < 2000.0:
        return f'the specific force has a median norm of {norm:.4g}: it looks like mg; rig key {role}.accel_unit = "mg"'
    if norm < ACCEL_PLAUSIBLE[0]:
        return (
            f"the specific force has a median norm of {norm:.3g} m/s^2: gravity looks removed; "
            f"rig key {role}.gravity_removed = true"
        )
    return f"the specific force has a median norm of {norm:.4g} m/s^2: check rig key {role}.accel_unit"


def upright(accel: FloatArray, role: str) -> str | None:
    """A remark on a unit that does not stand upright in hull axes (+g on z at rest)."""
    mean = np.mean(accel, axis=0)
    tilt = float(np.arccos(np.clip(mean[2] / max(float(np.linalg.norm(mean)), 1e-12), -1.0, 1.0)))
    if tilt < np.deg2rad(45.0):
        return None
    return (
        f"the unit is tilted by {np.rad2deg(tilt):.0f} degrees against the hull's vertical; check rig key {role}.axes"
    )


def gyro_against_gravity(unit: ImuSeries, role: str) -> str | None:
    """df/dt = -omega x f + ...: rates in a too large unit would turn gravity far more than it turns.

    Only the pitch and roll rates count; a real unit gives a ratio of at most a few.
    """
    stamp, gyro = windows(unit.stamp, unit.gyro)
    _, force = windows(unit.stamp, unit.accel)
    if len(gyro) < MIN_WINDOWS:
        return None
    step = np.diff(stamp) * 1e-9
    near = step < 1.5 * np.median(step)
    middle = 0.5 * (force[1:] + force[:-1])
    expected = -np.cross(0.5 * (gyro[1:] + gyro[:-1]), middle)[near]
    found = (np.diff(force, axis=0) / step[:, None])[near]
    turning = _rms(expected - expected.mean(axis=0))
    ratio = turning / max(_rms(found), 1e-12)
    if ratio < UNIT_FACTOR or turning < TURNING_RATE * STANDARD_GRAVITY:
        return None
    return (
        f"the rates would turn gravity {ratio:.0f} times as much as the accelerometers see: they look like deg/s; "
        f'rig key {role}.gyro_unit = "deg/s"'
    )


def attitude_against_gravity(unit: ImuSeries, role: str) -> str | None:
    """R_n_b f_b must point up on average, whatever the navigation frame's horizontal axes."""
    if unit.attitude is None or not np.isfinite(unit.accel).any():
        return None
    stride = max(len(unit) // 20_000, 1)
    force = quaternions.rotate(unit.attitude[::stride], unit.accel[::stride])
    mean = np.nanmean(force, axis=0)
    norm = float(np.linalg.norm(mean))
    if not ACCEL_PLAUSIBLE[0] < norm < ACCEL_PLAUSIBLE[1] or mean[2] > norm * np.cos(MAX_ANGLE):
        return None
    tilt = np.rad2deg(np.arccos(np.clip(mean[2] / norm, -1.0, 1.0)))
    return (
        f"its attitude puts the vertical {tilt:.0f} degrees off gravity; "
        f"check rig keys {role}.axes, {role}.attitude (frame, inverse)"
    )


def gyro_against_attitude(unit: ImuSeries, role: str) -> str | None:
    """Rates of the gyro against those of the unit's own attitude: unit, sign and axes."""
    if unit.attitude is None:
        return None
    size = window_size(unit.stamp)
    usable, (stamp, gyro) = regular(unit.stamp, size), windows(unit.stamp, unit.gyro)
    first = np.arange(len(usable))[usable] * size
    if len(stamp) < MIN_WINDOWS:
        return None
    # a window's mean rate is that from the sample before it to its last one
    first, gyro = first[first > 0], gyro[first > 0]
    before, after = unit.attitude[first - 1], unit.attitude[first + size - 1]
    turn = quaternions.log(quaternions.multiply(quaternions.conjugate(before), after))
    rate = turn / ((unit.stamp[first + size - 1] - unit.stamp[first - 1])[:, None] * 1e-9)
    if _rms(rate - rate.mean(axis=0)) < MIN_RATE:
        return None
    return _compared(rate, gyro, role)


def pair(main: ImuSeries, sub: ImuSeries) -> str | None:
    """Rates of the two units against each other: the same clock, the same unit, not mirror images, and gravity turned
    as they are.
    """
    begin, end = max(main.stamp[0], sub.stamp[0]), min(main.stamp[-1], sub.stamp[-1])
    grid = np.arange(begin, end, int(1e9), dtype=np.int64)
    if len(grid) < FEW_SECONDS:
        return None
    rate_m, rate_s = _both(_averaged(main, grid), _averaged(sub, grid))
    strange = _strangers(main, sub, grid) if len(rate_m) >= FEW_SECONDS else None
    if strange or len(rate_m) < MIN_WINDOWS or min(_rms(rate_m), _rms(rate_s)) < MIN_RATE:
        return strange
    found = _relation(rate_m, rate_s)
    if found.gain > UNIT_FACTOR or 0.0 < found.gain < 1.0 / UNIT_FACTOR:
        large, factor = ("sub", found.gain) if found.gain > 1.0 else ("main", 1.0 / found.gain)
        return f'the rates of {large} are {factor:.0f} times the other unit\'s; rig key {large}.gyro_unit = "deg/s"'
    if found.mirrored:
        return (
            "the rates of the two units are mirror images: an axis of one has the wrong sign; "
            "rig keys main.gyro_signs, sub.gyro_signs"
        )
    return None if found.rotation is None else _gravity_of_both(main, sub, found.rotation)


def _strangers(main: ImuSeries, sub: ImuSeries, grid: IntArray) -> str | None:
    """Two units that move strongly, but whose rates agree only when one is shifted by seconds, or not at all."""
    rate_m, rate_s = _averaged(main, grid), _averaged(sub, grid)
    strength = min(_rms(rates - rates.mean(axis=0)) for rates in _both(rate_m, rate_s))
    if strength < STRONG_RATE or _shared(rate_m, rate_s) >= FOLLOWS:
        return None
    delays = (_averaged(sub, grid + round(shift * 1e9)) for shift in np.arange(-1.0, 1.1, 0.25))
    if any(_shared(rate_m, delayed) >= FOLLOWS for delayed in delays):
        return None
    lags = range(-MAX_LAG_S, MAX_LAG_S + 1)
    shared = [_shared(rate_m[max(-lag, 0) :], rate_s[max(lag, 0) :]) for lag in lags]
    if max(shared) >= FOLLOWS:
        lag = lags[int(np.argmax(shared))]
        way = "ahead of" if lag > 0 else "behind"
        return (
            f"their rates agree when sub's clock is taken to be about {abs(lag)} s {way} "
            'main\'s: two clocks? rig key stamp = "log_time" would use the times of writing'
        )
    return "the rates of the two units do not follow each other: not on one ship, or two clocks?"


def _both(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rows that both have, as far as the shorter one goes."""
    x, y = x[: len(y)], y[: len(x)]
    known = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    return x[known], y[known]


def _shared(x: FloatArray, y: FloatArray) -> float:
    """The largest canonical correlation of rates (n, 3); 0 where there are too few to tell."""
    x, y = _both(x, y)
    if len(x) < FEW_SECONDS:
        return 0.0
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    return float(np.linalg.svd(np.linalg.qr(x)[0].T @ np.linalg.qr(y)[0], compute_uv=False)[0])


def _gravity_of_both(main: ImuSeries, sub: ImuSeries, R_s_m: FloatArray) -> str | None:
    """Gravity must be turned from one unit to the other as the rates are."""
    mean_m, mean_s = main.accel.mean(axis=0), sub.accel.mean(axis=0)
    size = float(np.linalg.norm(mean_m) * np.linalg.norm(mean_s))
    off = float(np.arccos(np.clip(mean_s @ R_s_m @ mean_m / max(size, 1e-12), -1.0, 1.0)))
    if off < 1.5 * MAX_ANGLE:
        return None
    return (
        f"gravity in the two units differs by {np.rad2deg(off):.0f} degrees once their rates agree: signs or axes of "
        "an accelerometer are wrong; rig keys main.accel_signs, sub.accel_signs"
    )


def _compared(reference: FloatArray, gyro: FloatArray, role: str) -> str | None:
    """What a gyro's rates say against the reference's of the same body."""
    found = _relation(reference, gyro)
    if found.gain > UNIT_FACTOR:
        unit = "deg/h" if found.gain > 1e4 else "deg/s"
        return f'the rates are {found.gain:.0f} times those of the attitude; rig key {role}.gyro_unit = "{unit}"'
    if 0.0 < found.gain < 1.0 / UNIT_FACTOR:
        smaller = 1.0 / found.gain
        return f"the rates are {smaller:.0f} times smaller than those of the attitude; check rig key {role}.gyro_unit"
    if found.mirrored:
        return f"the rates mirror those of the attitude: a sign is wrong; rig keys {role}.gyro_signs, {role}.attitude"
    if found.angle > MAX_ANGLE:
        return (
            f"the gyro's axes are turned by {np.rad2deg(found.angle):.0f} degrees against those of the attitude; "
            f"rig keys {role}.axes, {role}.attitude"
        )
    return None


@dataclass(frozen=True)
class _Relation:
    """How rates y (n, 3) follow rates x (n, 3), y = M x + b; the defaults say that it cannot be told.

    rotation: (3, 3), the one next to M, where x and y share all three directions and the same handedness.
    """

    gain: float = 0.0
    mirrored: bool = False
    rotation: FloatArray | None = None

    @property
    def angle(self) -> float:
        if self.rotation is None:
            return 0.0
        return float(np.arccos(np.clip(0.5 * (np.trace(self.rotation) - 1.0), -1.0, 1.0)))


def _relation(x: FloatArray, y: FloatArray) -> _Relation:
    """Gain where they share one direction at least, handedness and angle where they share all three.

    Shared: canonical correlations, so that a direction of mere noise has no say.
    """
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    shared = np.linalg.svd(np.linalg.qr(x)[0].T @ np.linalg.qr(y)[0], compute_uv=False)
    if shared[0] < SHARED[0]:
        return _Relation()
    matrix = np.linalg.lstsq(x, y, rcond=None)[0].T
    gain = float(np.linalg.norm(x @ matrix.T) / np.linalg.norm(x))
    if shared[-1] < SHARED[1]:
        return _Relation(gain)
    left, _, right = np.linalg.svd(matrix)
    if np.linalg.det(matrix) < 0.0:
        return _Relation(gain, mirrored=True)
    return _Relation(gain, rotation=np.asarray(left @ right))


def _averaged(unit: ImuSeries, grid: IntArray) -> FloatArray:
    """Mean rates (len(grid) - 1, 3) between the grid's times; NaN where a second holds too few samples."""
    edge = np.searchsorted(unit.stamp, grid)
    count = np.diff(edge)
    total = np.vstack([np.zeros(3), np.cumsum(unit.gyro, axis=0)])[edge]
    enough = count >= 0.8 * np.median(count)
    return np.where(enough[:, None], np.diff(total, axis=0) / np.maximum(count, 1)[:, None], np.nan)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
