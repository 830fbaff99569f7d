"""One log of the independent reality: a trial, the twin an engineer would believe, and the answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.blind.reality import deck_causes as deck
from pipeline.blind.reality import sensor_causes as sensor
from pipeline.blind.reality.assembly import assemble
from pipeline.blind.reality.causes import Cause
from pipeline.blind.reality.departures import effective
from pipeline.blind.reality.scenes import draw_scene
from pipeline.blind.reality.severity import FOREIGN, LISTED, SEVERITIES, parameters, plain, reached
from schemas.trial import Trial, Truth
from twin.config import Twin

MULTIPLES = (1.0, 3.0, 10.0)

CAUSES: dict[str, type[Cause]] = {
    "time_delay": sensor.TimeDelay,
    "clock_drift": sensor.ClockDrift,
    "timestamp_jitter": sensor.TimestampJitter,
    "sample_dropout": sensor.SampleDropout,
    "gyro_scale_factor": sensor.GyroScaleFactor,
    "gyro_nonorthogonality": sensor.GyroNonorthogonality,
    "gyro_g_sensitivity": sensor.GyroGSensitivity,
    "gyro_bias": sensor.GyroBias,
    "gyro_bias_instability": sensor.GyroBiasInstability,
    "gyro_random_walk": sensor.GyroRandomWalk,
    "gyro_temperature": sensor.GyroTemperature,
    "gyro_quantization": sensor.GyroQuantization,
    "gyro_saturation": sensor.GyroSaturation,
    "gyro_bandwidth": sensor.GyroBandwidth,
    "accel_bias": sensor.AccelBias,
    "accel_scale_factor": sensor.AccelScaleFactor,
    "lever_arm": deck.LeverArm,
    "static_misalignment": deck.StaticMisalignment,
    "misalignment_step": deck.MisalignmentStep,
    "thermal_bending": deck.ThermalBending,
    "flexure_parameters": deck.FlexureParameters,
    "second_mode": deck.SecondMode,
    "axis_coupling": deck.AxisCoupling,
    "amplitude_stiffening": deck.AmplitudeStiffening,
    "wave_forced_bending": deck.WaveForcedBending,
    "heel_bending": deck.HeelBending,
    "slamming": deck.Slamming,
    "nonstationary_sea": deck.NonstationarySea,
    "narrowband_vibration": sensor.NarrowbandVibration,
    "phins_latency": sensor.PhinsLatency,
    "phins_attitude_error": sensor.PhinsAttitudeError,
    "outliers": sensor.Outliers,
    "bouc_wen": deck.BoucWen,
    "rate_nonlinearity": sensor.RateNonlinearity,
    "fractional_flexure": deck.FractionalSpectrum,
    "sinusoidal_clock": sensor.SinusoidalClock,
}

Chosen = Sequence[str | tuple[str, Mapping[str, Any]]]


@dataclass(frozen=True)
class Drawn:
    """A log and what is behind it. truth: deformation as it was, not part of what is sealed."""

    trial: Trial
    twin: Twin
    answer: dict[str, Any]
    truth: Truth


def draw(
    seed: int | Sequence[int],
    *,
    effects: Chosen | None = None,
    duration: float = 600.0,
    null: bool | None = None,
    severity: float | None = None,
    grade: str | None = None,
    sea: str | None = None,
    rate: float = 100.0,
) -> tuple[Trial, Twin, dict[str, Any]]:
    """A trial (n samples at ``rate`` Hz), the believed twin, and the answer.

    effects: names, or (name, parameters of the log contract); drawn when None (null: none of them, True, or some,
    False; by chance when None). severity: multiple of the detectable; drawn from 1, 3, 10 when None.
    """
    drawn = draw_case(
        seed, effects=effects, duration=duration, null=null, severity=severity, grade=grade, sea=sea, rate=rate
    )
    return drawn.trial, drawn.twin, drawn.answer


def draw_case(
    seed: int | Sequence[int],
    *,
    effects: Chosen | None = None,
    duration: float = 600.0,
    null: bool | None = None,
    severity: float | None = None,
    grade: str | None = None,
    sea: str | None = None,
    rate: float = 100.0,
) -> Drawn:
    """As :func:`draw`, with the truth. Choice, scene and noise come from streams of their own."""
    choosing, staging, noise = np.random.default_rng(seed).spawn(3)
    scene = draw_scene(staging, duration, rate, grade, sea)
    multiple = float(choosing.choice(MULTIPLES)) if severity is None else severity
    wanted = _wanted(choosing, null) if effects is None else effects
    drawn = [
        (item, parameters(item, multiple, scene, choosing)) if isinstance(item, str) else (item[0], dict(item[1]))
        for item in wanted
    ]
    severities = [reached(name, multiple, values, scene) for name, values in drawn]
    causes = tuple(CAUSES[name](values) for name, values in drawn)
    trial, truth = assemble(scene.nature, causes, noise)
    real = scene.nature
    for cause in causes:
        real = cause.nature(real)
    answer = {
        "effects": [
            {
                "name": name,
                "parameters": values,
                "effective": plain(effective(name, values, scene.twin, real)),
                "listed": CAUSES[name].listed,
                "severity": severity,
            }
            for (name, values), severity in zip(drawn, severities)
        ],
        "null": not drawn,
        "severity": min(severities, default=None),
        "grade": scene.grade,
        "sea": scene.sea,
        "duration_s": duration,
        "turn": bool(scene.nature.voyage.turn),
        "lever_corner_hz": scene.nature.deck.corner,
        "lever_order": scene.nature.deck.order,
    }
    return Drawn(trial, scene.twin, answer, truth)


def _wanted(rng: np.random.Generator, null: bool | None) -> list[str]:
    """None, one or two effects of the list, or one from outside it."""
    if null or (null is None and rng.uniform() < 0.25):
        return []
    kind = rng.uniform()
    if kind < 0.1:
        return [str(rng.choice(FOREIGN))]
    return pair(rng) if kind < 0.25 else [str(rng.choice(LISTED))]


def pair(rng: np.random.Generator) -> list[str]:
    """Two different effects of the list."""
    return [str(name) for name in rng.choice(LISTED, 2, replace=False)]


assert set(CAUSES) == set(SEVERITIES)
