"""Vibration of the sub-IMU."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from physics.units import DEG
from twin.effects._axes import along
from twin.effects._effect import Effect
from twin.effects._parameters import AXES, Axis, parameter

if TYPE_CHECKING:
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

NEAR = 2e-3  # share of the frequency that it may be off by


class NarrowbandVibration(Effect):
    """The sub-IMU vibrates about one axis at one frequency: omega + A sin(2 pi f t + p), p random."""

    name: ClassVar[str] = "narrowband_vibration"
    frequency: float = parameter("Hz", "of the vibration", prior=(1.0, 45.0), least=0.01, most=1000.0, default=12.0)
    amplitude: float = parameter("deg/s", "of the rate", prior=(1e-5, 1.0), least=0.0, most=500.0, neutral=0.0)
    axis: Axis = "x"
    advice: ClassVar[str] = "Find the machine that runs at this frequency, or set the sub-IMU on a stiffer base."

    def gyro(
        self, unit: str, t: FloatArray, gyro: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """omega + the mean of the sine over each sample interval."""
        phase = rng.uniform(0.0, 2.0 * np.pi) if unit == "sub" else 0.0
        if unit != "sub" or not self.amplitude:
            return gyro
        step = 1.0 / scene.twin.run.rate
        mean = np.sinc(self.frequency * step) * np.sin(2.0 * np.pi * self.frequency * (t - 0.5 * step) + phase)
        return gyro + along(self.axis, self.amplitude * DEG * mean)

    def compensate(self, repair: Repair) -> Repair:
        """The sine nearest to the frequency fitted to the rate about the axis, phase and size free, and taken off."""
        t, gyro, axis = repair.t, repair.sub.gyro.copy(), AXES.index(self.axis)
        window = np.sin(np.pi * (t - t[0]) / (t[-1] - t[0])) ** 2
        frequency = peak(t, gyro[:, axis] * window, self.frequency)
        basis = np.exp(2j * np.pi * frequency * t)
        columns = np.stack([basis.real, basis.imag], axis=-1)
        size = np.linalg.lstsq(columns * window[:, None], gyro[:, axis] * window, rcond=None)[0]
        gyro[:, axis] -= columns @ size
        told = f"{np.hypot(*size) / DEG:.2g} deg/s at {frequency:.4f} Hz taken out of the sub-IMU's gyro {self.axis}"
        return repair.with_sub(gyro=gyro).noted(f"{self.name}: {told}")


def peak(t: FloatArray, x: FloatArray, near: float) -> float:
    """The frequency (Hz) within NEAR of ``near`` at which the transform of x (n,) at times t (n,) s is largest."""
    low = x * np.exp(-2j * np.pi * near * t)
    reach = max(NEAR * near, 2.0 / (t[-1] - t[0]))
    block = 0.1 / reach
    which = np.floor((t - t[0]) / block).astype(np.int64)
    slow = np.bincount(which, low.real) + 1j * np.bincount(which, low.imag)
    size = fft.next_fast_len(16 * len(slow))
    power, offset = np.abs(fft.fft(slow, size)), fft.fftfreq(size, block)
    power[np.abs(offset) > reach] = 0.0
    return near + float(offset[np.argmax(power)])
