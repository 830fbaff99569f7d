"""Bandwidth of the sub-IMU's gyros."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.interpolate import CubicSpline

from twin.effects._effect import Effect
from twin.effects._parameters import parameter
from twin.effects._repair import runs

if TYPE_CHECKING:
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

LOUDEST = 100.0  # times


class GyroBandwidth(Effect):
    """Gyros of the sub-IMU behind a first-order low-pass: H(f) = 1 / (1 + i f / cutoff)."""

    name: ClassVar[str] = "gyro_bandwidth"
    cutoff: float = parameter("Hz", "of the low-pass", prior=(2.0, 500.0), least=0.01, most=inf, neutral=inf)
    advice: ClassVar[str] = "Widen the sub-IMU's output filter, or give both units the same one."

    def flexure_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """Multiplied by |H|^2; the noise comes after the low-pass."""
        return density / (1.0 + (omega / (2.0 * np.pi * interval * self.cutoff)) ** 2)

    def gyro(
        self, unit: str, t: FloatArray, gyro: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """Rates multiplied by H in frequency, ends mirrored; averaging over samples and H may change places.

        What lies above half the sample rate is filtered as what it is folded to.
        """
        if unit != "sub" or np.isinf(self.cutoff):
            return gyro
        n = len(gyro)
        low_pass = 1.0 / (1.0 + 1j * fft.rfftfreq(2 * n, 1.0 / scene.twin.run.rate) / self.cutoff)
        spectrum = fft.rfft(np.concatenate([gyro, gyro[::-1]]), axis=0) * low_pass[:, None]
        return fft.irfft(spectrum, 2 * n, axis=0)[:n]

    def compensate(self, repair: Repair) -> Repair:
        """omega + tau omega', tau = 1 / (2 pi cutoff), omega' of a cubic spline; noise grows by up to 1.7 tau rate.

        White noise of rate turns into noise of angle of tau times the noise of a sample, which does not add up. Where
        noise would grow by more than LOUDEST nothing is done.
        """
        if np.isinf(self.cutoff):
            return repair
        tau, t, gyro = 0.5 / (np.pi * self.cutoff), repair.t, repair.sub.gyro.copy()
        if 1.7 * tau / np.median(np.diff(t)) > LOUDEST:
            told = f"{self.name}: left in; noise would grow more than {LOUDEST:g} times under so low a cutoff"
            return repair.noted(told)
        for part in runs(t):
            if part.stop - part.start > 3:
                gyro[part] += tau * CubicSpline(t[part], gyro[part])(t[part], 1)
        return repair.with_sub(gyro=gyro)
