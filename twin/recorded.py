"""Motion of the main IMU as a log's own samples tell it, at any time, in place of a simulated ship's.

The twin's belief about the main IMU (bias, scale, skew) is taken out; what lies above the band in which ships move is
the unit's noise and no motion, and is left out. Rate and specific force are the derivatives of splines through the
sums of the samples, so that their means over the intervals are those of the samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline
from scipy.signal import firwin, kaiserord, oaconvolve
from scipy.spatial.transform import Rotation

from physics import earth, quaternions
from physics.units import DEG, DEG_PER_HOUR, MICRO_G
from schemas.trial import ImuSeries, ScalarSeries, Trial
from twin.config import Imu, Twin
from twin.motion import Motion
from twin.scene import Scene
from twin.sensors import gyro_matrix, installation

FloatArray = NDArray[np.float64]

PASS_HZ, STOP_HZ = 2.5, 4.0  # between them the band of the ship's own motion ends
REJECTION_DB = 140.0
DEGREE = 5  # of the splines: the derivative of a rate of 1 rad/s is good to 1e-9 at 100 Hz
REMEMBERED = 800_000  # instants
SPARE_S = 1.0  # s of motion beyond what is asked for
PHINS_BLOCK_S, LEVEL_BLOCK_S = 10.0, 60.0  # over which an attitude is compared with PHINS, or with gravity


@dataclass(frozen=True)
class RecordedMotion:
    """The main IMU's motion from the samples of a log; call :meth:`at` for times within span (s since the epoch).

    Nothing is worked out before it is asked for.
    """

    trial: Trial
    twin: Twin
    span: tuple[float, float]

    @cached_property
    def _state(self) -> _Path:
        return _path(self.trial, self.twin.imu.main, self.span)

    def at(self, t: FloatArray) -> Motion:
        """Everything at times t (n,) s. velocity is not known and zero; the place is that of GNSS, else the twin's."""
        q_0_m = self._state.attitude(t)
        q_n_m = self._to_level(t, q_0_m)
        latitude, longitude, height = self._place(t)
        zero = np.zeros((len(t), 3))
        return Motion(
            t=t, q_i_m=quaternions.multiply(self._start[None, :], q_0_m), q_n_m=q_n_m, omega=self._state.angle(t, 1),
            omega_dot=self._state.angle(t, 2), specific_force=self._state.impulse(t, 1), velocity=zero,
            angles=_euler(q_n_m), latitude=latitude, longitude=longitude, height=height,
        )  # fmt: skip

    def angles(self, t: FloatArray) -> FloatArray:
        """Pitch, roll and heading (n, 3) rad at times t (n,) s."""
        return _euler(self.attitude(t))

    def attitude(self, t: FloatArray) -> FloatArray:
        """q_n_m (n, 4), body to ENU: the gyros', held to PHINS or to gravity in the long run."""
        return self._to_level(t, self._state.attitude(t))

    def _to_level(self, t: FloatArray, q_0_m: FloatArray) -> FloatArray:
        centre, correction = self._held
        vector = np.stack([np.interp(t, centre, column) for column in correction.T], axis=-1)
        return quaternions.multiply(quaternions.exp(vector), self._reckoned(t, q_0_m))

    def _reckoned(self, t: FloatArray, q_0_m: FloatArray) -> FloatArray:
        """q_n_m from the gyros alone and the turning of the local level."""
        q_i_m = quaternions.multiply(self._start[None, :], q_0_m)
        return quaternions.multiply(quaternions.conjugate(self._level(t)), q_i_m)

    def _level(self, t: FloatArray) -> FloatArray:
        """q_i_n (n, 4)."""
        latitude, longitude, _ = self._place(t)
        return earth.local_level(latitude, longitude + earth.RATE * t)

    def _place(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        ship, gnss = self.twin.ship, self.trial.gnss
        if gnss is None or not len(gnss.stamp):
            one = np.ones(len(t))
            return ship.latitude * DEG * one, ship.longitude * DEG * one, ship.height * one
        at = self.trial.seconds(gnss.stamp)
        latitude, longitude = np.interp(t, at, gnss.latitude), np.interp(t, at, np.unwrap(gnss.longitude))
        return latitude, longitude, np.interp(t, at, gnss.altitude)

    @cached_property
    def _start(self) -> FloatArray:
        """q_i_0 (4,): the body at the path's first knot in the inertial frame."""
        t, seen = self._phins
        if len(t):
            first = np.array([t[0]])
            q_i_m = quaternions.multiply(self._level(first), seen[:1])
            return quaternions.multiply(q_i_m, quaternions.conjugate(self._state.attitude(first)))[0]
        return quaternions.multiply(self._level(self._state.t[:1]), self._levelled()[None, :])[0]

    def _levelled(self) -> FloatArray:
        """q_n_0 (4,) at the first knot: mean specific force up, the twin's heading."""
        path = self._state
        part = path.t <= path.t[0] + LEVEL_BLOCK_S
        force = quaternions.rotate(path.q[part], path.impulse(path.t[part], 1)).mean(axis=0)
        up = force / np.linalg.norm(force)
        east = np.cross([0.0, 1.0, 0.0], up)
        east /= np.linalg.norm(east)
        level = _quaternion(np.stack([east, np.cross(up, east), up]))
        half = 0.5 * self.twin.ship.heading * DEG
        turn = np.array([0.0, 0.0, np.sin(half), np.cos(half)])
        return quaternions.multiply(turn, level)

    @cached_property
    def _phins(self) -> tuple[FloatArray, FloatArray]:
        """Times (k,) and q_n_m (k, 4) by the main PHINS; none where there is none."""
        series, path = self.trial.phins_main, self._state
        if series is None or series.attitude is None:
            return np.zeros(0), np.zeros((0, 4))
        t = self.trial.seconds(series.stamp)
        good = np.isfinite(series.attitude).all(axis=1) & (t >= path.t[0]) & (t <= path.t[-1])
        turn = _quaternion(installation(self.twin.phins.installation_main_deg).T)
        return t[good], quaternions.multiply(series.attitude[good], turn[None, :])

    @cached_property
    def _held(self) -> tuple[FloatArray, FloatArray]:
        """Centres (k,) s of blocks and the rotation (k, 3) rad in n by which the reckoned attitude is put right."""
        t, seen = self._phins
        if len(t):
            error = quaternions.multiply(seen, quaternions.conjugate(self._reckoned(t, self._state.attitude(t))))
            return _blocks(t, quaternions.log(error), PHINS_BLOCK_S)
        t = self._state.t
        force = quaternions.rotate(self._reckoned(t, self._state.q), self._state.impulse(t, 1))
        centre, mean = _blocks(t, force, LEVEL_BLOCK_S)
        up = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        return centre, np.stack([up[:, 1], -up[:, 0], np.zeros(len(up))], axis=-1)


@dataclass(frozen=True)
class _Path:
    """Knots t (m,) s, attitude q (m, 4) there against the first; angle, impulse: sums of rate and specific force."""

    t: FloatArray
    q: FloatArray
    angle: BSpline
    impulse: BSpline

    @cached_property
    def _knots(self) -> tuple[FloatArray, FloatArray]:
        """Angle and rate (m, 3) at the knots."""
        return self.angle(self.t), self.angle(self.t, 1)

    def attitude(self, t: FloatArray) -> FloatArray:
        """q_0_m (n, 4): from the knot before by Exp(d + s^2/12 w_0 x w_1), exact for a rate that goes in a line."""
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 1)
        s = (t - self.t[k])[:, None]
        angle, rate = self._knots
        coning = quaternions.cross(rate[k], self.angle(t, 1)) * (s * s / 12.0)
        return quaternions.multiply(self.q[k], quaternions.exp(self.angle(t) - angle[k] + coning))


