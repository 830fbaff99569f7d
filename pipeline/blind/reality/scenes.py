"""Ship, sea and instruments of a sealed log: what the engineer believes, drawn anew for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.units import DEG
from pipeline.blind.reality import nature
from pipeline.blind.reality.nature import Nature, Voyage, Warmth
from pipeline.blind.reality.waves import Lines
from twin.config import Flexure, Imu, Imus, Mount, Phins, Rows, Run, Sea, Ship, Temperature, Twin

FloatArray = NDArray[np.float64]

GRADES = {"fine": 0.6, "navigation": 1.0, "plain": 2.0}  # noise and biases over those of a navigation-grade unit
SEAS = {"calm": 0.45, "moderate": 0.8, "rough": 1.2}
BELIEVED_LINES = 40  # of each motion


@dataclass(frozen=True)
class Scene:
    """A twin, the reality beside it (no effect yet), and how it was drawn. rates: rad/s rms about x, y, z."""

    twin: Twin
    nature: Nature
    grade: str
    sea: str
    rates: tuple[float, float, float]


def draw_scene(rng: np.random.Generator, duration: float, rate: float, grade: str | None, sea: str | None) -> Scene:
    """Everything but the effects. grade and sea: keys of GRADES and SEAS, drawn when None."""
    grade = grade or str(rng.choice(list(GRADES), p=[0.25, 0.55, 0.2]))
    sea = sea or str(rng.choice(list(SEAS), p=[0.2, 0.4, 0.4]))
    epoch = 1_700_000_000_000_000_000 + int(rng.integers(0, 86_400_000)) * 1_000_000_000
    twin = _believed(rng, duration, rate, GRADES[grade], epoch)
    voyage = nature.voyage(twin, _spread(SEAS[sea], rng), _turn(rng), rng)
    warmth = Warmth(
        20.0 + rng.normal(0.0, 1.0), (rng.uniform(5.0, 10.0), rng.uniform(5.0, 12.0)),
        (rng.uniform(0.15, 0.8) * duration, rng.uniform(0.15, 0.8) * duration), rng.uniform(0.1, 0.8),
        rng.uniform(0.5, 1.5) * duration,
    )  # fmt: skip
    believed = twin.model_copy(update={"sea": _reported(voyage, rng), "temperature": _reported_warmth(warmth)})
    reality = nature.actual(believed, voyage, warmth, epoch, rng)
    rates = tuple(lines.rate().rms for lines in (voyage.pitch, voyage.roll, voyage.yaw))
    return Scene(believed, reality, grade, sea, rates)  # type: ignore[arg-type]


def _believed(rng: np.random.Generator, duration: float, rate: float, noise: float, epoch: int) -> Twin:
    """Rounded as a person would write them where a person would."""
    lever = [rng.uniform(-3.0, 3.0), rng.choice([-1.0, 1.0]) * rng.uniform(15.0, 50.0), rng.uniform(-5.0, 5.0)]
    installation = rng.normal(0.0, 0.3, (2, 3)).round(3) if rng.uniform() < 0.5 else np.zeros((2, 3))
    return Twin(
        name="trial",
        run=Run(duration=duration, rate=rate, seed=0, start=epoch // 1_000_000_000),
        ship=Ship(
            latitude=float(np.degrees(np.arcsin(rng.uniform(-0.93, 0.93)))), longitude=rng.uniform(-180.0, 180.0),
            height=float(rng.uniform(8.0, 35.0)), heading=rng.uniform(-180.0, 180.0), speed=rng.uniform(4.0, 24.0),
        ),
        mount=Mount(static_arcmin=tuple(rng.uniform(-60.0, 60.0, 3)), lever_arm=tuple(lever)),
        flexure=Flexure(
            damping=tuple(np.exp(rng.uniform(np.log(0.05), np.log(0.25), 3))),
            frequency=tuple(rng.uniform(0.15, 0.95, 3)) if rng.uniform() < 0.75 else (0.0, 0.0, 0.0),
            std_arcmin=tuple(rng.uniform(3.0, 8.0, 3)),
        ),
        imu=Imus(main=_grade(noise, rng), sub=_grade(noise, rng)),
        phins=Phins(installation_main_deg=tuple(installation[0]), installation_sub_deg=tuple(installation[1])),
        effect=(),
    )  # fmt: skip


def _grade(noise: float, rng: np.random.Generator) -> Imu:
    signs = rng.choice([-1.0, 1.0], 15)
    return Imu(
        gyro_bias_dph=tuple(0.01 * noise * signs[:3]), gyro_arw=0.001 * noise, gyro_scale_ppm=tuple(5.0 * signs[3:6]),
        gyro_nonorthogonality_arcsec=tuple(5.0 * signs[6:12]), accel_bias_ug=tuple(50.0 * noise * signs[12:]),
        accel_vrw_ug=10.0 * noise,
    )  # fmt: skip


def _spread(sea: float, rng: np.random.Generator) -> tuple[float, ...]:
    """Standard deviations of pitch, roll, yaw (rad), surge, sway, heave (m)."""
    angles = sea * np.array([rng.uniform(0.6, 1.4), rng.uniform(2.5, 5.5), rng.uniform(0.4, 1.2)]) * DEG
    metres = sea * np.array([rng.uniform(0.05, 0.3), rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.6)])
    return tuple(float(v) for v in (*angles, *metres))


def _turn(rng: np.random.Generator) -> float:
    """One voyage in four turns, by 20 to 120 degrees."""
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(20.0, 120.0) * DEG) if rng.uniform() < 0.25 else 0.0


def _reported(voyage: Voyage, rng: np.random.Generator) -> Sea:
    """The sea as a wave buoy has it: the strongest lines, amplitudes off by 10 %, phases unknown."""

    def rows(lines: Lines, unit: float) -> Rows:
        first = np.sort(np.argsort(-lines.amplitude, kind="stable")[:BELIEVED_LINES])
        return tuple(
            (float(a * np.exp(0.1 * rng.standard_normal()) / unit), float(2.0 * np.pi / w), float(rng.uniform(0, 360)))
            for a, w in zip(lines.amplitude[first], lines.omega[first])
        )

    def path(lines: Lines) -> Lines:
        return Lines(lines.amplitude / lines.omega, lines.omega, lines.phase)

    return Sea(
        pitch=rows(voyage.pitch, DEG), roll=rows(voyage.roll, DEG), heading=rows(voyage.yaw, DEG),
        surge=rows(path(voyage.surge), 1.0), sway=rows(path(voyage.sway), 1.0), heave=rows(path(voyage.heave), 1.0),
    )  # fmt: skip


def _reported_warmth(warmth: Warmth) -> Temperature:
    """What the makers say: rise and time constant of neither unit in particular."""
    return Temperature(start=20.0, rise_main=8.0, rise_sub=8.0, tau=round(sum(warmth.tau) / 2.0, -1), swing=0.5)
