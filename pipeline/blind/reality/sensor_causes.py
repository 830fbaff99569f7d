"""Causes in the sub-IMU, its clock, and the PHINS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from physics.units import ARCMIN, ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G, PPM, STANDARD_GRAVITY
from pipeline.blind.reality.causes import Cause, Seen
from pipeline.blind.reality.nature import SKEW, Nature
from pipeline.blind.reality.sensing import wandering
from schemas.trial import ImuSeries

FloatArray = NDArray[np.float64]


class TimeDelay(Cause):
    """A sample stamped t is of t - delay."""

    @override
    def nature(self, nature: Nature) -> Nature:
        return replace(nature, delay=nature.delay + self.number("delay"))


class ClockDrift(Cause):
    """The clock gains drift (ppm): it says t when t / (1 + drift) has passed."""

    @override
    def sub_clock(self, t: FloatArray) -> FloatArray:
        return t - t * (self.number("drift") * PPM / (1.0 + self.number("drift") * PPM))


class TimestampJitter(Cause):
    """Stamps scatter by std; the driver keeps them in order."""

    @override
    def finish(self, series: ImuSeries, nature: Nature, rng: np.random.Generator) -> ImuSeries:
        stamp = np.sort(series.stamp + np.rint(1e9 * self.number("std") * rng.standard_normal(len(series))).astype(int))
        for k in np.flatnonzero(np.diff(stamp) <= 0):
            stamp[k + 1] = max(stamp[k + 1], stamp[k] + 1)
        return replace(series, stamp=stamp)


class SampleDropout(Cause):
    """Bursts of lost samples at random places, as many as the rate says."""

    @override
    def finish(self, series: ImuSeries, nature: Nature, rng: np.random.Generator) -> ImuSeries:
        length, count = int(self.number("length")), round(self.number("rate") * nature.duration)
        starts = rng.choice(np.arange(200, len(series) - 200), count, replace=False)
        lost = np.unique(starts[:, None] + np.arange(length))
        return replace(
            series,
            stamp=np.delete(series.stamp, lost),
            gyro=np.delete(series.gyro, lost, axis=0),
            accel=np.delete(series.accel, lost, axis=0),
        )


class GyroScaleFactor(Cause):
    """Each axis reads too much by so many ppm."""

    @override
    def nature(self, nature: Nature) -> Nature:
        return nature.with_sub(matrix=nature.sub.matrix + np.diag(self.vector()) * PPM)


class GyroNonorthogonality(Cause):
    """Each axis reads a little of the others."""

    @override
    def nature(self, nature: Nature) -> Nature:
        more = np.zeros((3, 3))
        for row, column in SKEW:
            more[row, column] = float(self.parameters.get("xyz"[row] + "xyz"[column], 0.0)) * ARCSEC
        return nature.with_sub(matrix=nature.sub.matrix + more)


class GyroGSensitivity(Cause):
    """The rate follows the force along the same axis."""

    @override
    def rate(self, seen: Seen, rng: np.random.Generator) -> FloatArray:
        return seen.gyro + seen.force / STANDARD_GRAVITY * self.vector() * DEG_PER_HOUR


class GyroBias(Cause):
    """Constant biases beyond the known ones."""

    @override
    def nature(self, nature: Nature) -> Nature:
        return nature.with_sub(bias=nature.sub.bias + self.vector() * DEG_PER_HOUR)


class GyroBiasInstability(Cause):
    """Biases that wander."""

    @override
    def rate(self, seen: Seen, rng: np.random.Generator) -> FloatArray:
        std = np.full(3, self.number("std") * DEG_PER_HOUR)
        return seen.gyro + wandering(len(seen.t), std, self.number("tau"), 1.0 / seen.nature.rate, rng)


class GyroRandomWalk(Cause):
    """White noise of another level."""

    @override
    def nature(self, nature: Nature) -> Nature:
        return nature.with_sub(arw=self.number("arw") * DEG_PER_SQRT_HOUR)


class GyroTemperature(Cause):
    """Biases that follow the sub-IMU's temperature, from 20 deg C on."""

    @override
    def rate(self, seen: Seen, rng: np.random.Generator) -> FloatArray:
        kelvin = seen.nature.warmth.at(1, seen.t) - 20.0
        return seen.gyro + kelvin[:, None] * self.vector("slope") * DEG_PER_HOUR