def restored(series: ImuSeries, belief: Imu) -> tuple[FloatArray, FloatArray]:
    """Rates and specific force (n, 3) without the errors that are believed: M^-1 (omega - b) and f - b."""
    matrix = gyro_matrix(belief.gyro_scale_ppm, belief.gyro_nonorthogonality_arcsec)
    gyro = (series.gyro - np.array(belief.gyro_bias_dph) * DEG_PER_HOUR) @ np.linalg.inv(matrix).T
    return gyro, series.accel - np.array(belief.accel_bias_ug) * MICRO_G


def _path(trial: Trial, belief: Imu, span: tuple[float, float]) -> _Path:
    from physics import matching

    gyro, accel = restored(trial.main, belief)
    unit = matching.bridge(trial.seconds(trial.main.stamp), gyro, accel)
    gyro, accel = unit.gyro, unit.accel
    if trial.main.instantaneous:
        gyro, accel = matching.interval_means(gyro), matching.interval_means(accel)
    step = float(np.median(np.diff(unit.t)))
    filter_ = _low_pass(step)
    before = max(0, int(np.ceil((unit.t[0] - span[0] + SPARE_S) / step)))
    after = max(0, int(np.ceil((span[1] - unit.t[-1] + SPARE_S) / step)))
    t = _extended(unit.t, step, before, after)
    gyro, accel = (_smooth(values, filter_, before, after) for values in (gyro, accel))
    path = matching.strapdown(matching.Unit(t, gyro, accel, np.zeros(len(t), dtype=bool)))
    return _Path(t, path.attitude, _sum(t, _rate_integrals(t, gyro)), _sum(t, accel[1:] * np.diff(t)[:, None]))


