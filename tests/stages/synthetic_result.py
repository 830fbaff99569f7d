"""A trial, its truth and a plausible result made from nothing, for tests of scoring and publishing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from physics.rotations import from_euler
from physics.units import ARCMIN, DEG, STANDARD_GRAVITY
from schemas.products import (
    Alignment,
    DeckPass,
    DeckShape,
    Deformation,
    Estimate,
    FlexureModel,
    Innovations,
    Result,
)
from schemas.trial import GnssSeries, ImuSeries, OdometrySeries, Trial, Truth

EPOCH = 1_700_000_000_000_000_000
PHI = np.array([10.0, -8.0, 30.0]) * ARCMIN
DAMPING = np.array([0.12, 0.10, 0.08])
STIFFNESS = np.array([0.317, 0.186, 0.096])
SIGMA = np.array([3.0, 2.2, 4.0]) * ARCMIN
INSTALLATION_MAIN = from_euler(-0.250 * DEG, -0.041 * DEG, 0.430 * DEG)
INSTALLATION_SUB = from_euler(0.330 * DEG, -0.029 * DEG, 0.525 * DEG)


@dataclass(frozen=True)
class Case:
    trial: Trial
    truth: Truth
    result: Result


def stamps(duration: float, rate: float) -> np.ndarray:
    return EPOCH + np.round(np.arange(round(duration * rate)) * (1e9 / rate)).astype(np.int64)


def flexure(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Second-order noise, roughly the model's spectrum: enough to draw and to fit by eye."""
    dt = float(t[1] - t[0])
    out = np.empty((len(t), 3))
    for i in range(3):
        poles = np.roots([1.0, 2 * DAMPING[i], STIFFNESS[i]])
        a = np.real(np.poly(np.exp(poles * dt)))
        forcing = np.sqrt(4 * DAMPING[i] * STIFFNESS[i] / dt) * SIGMA[i]
        out[:, i] = lfilter([0.0, dt**2], a, forcing * rng.standard_normal(len(t)))
    return out


def attitude(t: np.ndarray) -> Rotation:
    heading = 0.6 + 0.02 * np.sin(2 * np.pi * t / 11.0) + 0.3 * np.sin(2 * np.pi * t / 500.0)
    pitch = 0.03 * np.sin(2 * np.pi * t / 7.9)
    roll = 0.08 * np.sin(2 * np.pi * t / 9.7)
    return Rotation.from_matrix(from_euler(heading, pitch, roll))


def mean_rates(rotation: Rotation, dt: float) -> np.ndarray:
    rate = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / dt
    return np.vstack([rate[:1], rate])


def imu(stamp: np.ndarray, rotation: Rotation, rng: np.random.Generator, with_attitude: bool = False) -> ImuSeries:
    dt = float(stamp[1] - stamp[0]) * 1e-9
    force = rotation.inv().apply([0.0, 0.0, STANDARD_GRAVITY]) + 1e-3 * rng.standard_normal((len(stamp), 3))
    return ImuSeries(stamp, mean_rates(rotation, dt), force, rotation.as_quat() if with_attitude else None)


def phins(stamp: np.ndarray, rotation: Rotation, mount: np.ndarray, noise: np.ndarray, rng: np.random.Generator):
    seen = Rotation.from_rotvec(noise) * rotation * Rotation.from_matrix(mount)
    return imu(stamp, seen, rng, with_attitude=True)


def drifting(t: np.ndarray, rng: np.random.Generator, std: np.ndarray, tau: float = 300.0) -> np.ndarray:
    decay = np.exp(-(t[1] - t[0]) / tau)
    start = std * rng.standard_normal(3)
    step = np.sqrt(1 - decay**2) * std * rng.standard_normal((len(t), 3))
    step[0] = start
    return lfilter([1.0], [1.0, -decay], step, axis=0)


def gnss(t: np.ndarray) -> GnssSeries:
    t = np.arange(0.0, t[-1], 1.0)
    north, east = 6.0 * t, 5.0 * t + 200.0 * np.sin(t / 200.0)
    latitude = 30.2 * DEG + north / 6.37e6
    longitude = 122.6 * DEG + east / (6.37e6 * np.cos(30.2 * DEG))
    covariance = np.broadcast_to(4.0 * np.eye(3), (len(t), 3, 3))
    return GnssSeries(EPOCH + (t * 1e9).astype(np.int64), latitude, longitude, np.full(len(t), 20.0), covariance)


def shape_of(arc: np.ndarray) -> np.ndarray:
    vertical = 2e-5 + 1.6e-4 * np.exp(-arc / 9) + 1e-5 * np.sin(2 * np.pi * arc / 60)
    torsion = -1e-5 - 2.2e-4 * np.exp(-arc / 8) + 8e-6 * np.sin(2 * np.pi * arc / 45)
    horizontal = 1.5e-5 + 1e-5 * np.exp(-arc / 20)
    return np.stack([vertical, torsion, horizontal], axis=1)


