"""Bandwidth of the sub-IMU's gyros."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from twin.effects._effect import Effect
from twin.effects._parameters import parameter

if TYPE_CHECKING:
    from twin.scene import Scene

FloatArray = NDArray[np.float64]


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