class GyroQuantization(Cause):
    """The unit counts whole steps of angle; what does not fill a step is kept for the next sample."""

    @override
    def finish(self, series: ImuSeries, nature: Nature, rng: np.random.Generator) -> ImuSeries:
        step = self.number("step") * ARCSEC
        counts = np.floor(np.cumsum(series.gyro / nature.rate, axis=0) / step + rng.uniform(0.0, 1.0, 3))
        counts -= counts[0] - np.rint(series.gyro[0] / nature.rate / step)
        return replace(series, gyro=np.diff(counts, axis=0, prepend=0.0) * (step * nature.rate))


class GyroSaturation(Cause):
    """Rates beyond the range read as the range."""

    @override
    def finish(self, series: ImuSeries, nature: Nature, rng: np.random.Generator) -> ImuSeries:
        limit = self.number("limit") * DEG
        return replace(series, gyro=np.minimum(np.maximum(series.gyro, -limit), limit))


class GyroBandwidth(Cause):
    """A first-order low-pass before the samples are taken."""

    @override
    def cutoff(self) -> float:
        return self.number("cutoff")


class AccelBias(Cause):
    """Constant biases of the accelerometers beyond the known ones."""

    @override
    def nature(self, nature: Nature) -> Nature:
        return nature.with_sub(accel_bias=nature.sub.accel_bias + self.vector() * MICRO_G)


class AccelScaleFactor(Cause):
    """Each accelerometer reads too much by so many ppm."""

    @override
    def force(self, force: FloatArray) -> FloatArray:
        return force + force * self.vector() * PPM


class NarrowbandVibration(Cause):
    """The unit rattles about one axis at one frequency: the turn between the ends of each sample interval."""

    @override
    def rate(self, seen: Seen, rng: np.random.Generator) -> FloatArray:
        t = np.append(seen.t[0] - 1.0 / seen.nature.rate, seen.t)
        w, phase = 2.0 * np.pi * self.number("frequency"), rng.uniform(0.0, 2.0 * np.pi)
        angle = -self.number("amplitude") * DEG / w * np.cos(w * t + phase)
        out = seen.gyro.copy()
        out[:, self.axis] += np.diff(angle) * seen.nature.rate
        return out


class Outliers(Cause):
    """Wild samples, each on one axis, 0.6 to 1.4 times the size, of either sign."""

    @override
    def finish(self, series: ImuSeries, nature: Nature, rng: np.random.Generator) -> ImuSeries:
        count = max(1, round(self.number("rate") / 60.0 * nature.duration))
        where = rng.choice(np.arange(500, len(series) - 500), count, replace=False)
        gyro = series.gyro.copy()
        size = self.number("size") * DEG * rng.uniform(0.6, 1.4, count) * rng.choice([-1.0, 1.0], count)
        gyro[where, rng.integers(0, 3, count)] += size
        return replace(series, gyro=gyro)


class PhinsLatency(Cause):
    """Both units' attitudes are old by the delay."""

    @override
    def phins_clock(self, t: FloatArray) -> FloatArray:
        return t - self.number("delay")


class PhinsAttitudeError(Cause):
    """A slow sine in the attitude of the unit at the sub-IMU."""

    @override
    def attitude(self, t: FloatArray) -> FloatArray | None:
        return np.outer(np.sin(2.0 * np.pi / self.number("period") * t), self.vector()) * ARCMIN


class RateNonlinearity(Cause):
    """Outside the list. w + k w |w| (order 2) or w + k w^3 (order 3), k in 1/(rad/s)^(order - 1)."""

    listed = False

    @override
    def rate(self, seen: Seen, rng: np.random.Generator) -> FloatArray:
        more = seen.gyro * np.abs(seen.gyro) if int(self.number("order")) == 2 else seen.gyro**3
        return seen.gyro + self.vector() * more


class SinusoidalClock(Cause):
    """Outside the list. The clock swings: stamped t, taken at t - amplitude sin(2 pi t / period)."""

    listed = False

    @override
    def sub_clock(self, t: FloatArray) -> FloatArray:
        return t - self.number("amplitude") * np.sin(2.0 * np.pi * t / self.number("period"))
