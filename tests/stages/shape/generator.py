"""Small sliding trials with known shape, made from finite rotations alone (shares no code with the stage).

Attitude of main, sub and sled are composed as rotations at the sample times; each gyro sample is the rotation vector
between two of them over the step, plus bias and white noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.trial import ImuSeries, OdometrySeries, Trial

ARCMIN = np.pi / 180.0 / 60.0
EPOCH = 1_700_000_000_000_000_000


@dataclass(frozen=True)
class Case:
    seed: int = 1
    rate: float = 50.0
    length: float = 60.0
    speed: float = 4.0
    passes: int = 6
    rest: float = 4.0
    there_and_back: bool = True
    first_forward: bool = True
    flexure: tuple[float, float, float] = (1.0, 0.8, 1.2)  # arcmin
    share: float = 0.4  # at the path's start, falling to nothing at its end
    own_flexure: float = 0.0  # arcmin, felt by the sled alone
    noise: float = 9e-6  # rad/s a sample of the sled
    turn: tuple[float, float, float] = (0.004, -0.02, 0.03)  # rad, sled's axes against the hull's
    sled_delay: float = 0.0  # s, of gyro and odometry
    sea: float = 1.0
    outliers: float = 0.0  # share of samples, of 20 sigma


def curvature(s: np.ndarray) -> np.ndarray:
    """(n, 3) rad/m about x, y, z."""
    return np.stack(
        [
            3e-5 + 1.5e-4 * np.exp(-s / 9.0) + 1e-5 * np.sin(2 * np.pi * s / 40.0),
            -2e-5 - 2e-4 * np.exp(-s / 7.0),
            2e-5 * np.exp(-s / 20.0),
        ],
        axis=-1,
    )


def trial(case: Case) -> tuple[Trial, np.ndarray]:
    """A trial and the flexure theta (n, 3) at the main IMU's stamps."""
    rng = np.random.default_rng(case.seed)
    t, s = _motion(case)
    step = 1.0 / case.rate
    ship = _ship(t, rng, case.sea)
    theta = _flexure(t, np.array(case.flexure) * ARCMIN, rng)
    own = _flexure(t, np.full(3, case.own_flexure) * ARCMIN, rng)
    share = (case.share * (1.0 - s / case.length))[:, None]
    turned = _turned(s, case.length)
    sled = ship * Rotation.from_rotvec(share * theta + own) * turned * Rotation.from_rotvec(case.turn)
    sub = ship * Rotation.from_rotvec(theta) * Rotation.from_rotvec([0.001, 0.002, 0.006])
    stamp = EPOCH + np.round(t[1:] * 1e9).astype(np.int64)

    def unit(attitude: Rotation, noise: float, bias: np.ndarray, at: np.ndarray = stamp) -> ImuSeries:
        gyro = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / step + bias
        gyro = gyro + noise * rng.standard_normal(gyro.shape)
        return ImuSeries(at, gyro, np.zeros_like(gyro))

    sliding = unit(sled, case.noise, np.array([2e-7, -3e-7, 1e-7]), stamp + round(case.sled_delay * 1e9))
    wrong = rng.random(sliding.gyro.shape) < case.outliers
    sliding.gyro[wrong] += 20.0 * case.noise * np.sign(rng.standard_normal(wrong.sum()))
    odometry = _odometry(s[1:], case, sliding.stamp, rng)
    main, fixed = unit(ship, 2e-6, np.zeros(3)), unit(sub, 2e-6, np.full(3, 5e-8))
    return Trial(main, fixed, EPOCH, sliding=sliding, sled=odometry, source="synthetic"), theta[1:]


def _motion(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Time and arc length: rest, run, rest, run back (or carried back between runs at a crawl of one sample)."""
    step, ramp = 1.0 / case.rate, 1.0
    cruise = case.length / case.speed - ramp
    profile = np.concatenate([np.zeros(int(case.rest / step)), *_trapezoid(case.speed, ramp, cruise, step)])
    forward = np.cumsum(profile) * step
    forward *= case.length / forward[-1]
    pieces, ahead = [], case.first_forward
    for _ in range(case.passes):
        pieces.append(forward if ahead else case.length - forward)
        ahead = ahead if not case.there_and_back else not ahead
    s = np.concatenate([[pieces[0][0]], *pieces, np.full(int(case.rest / step), pieces[-1][-1])])
    return np.arange(len(s)) * step, s


def _trapezoid(speed: float, ramp: float, cruise: float, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    up = speed * np.arange(1, round(ramp / step) + 1) * step / ramp
    return up, np.full(round(cruise / step), speed), up[::-1]


def _ship(t: np.ndarray, rng: np.random.Generator, sea: float) -> Rotation:
    angles = np.zeros((len(t), 3))
    for axis, size in enumerate((0.8, 1.5, 0.6)):
        for period in rng.uniform(6.0, 16.0, 12):
            angles[:, axis] += sea * np.radians(size) / 4.0 * np.sin(2 * np.pi * t / period + rng.uniform(0, 2 * np.pi))
    return Rotation.from_euler("ZXY", angles[:, [2, 0, 1]])


def _flexure(t: np.ndarray, sigma: np.ndarray, rng: np.random.Generator, beta: float = 0.15) -> np.ndarray:
    """Critically damped second-order Gauss-Markov flexure as a sum of many random sines of its spectrum."""
    w = rng.uniform(0.002, 3.0, (400, 3))
    power = 4 * beta**3 / (w**2 + beta**2) ** 2 / (2 * np.pi) * 2 * 3.0 / 400
    phase = rng.uniform(0, 2 * np.pi, (400, 3))
    out = np.zeros((len(t), 3))
    for i in range(3):
        for wi, pi, fi in zip(w[:, i], power[:, i], phase[:, i]):
            out[:, i] += np.sqrt(2 * pi) * np.sin(wi * t + fi)
    return sigma * out


def _turned(s: np.ndarray, length: float) -> Rotation:
    """Attitude of the deck line at s against its start, by small exact turns."""
    grid = np.linspace(0.0, length, 4001)
    step = grid[1] - grid[0]
    angle = np.vstack([np.zeros(3), np.cumsum(curvature(grid[:-1] + step / 2) * step, axis=0)])
    return Rotation.from_rotvec(np.stack([np.interp(s, grid, angle[:, i]) for i in range(3)], axis=-1))


def _odometry(s: np.ndarray, case: Case, stamp: np.ndarray, rng: np.random.Generator) -> OdometrySeries:
    direction = np.array([-np.sin(np.radians(7.0)), np.cos(np.radians(7.0)), 0.0])
    speed = np.gradient(s) * case.rate
    position = np.array([8.0, -60.0, 0.5]) + s[:, None] * direction + 0.01 * rng.standard_normal((len(s), 3))
    return OdometrySeries(stamp, position, speed[:, None] * direction + 0.01 * rng.standard_normal((len(s), 3)))


def without(series: ImuSeries, keep: np.ndarray) -> ImuSeries:
    return replace(series, stamp=series.stamp[keep], gyro=series.gyro[keep], accel=series.accel[keep])


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


Shape = Callable[[np.ndarray], np.ndarray]