def deck_shape(rng: np.random.Generator, rate: float = 100.0, passes: int = 3) -> DeckShape:
    direction = np.array([-np.sin(7 * DEG), np.cos(7 * DEG), 0.0])
    std = np.array([8e-6, 9e-6, 1e-5])
    limit = np.array([1e-4, 1.5e-4, np.inf])
    runs = []
    for index in range(passes):
        arc = np.arange(0.0, 100.0, 5.0 / rate)
        arc = arc if index % 2 == 0 else arc[::-1]
        stamp = EPOCH + ((30.0 + 40.0 * index) * 1e9 + np.arange(len(arc)) * (1e9 / rate)).astype(np.int64)
        curvature = shape_of(arc) + std * rng.standard_normal((len(arc), 3))
        runs.append(
            DeckPass(
                index, index % 2 == 0, stamp, arc, arc[:, None] * direction, curvature,
                np.broadcast_to(std, curvature.shape).copy(),
                (np.abs(curvature) > limit) & (np.abs(curvature) > 3 * std),
            )
        )  # fmt: skip
    grid = np.arange(0.0, 100.0, 0.5)
    curve = shape_of(grid)
    sag = np.cumsum(np.cumsum(curve[:, 0])) * 0.25
    line = grid[:, None] * direction + np.stack([0 * sag, 0 * sag, sag], axis=1)
    sigma = np.broadcast_to(std / np.sqrt(passes), curve.shape).copy()
    return DeckShape(
        "synthetic", tuple(runs), grid, curve, sigma, line, np.abs(curve) > limit, limit, np.zeros_like(curve)
    )


def sled(shape: DeckShape) -> tuple[ImuSeries, OdometrySeries]:
    stamp = np.concatenate([run.stamp for run in shape.passes])
    position = np.concatenate([run.position for run in shape.passes])
    velocity = np.full((len(stamp), 3), [0.0, 5.0, 0.0])
    rates = np.concatenate([run.curvature for run in shape.passes]) * 5.0
    force = np.tile([0.0, 0.0, STANDARD_GRAVITY], (len(stamp), 1))
    return ImuSeries(stamp, rates, force), OdometrySeries(stamp, position, velocity)


def case(
    duration: float = 120.0,
    rate: float = 20.0,
    seed: int = 1,
    gap: tuple[float, float] | None = (50.0, 62.0),
    with_phins: bool = True,
    with_deck: bool = True,
    error_std: float = 0.15 * ARCMIN,
) -> Case:
    """Two units with flexure between them, sampled without a flaw but for one gap (s) in main IMU and estimate."""
    rng = np.random.default_rng(seed)
    stamp = stamps(duration, rate)
    t = (stamp - EPOCH) * 1e-9
    R_n_m, theta = attitude(t), flexure(t, rng)
    R_m_s = Rotation.from_rotvec(theta) * Rotation.from_rotvec(PHI)
    R_n_s = R_n_m * R_m_s
    noise = [
        drifting(t, rng, 0.3 * ARCMIN * np.ones(3)) + 0.06 * ARCMIN * rng.standard_normal((len(t), 3)) for _ in "ms"
    ]
    kept = np.ones(len(t), bool) if gap is None else (t < gap[0]) | (t > gap[1])
    truth = Truth(stamp, R_m_s.as_rotvec(), np.tile(PHI, (len(t), 1)), theta, stamp, R_n_s.as_quat())
    shape = deck_shape(rng) if with_deck else None
    slid = sled(shape) if shape is not None else (None, None)
    main = imu(stamp, R_n_m, rng)
    trial = Trial(
        main=ImuSeries(stamp[kept], main.gyro[kept], main.accel[kept]),
        sub=imu(stamp, R_n_s, rng),
        epoch=EPOCH,
        phins_main=phins(stamp, R_n_m, INSTALLATION_MAIN, noise[0], rng) if with_phins else None,
        phins_sub=phins(stamp, R_n_s, INSTALLATION_SUB, noise[1], rng) if with_phins else None,
        gnss=gnss(t),
        sliding=slid[0],
        sled=slid[1],
        source="synthetic.mcap",
    )
    deformation = estimate(stamp[kept], R_m_s[kept], theta[kept], t[kept], rng, error_std, with_phins)
    from stages.score import score

    scores = score(deformation, trial, truth)
    provenance = {"deckflex": "test", "estimator": "synthetic", "identifier": "synthetic"}
    return Case(trial, truth, Result(deformation, shape, scores, ("a warning to be read",), provenance))


def estimate(stamp, R_m_s, theta, t, rng, error_std, with_phins) -> Deformation:
    error = drifting(t, rng, error_std * np.ones(3), tau=100.0)
    total = (Rotation.from_rotvec(error) * R_m_s).as_rotvec()
    covariance = np.tile(error_std**2 * np.eye(3), (len(t), 1, 1))
    static = Estimate(PHI, 0.4 * ARCMIN * np.ones(3))
    mounts = [
        Estimate(Rotation.from_matrix(m).as_rotvec(), 1e-5 * np.ones(3)) if with_phins else None
        for m in (INSTALLATION_MAIN, INSTALLATION_SUB)
    ]
    alignment = Alignment(
        Rotation.from_rotvec(PHI).as_matrix(), static, np.diag(static.std**2),
        Estimate(np.array(0.0021), np.array(4e-5)), *mounts,
    )  # fmt: skip
    model = FlexureModel("synthetic", DAMPING, STIFFNESS, SIGMA, np.tile(0.01 * np.eye(3), (3, 1, 1)), np.zeros(3))
    every = t[:: max(1, round(0.2 / (t[1] - t[0])))]
    innovations = Innovations(every, rng.standard_normal((len(every), 3)), ("gyro x", "gyro y", "gyro z"))
    return Deformation(
        "synthetic", stamp, total, np.tile(PHI, (len(t), 1)), theta + error, covariance, alignment, model, innovations,
        {"time_delay": Estimate(np.array(0.002), np.array(3e-5))}, ("gyros only",), (),
    )  # fmt: skip
