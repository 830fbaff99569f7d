"""Trials from analytic motion and bending: every sample exact, every parameter of the model free to be changed.

The relative position of the two units is ``p = A_m (r + B theta(t - lag))``; what the accelerometers feel of it is the
second derivative by central differences of eighth order. No code of the project is used but the containers.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.trial import ImuSeries, Trial

EPOCH = 1_700_000_000_000_000_000
EARTH = np.array([1e-5, 5.2e-5, 5.1e-5])  # rad/s
GRAVITY = np.array([0.3, -0.2, 9.81])
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
H = 0.02  # s, of the differences


def cross_matrix(v) -> np.ndarray:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def sines(t: np.ndarray, amplitude: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Two sines per axis, (n, 3); the second of a third the size and 0.73 of the period."""
    phase = np.array([0.3, 1.9, 4.1])
    first = np.sin(np.multiply.outer(t, 2 * np.pi / period) + phase)
    return amplitude * (first + np.sin(np.multiply.outer(t, 2 * np.pi / (0.73 * period)) + 2 * phase) / 3.0)


@dataclass(frozen=True)
class World:
    """rad, m, s. static: Phi. bend: amplitude of theta. Errors are those of the sub-IMU, in its own axes, where nothing
    else is said."""

    static: np.ndarray = field(default_factory=lambda: np.array([0.02, -0.05, 0.1]))
    bend: np.ndarray = field(default_factory=lambda: np.array([1.5e-3, 1.2e-3, 2.0e-3]))
    bend_period: np.ndarray = field(default_factory=lambda: np.array([7.0, 5.0, 9.0]))
    motion: np.ndarray = field(default_factory=lambda: np.radians([5.0, 7.0, 4.0]))
    lever: np.ndarray = field(default_factory=lambda: np.array([4.0, -12.0, 2.0]))
    coupling: np.ndarray | None = None
    lag: float = 0.0
    delay: float = 0.0
    drift: float = 0.0
    gyro_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    main_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    scale: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    accel_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    duration: float = 24.0
    rate: float = 50.0
    sub_rate: float | None = None

    @property
    def coupled(self) -> np.ndarray:
        return -cross_matrix(self.lever) if self.coupling is None else self.coupling

    def main(self, t: np.ndarray) -> Rotation:
        """R_i_m."""
        euler = Rotation.from_euler("XYZ", sines(t, self.motion, np.array([8.0, 9.0, 11.0])))
        return Rotation.from_rotvec(np.multiply.outer(t, EARTH)) * euler

    def theta(self, t: np.ndarray) -> np.ndarray:
        return sines(t, self.bend, self.bend_period)

    def total(self, t: np.ndarray) -> Rotation:
        return Rotation.from_rotvec(self.theta(t)) * Rotation.from_rotvec(self.static)

    def place(self, t: np.ndarray) -> np.ndarray:
        return self.main(t).apply(self.lever + self.theta(t - self.lag) @ self.coupled.T)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        """(n, 3) m/s of the sub against the main, i-axes."""
        return sum(c * self.place(t + (j - 4) * H) for j, c in enumerate(FIRST)) / H

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        return sum(c * self.place(t + (j - 4) * H) for j, c in enumerate(SECOND)) / H**2

    def rate_m(self, t: np.ndarray) -> np.ndarray:
        """(n, 3) rad/s, omega_im_m by differences of the attitude."""
        e = 1e-3
        turn = (self.main(t - e).inv() * self.main(t + e)).as_rotvec()
        wide = (self.main(t - 2 * e).inv() * self.main(t + 2 * e)).as_rotvec()
        return (8.0 * turn - wide) / (12.0 * e)

    def force(self, name: str, t: np.ndarray) -> np.ndarray:
        common = GRAVITY + 0.4 * np.sin(np.multiply.outer(t, np.array([0.9, 0.7, 0.8])))
        if name == "main":
            return self.main(t).inv().apply(common)
        return (self.main(t) * self.total(t)).inv().apply(common + self.acceleration(t))

    def measured_at(self, stamp: np.ndarray) -> np.ndarray:
        """Instants, on the main IMU's clock, of what the sub-IMU stamps."""
        middle = 0.5 * (self.duration + 1 / self.rate)
        return (stamp - self.delay + self.drift * middle) / (1.0 + self.drift)

    def unit(self, name: str) -> ImuSeries:
        rate = self.rate if name == "main" or self.sub_rate is None else self.sub_rate
        stamp = np.arange(1, round(self.duration * rate) + 1) / rate
        edges = np.concatenate([[stamp[0] - 1 / rate], stamp])
        edges = edges if name == "main" else self.measured_at(edges)
        attitude = self.main(edges) if name == "main" else self.main(edges) * self.total(edges)
        gyro = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * rate
        nodes = 0.5 * (edges[:-1, None] + edges[1:, None]) + 0.5 * np.diff(edges)[:, None] * NODES
        force = self.force(name, nodes.ravel()).reshape(-1, len(NODES), 3)
        # Increments over the interval, divided by its length on the unit's own clock, gyro and accelerometer alike.
        accel = 0.5 * np.einsum("j,kji->ki", WEIGHTS, force) * np.diff(edges)[:, None] * rate
        if name == "sub":
            gyro, accel = gyro + gyro @ self.scale.T + self.gyro_bias, accel + self.accel_bias
        else:
            gyro = gyro + self.main_bias
        return ImuSeries(EPOCH + np.rint(stamp * 1e9).astype(np.int64), gyro, accel)

    def trial(self) -> Trial:
        return Trial(self.unit("main"), self.unit("sub"), EPOCH)