def _rate_integrals(t: FloatArray, gyro: FloatArray) -> FloatArray:
    """Integrals (m - 1, 3) of the rate over the intervals, from rotation increments: less their coning."""
    h = np.diff(t)[:, None]
    edge = gyro.copy()
    edge[:-1] = 0.5 * (gyro[:-1] + gyro[1:])
    return gyro[1:] * h - quaternions.cross(edge[:-1], edge[1:]) * (h * h / 12.0)


def _sum(t: FloatArray, increments: FloatArray) -> BSpline:
    """Spline through the running sums at the knots."""
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(increments, axis=0)])
    return make_interp_spline(t, total, k=DEGREE)


def _low_pass(step: float) -> FloatArray:
    """Symmetric filter of even steps whose band ends between PASS_HZ and STOP_HZ; (1,) where that is beyond Nyquist."""
    if 0.5 / step <= STOP_HZ:
        return np.ones(1)
    count, beta = kaiserord(REJECTION_DB, (STOP_HZ - PASS_HZ) * 2.0 * step)
    taps = firwin(count | 1, 0.5 * (PASS_HZ + STOP_HZ), window=("kaiser", beta), fs=1.0 / step)
    return np.asarray(taps / taps.sum())


def _smooth(values: FloatArray, taps: FloatArray, before: int, after: int) -> FloatArray:
    """Filtered values (n + before + after, 3), the record going on beyond its ends as its odd reflection."""
    half = len(taps) // 2
    longer = np.pad(values, ((before + half, after + half), (0, 0)), mode="reflect", reflect_type="odd")
    return longer if half == 0 else np.asarray(oaconvolve(longer, taps[:, None], mode="valid", axes=0))


def _extended(t: FloatArray, step: float, before: int, after: int) -> FloatArray:
    return np.concatenate([t[0] - step * np.arange(before, 0, -1), t, t[-1] + step * np.arange(1, after + 1)])


def _blocks(t: FloatArray, values: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Centres (k,) of blocks of a length that hold anything, and means (k, 3) of what they hold."""
    which = np.floor((t - t[0]) / length).astype(np.int64)
    count = np.bincount(which)
    some = count > 0
    mean = np.stack([np.bincount(which, column)[some] for column in values.T], axis=-1) / count[some, None]
    return np.bincount(which, t)[some] / count[some], mean


def _euler(q_n_m: FloatArray) -> FloatArray:
    """Pitch, roll, heading (n, 3) of R_n_m = Rz(h) Rx(p) Ry(r): from R's third row and second column."""
    x, y, z, w = q_n_m.T
    pitch = np.arcsin(np.clip(2.0 * (y * z + w * x), -1.0, 1.0))
    roll = np.arctan2(2.0 * (w * y - x * z), 1.0 - 2.0 * (x * x + y * y))
    heading = np.arctan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z))
    return np.stack([pitch, roll, np.unwrap(heading)], axis=-1)


def _quaternion(matrix: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(matrix).as_quat())


@dataclass(frozen=True)
class Remembered:
    """A ship that works out the motion at the same times once, for many replays of one log; not for several threads.

    It remembers up to REMEMBERED instants (200 MB); a log that asks for more is worked out anew each time.
    """

    ship: RecordedMotion
    _known: dict[tuple[int, int], Motion] = field(default_factory=dict, repr=False)

    def at(self, t: FloatArray) -> Motion:
        """Everything at times t (n,) s."""
        key = (len(t), hash(t.tobytes()))
        if key not in self._known:
            motion = self.ship.at(t)
            if sum(size for size, _ in self._known) + len(t) > REMEMBERED:
                return motion
            self._known[key] = motion
        return self._known[key]

    def angles(self, t: FloatArray) -> FloatArray:
        """Pitch, roll and heading (n, 3) rad at times t (n,) s."""
        return self.ship.angles(t)


def recorded_scene(
    trial: Trial,
    twin: Twin,
    span: tuple[float, float],
    duration: float | None = None,
    ship: Remembered | None = None,
) -> Scene:
    """The scene of a log: its own motion over a span (s), rate and thermometers; all else is the twin's.

    duration: s from the epoch to the end of the record that the trial is a piece of; None: to the end of the trial.
    ship: the log's motion where it is known already.
    """
    rate = 1e9 / float(np.median(np.diff(trial.sub.stamp)))
    end = float(trial.main.stamp[-1] - trial.epoch) * 1e-9 + 1.0 / rate
    run = twin.run.model_copy(update={"rate": rate, "duration": end if duration is None else duration})
    known = {"main": trial.temperature_main, "sub": trial.temperature_sub}
    thermometers = {
        unit: _reading(trial, series) for unit, series in known.items() if series is not None and len(series.stamp)
    }
    moving = RecordedMotion(trial, twin, span) if ship is None else ship
    return Scene(twin.model_copy(update={"run": run}), moving, thermometers)


def _reading(trial: Trial, series: ScalarSeries) -> Callable[[FloatArray], FloatArray]:
    at = trial.seconds(series.stamp)
    return lambda t: np.interp(t, at, series.value)
