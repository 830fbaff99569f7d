"""The rate residual of the two gyros at full rate: what is left is flexure and noise.

    R(Phi) w_s(t + delay) - w_m(t) = theta' + w_m x theta + E w_m - lag w_m' + b + n

on the stamps of the sub-IMU. The main IMU is brought there, not the sub-IMU to the main one: interpolating the unit
that carries the flexure would look like a narrower bandwidth. w x theta is taken out with theta integrated from the
residual itself; what is left of any effect in proportion to the ship's own rate (E: scale, misalignment, its drift;
lag, its drift) by regression, weighted by the spectrum of the flexure, so that mean effects that nobody took out yet
do not stand in the spectra.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy import fft
from scipy.signal import firwin, oaconvolve

from physics import matching, quaternions, whittle
from physics.flexure import driven
from physics.kalman import FAST
from physics.units import ARCMIN, DEG_PER_HOUR, DEG_PER_SQRT_HOUR
from schemas.errors import DataError
from schemas.products import Alignment, BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, Trial
from twin import sensors
from twin.config import Imu, Twin

SHORTEST_S = 57.0  # s of common record below which spectra say nothing
EDGE_S = 1.0  # s masked at either end
GUARD = 2  # samples masked on either side of a bridged gap
HALF_WIDTH = 32  # samples on either side, of the interpolation of the main IMU
ON_GRID = 1e-3  # samples; closer than this the stamps of both units fall together
WAVES_HZ = (0.02, 1.0)  # band of the regression on the ship's motion
COARSE_HZ = 5.0  # rate at which that regression is done
SMOOTH_HZ, SMOOTH_S = 2.0, 2.0  # corner and length of the low-pass of the ship's motion before a lag of it is taken out
LAG = 12  # its column of the lag
PASSES = 2  # of integrating theta and taking it out


@dataclass(frozen=True, eq=False)
class FullRateResidual:
    """Residual at the stamps of the sub-IMU.

    t: (n,) s since the epoch, even. interval: s. rate: (n, 3) rad/s, theta' + noise, m-axes. good: (n,) measured by
    both. omega: (n, 3) rad/s of the main IMU, m-axes. theta: (n, 3) rad as taken out. R_m_s: (3, 3). lag, lag_std: s by
    which the sub's gyros trail the main ones beyond the delay of the twin. interpolated: the main IMU was, so that its
    noise is dulled next to half the sample rate.
    """

    t: FloatArray
    interval: float
    rate: FloatArray
    good: BoolArray
    omega: FloatArray
    theta: FloatArray
    R_m_s: FloatArray
    lag: float
    lag_std: float
    interpolated: bool = False

    @property
    def duration(self) -> float:
        """s."""
        return len(self.t) * self.interval


def residual(trial: Trial, alignment: Alignment, twin: Twin, astray: float = np.inf) -> FullRateResidual:
    """The residual of a trial; DataError where the units share less than SHORTEST_S.

    astray: how far E may be from nothing, one sigma: with waves alone a scale about an axis that the ship hardly turns
    about is known to a hundredth, which would be arcminutes once she alters her course.
    """
    sub, main = _bridged(trial.sub, trial.epoch), _bridged(trial.main, trial.epoch)
    first, omega, filled, between = _main_at(main, sub.t - float(alignment.time_delay.value))
    inside = slice(first, first + len(omega))
    t, interval = sub.t[inside], float(np.median(np.diff(sub.t)))
    if len(t) * interval < SHORTEST_S:
        raise DataError(f"the two units share less than {SHORTEST_S:.0f} s: no spectrum of their difference")
    omega = _without_errors(omega, twin.imu.main)
    seen = _without_errors(sub.gyro[inside], twin.imu.sub) @ alignment.rotation.T
    good = _grown(~(sub.filled[inside] | filled), interval)
    rate, theta, lag, lag_std = _cleaned(straight(seen - omega, good), omega, interval, twin, astray)
    lag += float(alignment.time_delay.value) - twin.mount.time_delay
    return FullRateResidual(t, interval, rate, good, omega, theta, alignment.rotation, lag, lag_std, between)


def linear(residual: FullRateResidual, gain: float, deck: FloatArray) -> FullRateResidual:
    """The residual of a deck without the stiffening ``gain``, 1/rad^2. deck: (2, 3) its own mu and b^2.

    theta + d, d'' + 2 mu d' + b^2 d = b^2 gain theta^3
    """
    theta = np.empty_like(residual.theta)
    for axis, (mu, b2) in enumerate(deck.T):
        theta[:, axis] = driven(mu, b2, residual.interval, b2 * gain * residual.theta[:, axis] ** 3)
    rate = residual.rate + np.gradient(theta, residual.interval, axis=0)
    return replace(residual, rate=rate, theta=residual.theta + theta)


def straight(rate: FloatArray, good: BoolArray) -> FloatArray:
    """(n, 3) with straight lines across what was not measured: of the difference of the units, not of their motion."""
    if good.all() or not good.any():
        return rate
    at, known = np.arange(len(good)), np.flatnonzero(good)
    return np.stack([np.interp(at, known, column) for column in rate[known].T], axis=1)


def _bridged(series: ImuSeries, epoch: int) -> matching.Unit:
    """A unit with straight lines across its gaps, as means over intervals."""
    unit = matching.bridge(np.asarray((series.stamp - epoch) * 1e-9), series.gyro, series.accel)
    if not series.instantaneous:
        return unit
    return matching.Unit(unit.t, matching.interval_means(unit.gyro), unit.accel, unit.filled)


def _without_errors(gyro: FloatArray, belief: Imu) -> FloatArray:
    """The rates that a unit of these errors measured, (n, 3) rad/s."""
    matrix = sensors.gyro_matrix(belief.gyro_scale_ppm, belief.gyro_nonorthogonality_arcsec)
    return np.asarray(np.linalg.solve(matrix, (gyro - np.array(belief.gyro_bias_dph) * DEG_PER_HOUR).T).T, dtype=float)


def _grown(good: BoolArray, interval: float) -> BoolArray:
    """Good samples away from gaps and ends."""
    bad = np.convolve(~good, np.ones(2 * GUARD + 1), "same") > 0.5
    edge = max(int(EDGE_S / interval), HALF_WIDTH)
    bad[:edge] = bad[-edge:] = True
    return ~bad


def _main_at(main: matching.Unit, at: FloatArray) -> tuple[int, FloatArray, BoolArray, bool]:
    """Rates of the main IMU for the intervals that end at instants (k,): first one covered, rates, bridged or not, and
    whether they lie between its samples."""
    step = float(np.median(np.diff(main.t)))
    place = np.interp(at, main.t, np.arange(len(main.t)), left=-1.0, right=-1.0)
    place = np.where(np.diff(at, prepend=at[0] - step) > 0, place, -1.0)
    whole = np.flatnonzero((place >= 0.0) & (at <= main.t[-1]))
    if not len(whole):
        return 0, np.zeros((0, 3)), np.zeros(0, bool), False
    place = place[whole[0] : whole[-1] + 1]
    index, share = np.rint(place).astype(np.int64), place - np.rint(place)
    between = bool(np.abs(share).max() >= ON_GRID)
    values = _between(main.gyro, place) if between else main.gyro[index]
    return int(whole[0]), values, main.filled[index], between


def _between(values: FloatArray, place: FloatArray) -> FloatArray:
    """Band-limited interpolation of (n, 3) at fractional indices (k,): a windowed sinc, which keeps white noise."""
    fine = 64  # the filter's own grid, between whose rows it is linear: errors of 1e-4 of the highest frequencies
    taps = firwin(2 * HALF_WIDTH * fine + 1, 1.0 / fine, window=("kaiser", 7.0)) * fine
    rows = np.arange(fine + 1)[:, None] + fine * np.arange(2 * HALF_WIDTH - 1, -1, -1)
    padded = np.pad(values, ((HALF_WIDTH, HALF_WIDTH), (0, 0)), mode="edge")
    return np.asarray(_weighted(taps[rows], np.ascontiguousarray(padded.T), place))


@njit(cache=True, nogil=True, fastmath=FAST)
def _weighted(weights, padded, place):  # type: ignore[no-untyped-def]
    """(k, 3) sums of padded (3, n + 2 HALF_WIDTH) around fractional indices; weights (fine + 1, 2 HALF_WIDTH) for the
    share of a sample by which an index is beyond a whole one."""
    fine = len(weights) - 1
    out = np.empty((len(place), 3))
    own = np.empty(2 * HALF_WIDTH)
    for k in range(len(place)):
        base = int(place[k])
        share = (place[k] - base) * fine
        row = min(int(share), fine - 1)
        share -= row
        for j in range(2 * HALF_WIDTH):
            own[j] = weights[row, j] + share * (weights[row + 1, j] - weights[row, j])
        for c in range(3):
            near = padded[c, base + 1 : base + 1 + 2 * HALF_WIDTH]
            total = 0.0
            for j in range(2 * HALF_WIDTH):
                total += own[j] * near[j]
            out[k, c] = total
    return out


def _weights(n: int, interval: float, believed: Twin) -> FloatArray:
    """(n//2 + 1, 3): 1 / sqrt of the twin's spectrum within the band of the waves, else 0."""
    frequency = fft.rfftfreq(n, interval)
    inside = (frequency > WAVES_HZ[0]) & (frequency < WAVES_HZ[1])
    out = np.zeros((len(frequency), 3))
    noise = np.hypot(believed.imu.main.gyro_arw, believed.imu.sub.gyro_arw) * DEG_PER_SQRT_HOUR
    for axis, (mu, lam, arcmin) in enumerate(_per_axis(believed)):
        omega = 2.0 * np.pi * frequency[inside] * interval
        power = whittle.increment_spectrum(omega, mu, mu**2 + lam**2, max(arcmin, 1e-3) * ARCMIN, noise, interval)
        out[inside, axis] = interval / np.sqrt(power)
    return out


def _per_axis(twin: Twin) -> list[tuple[float, float, float]]:
    flexure = twin.flexure
    return list(zip(flexure.damping, flexure.frequency, flexure.std_arcmin))


def _cleaned(
    seen: FloatArray, omega: FloatArray, interval: float, twin: Twin, astray: float
) -> tuple[FloatArray, FloatArray, float, float]:
    """Rate without w x theta and without what is proportional to the ship's motion; theta; lag and its std."""
    attitude, slope = _attitude(omega, interval), _slope(omega, interval)
    rate, theta = seen, np.zeros_like(seen)
    for _ in range(PASSES):
        bent = seen - quaternions.cross(omega, theta)
        motion, lag, lag_std = _motion(bent, omega, slope, attitude, interval, twin, astray)
        rate = seen - motion
        theta = _integrated(rate, attitude, interval)
    rate = rate - quaternions.cross(omega, theta)
    left, _, _ = _motion(rate, omega, slope, attitude, interval, twin, astray)
    return rate - left, theta, lag, lag_std


def _attitude(omega: FloatArray, interval: float) -> FloatArray:
    t = np.asarray(interval * np.arange(len(omega)), dtype=float)
    unit = matching.Unit(t, omega, np.zeros_like(omega), np.zeros(len(t), bool))
    return matching.strapdown(unit).attitude


def _integrated(rate: FloatArray, attitude: FloatArray, interval: float) -> FloatArray:
    """theta at mid-interval of theta' = rate - w x theta: A_m^T (c + int A_m rate dt), c such that its mean is 0.

    c is what theta was at first: constant in inertial axes, so that taking the mean out in m-axes would leave products
    of two rates of the ship.
    """
    turned = np.cumsum(quaternions.rotate(attitude, rate), axis=0) * interval
    turned[1:] = 0.5 * (turned[1:] + turned[:-1])
    to_m = quaternions.conjugate(attitude)
    mean = quaternions.rotate(to_m, turned).mean(axis=0)
    axes = np.stack([quaternions.rotate(to_m, np.broadcast_to(axis, turned.shape)).mean(axis=0) for axis in np.eye(3)])
    return quaternions.rotate(to_m, turned - np.linalg.lstsq(axes.T, mean, rcond=1e-6)[0])


def _motion(
    rate: FloatArray, omega: FloatArray, slope: FloatArray, attitude: FloatArray, interval: float, twin: Twin,
    astray: float,
) -> tuple[FloatArray, float, float]:  # fmt: skip
    """The part (n, 3) of a rate in proportion to the ship's motion, and the lag of it, s, and its std. astray: of E."""
    every = max(1, int(1.0 / (COARSE_HZ * interval)))
    coarse, spacing = _means(rate, every), every * interval
    time = _means(_clock(len(rate)), every)
    middle = attitude[every // 2 :: every][: len(coarse)]
    design = _columns(_means(omega, every), _means(slope, every), time, middle)
    weights = _weights(len(coarse), spacing, twin)
    whitened = fft.rfft(coarse, axis=0) * weights
    spectra = np.stack([fft.rfft(column, axis=0) * weights for column in design]).reshape(len(design), -1)
    matrix, right = (spectra.conj() @ spectra.T).real, (spectra.conj() @ whitened.reshape(-1)).real
    # |rfft|^2 of white noise of variance v is n v, half of it in the real part
    matrix[range(LAG), range(LAG)] += 0.5 * len(coarse) / astray**2
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / scale / scale[:, None] + 1e-9 * np.eye(len(scale))
    solution = np.linalg.solve(scaled, right / scale) / scale
    spread = np.sqrt(len(coarse) * np.linalg.inv(scaled)[LAG, LAG] / 2.0) / scale[LAG]
    return _predicted(solution, omega, slope, attitude), float(solution[LAG]), float(spread)


def _predicted(x: FloatArray, omega: FloatArray, slope: FloatArray, attitude: FloatArray) -> FloatArray:
    """What the coefficients (20,) of ``_columns`` say at full rate, (n, 3)."""
    time = _clock(len(omega))
    astray = x[9:12] * time + _back(attitude, np.broadcast_to(x[14:17], omega.shape))
    astray += _back(attitude, _lasting(attitude, np.broadcast_to(x[17:20], omega.shape)))
    turned = quaternions.cross(omega, astray)
    return omega @ x[:9].reshape(3, 3).T + turned - (x[LAG] + x[LAG + 1] * time) * slope


def _columns(omega: FloatArray, slope: FloatArray, time: FloatArray, attitude: FloatArray) -> FloatArray:
    """Regressors (20, n, 3): E in nine, drift of the misalignment in three, lag, drift of the lag; what theta was at
    first and what a bias of the gyros makes of it, which a ship that turns sees from all sides, in three each."""
    out = np.zeros((20, len(omega), 3))
    for row in range(3):
        for column in range(3):
            out[3 * row + column, :, row] = omega[:, column]
    for axis in range(3):
        one = np.broadcast_to(np.eye(3)[axis], omega.shape)
        out[9 + axis] = quaternions.cross(omega, one * time)
        out[14 + axis] = quaternions.cross(omega, _back(attitude, one))
        out[17 + axis] = quaternions.cross(omega, _back(attitude, _lasting(attitude, one)))
    out[LAG], out[LAG + 1] = -slope, -slope * time
    return out


def _back(attitude: FloatArray, inertial: FloatArray) -> FloatArray:
    """(n, 3) in m-axes of vectors in inertial ones."""
    return quaternions.rotate(quaternions.conjugate(attitude), inertial)


def _lasting(attitude: FloatArray, rate: FloatArray) -> FloatArray:
    """(n, 3) integral over the record, as a share of it, of a rate in m-axes, in inertial ones."""
    return np.asarray(np.cumsum(quaternions.rotate(attitude, rate), axis=0) / len(rate))


def _clock(n: int) -> FloatArray:
    return np.linspace(-1.0, 1.0, n)[:, None]


def _slope(omega: FloatArray, interval: float) -> FloatArray:
    """(n, 3) rad/s^2, how the ship's rate changes, without the noise of the gyros: a lag of a hundredth of a second
    would put that into the spectra at 20 to 40 Hz, as large as it is itself."""
    half = int(0.5 * SMOOTH_S / interval)
    taps = firwin(2 * half + 1, min(SMOOTH_HZ * interval, 0.4), fs=1.0)
    padded = np.pad(omega, ((half + 1, half + 1), (0, 0)), mode="edge")
    smooth = oaconvolve(padded, taps[:, None], mode="valid", axes=0)
    return np.asarray((smooth[2:] - smooth[:-2]) / (2.0 * interval))


def _means(values: FloatArray, every: int) -> FloatArray:
    """Means over ``every`` samples, (n // every, c)."""
    n = len(values) // every
    return np.asarray(values[: n * every].reshape(n, every, -1).mean(axis=1))
