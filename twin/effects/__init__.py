"""Effects: what reality may add to a twin.

An effect is a class with a ``name`` and declared parameters (those of its ``[[effect]]`` table); it derives from
:class:`Effect` and overrides the hooks it acts through. A hook left alone hands back what it was given. Adding an
effect takes a file in this folder and a line in ``REGISTRY``.

The hooks are called in this order, the effects in the order of the twin's file. Times are seconds since the epoch;
``scene`` answers questions about the motion at any time; arrays are never changed in place. Each effect draws from a
generator of its own, so that adding one changes no noise and no other effect.

=============  =====================================================================================================
twin           parameters of the twin itself: lever arm, static angle, gyro biases, flexure parameters, delay, ...
sub_clock      when the sub-IMU really measured what it stamps t (intervals and rotation increments follow exactly)
phins_clock    the same for the attitudes of a PHINS (``unit`` is ``phins_main`` or ``phins_sub``)
sea_flexure    the random flexure of the sea, to be scaled or replaced before anything is added
flexure        theta(t): bending added; it moves the lever arm below the lever bandwidth
mount          the static angle Phi(t): steps and settling that do not move the lever arm
gyro, accel    ideal samples of ``main``, ``sub`` or ``sliding`` before scale, bias and noise
attitude       quaternions of a PHINS after its errors
imu            the finished series of any inertial unit: saturation, quantisation, outliers, lost or shifted stamps
=============  =====================================================================================================
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from importlib import import_module
from typing import Any
from zlib import crc32

import numpy as np
from pydantic import ValidationError

from schemas.errors import DataError
from twin.effects._effect import Effect, LookAlike

__all__ = ["REGISTRY", "Effect", "LookAlike", "build", "generators", "get", "look_alikes", "names"]

REGISTRY: dict[str, str] = {
    "time_delay": "twin.effects.time_delay:TimeDelay",
    "clock_drift": "twin.effects.clock_drift:ClockDrift",
    "timestamp_jitter": "twin.effects.timestamp_jitter:TimestampJitter",
    "sample_dropout": "twin.effects.sample_dropout:SampleDropout",
    "gyro_scale_factor": "twin.effects.gyro_scale_factor:GyroScaleFactor",
    "gyro_nonorthogonality": "twin.effects.gyro_nonorthogonality:GyroNonorthogonality",
    "gyro_g_sensitivity": "twin.effects.gyro_g_sensitivity:GyroGSensitivity",
    "gyro_bias": "twin.effects.gyro_bias:GyroBias",
    "gyro_bias_instability": "twin.effects.gyro_bias_instability:GyroBiasInstability",
    "gyro_random_walk": "twin.effects.gyro_random_walk:GyroRandomWalk",
    "gyro_temperature": "twin.effects.gyro_temperature:GyroTemperature",
    "gyro_quantization": "twin.effects.gyro_quantization:GyroQuantization",
    "gyro_saturation": "twin.effects.gyro_saturation:GyroSaturation",
    "gyro_bandwidth": "twin.effects.gyro_bandwidth:GyroBandwidth",
    "accel_bias": "twin.effects.accel_bias:AccelBias",
    "accel_scale_factor": "twin.effects.accel_scale_factor:AccelScaleFactor",
    "lever_arm": "twin.effects.lever_arm:LeverArm",
    "static_misalignment": "twin.effects.static_misalignment:StaticMisalignment",
    "misalignment_step": "twin.effects.misalignment_step:MisalignmentStep",
    "thermal_bending": "twin.effects.thermal_bending:ThermalBending",
    "flexure_parameters": "twin.effects.flexure_parameters:FlexureParameters",
    "second_mode": "twin.effects.second_mode:SecondMode",
    "axis_coupling": "twin.effects.axis_coupling:AxisCoupling",
    "amplitude_stiffening": "twin.effects.amplitude_stiffening:AmplitudeStiffening",
    "wave_forced_bending": "twin.effects.wave_forced_bending:WaveForcedBending",
    "heel_bending": "twin.effects.heel_bending:HeelBending",
    "slamming": "twin.effects.slamming:Slamming",
    "nonstationary_sea": "twin.effects.nonstationary_sea:NonstationarySea",
    "narrowband_vibration": "twin.effects.narrowband_vibration:NarrowbandVibration",
    "phins_latency": "twin.effects.phins_latency:PhinsLatency",
    "phins_attitude_error": "twin.effects.phins_attitude_error:PhinsAttitudeError",
    "outliers": "twin.effects.outliers:Outliers",
}


def names() -> tuple[str, ...]:
    """Names of all effects, in the order of the log contract."""
    return tuple(REGISTRY)


def get(name: str) -> type[Effect]:
    """The class of an effect; ``DataError`` with the names there are when there is none of that name."""
    if name not in REGISTRY:
        known = ", ".join(names()) or "none"
        raise DataError(f"there is no effect named '{name}' (known effects: {known})")
    module, _, cls = REGISTRY[name].partition(":")
    return getattr(import_module(module), cls)


def build(name: str, parameters: Mapping[str, Any]) -> Effect:
    """An effect with its parameters; ``DataError`` names the effect when they do not fit."""
    cls = get(name)
    try:
        return cls(**parameters)
    except ValidationError as problem:
        raise DataError(f"effect '{name}': {_told(cls, problem)}") from problem
    except TypeError as problem:
        raise DataError(f"effect '{name}': {problem}") from problem


def look_alikes(name: str, channels: Collection[str]) -> tuple[LookAlike, ...]:
    """What cannot, or hardly, be told from an effect in a log of these channels, the closest first."""
    own = {alike.name: alike for alike in get(name).look_alikes}
    for other in names():
        for alike in get(other).look_alikes:
            if alike.name == name and other not in own:
                own[other] = LookAlike(other, alike.share, alike.separated_by, alike.until)
    return tuple(sorted((a for a in own.values() if a.holds(channels)), key=lambda a: -(a.share or 0.5)))


def generators(effects: Sequence[Effect], rng: np.random.Generator) -> tuple[np.random.Generator, ...]:
    """A generator for each effect, from its name and how many of that name came before; ``rng`` is left as it was."""
    seed, seen, out = rng.bit_generator.seed_seq, Counter[str](), []
    for effect in effects:
        key = (*seed.spawn_key, crc32(effect.name.encode()), seen[effect.name])  # type: ignore[attr-defined]
        seen[effect.name] += 1
        child = np.random.SeedSequence(seed.entropy, spawn_key=key)  # type: ignore[attr-defined]
        out.append(np.random.default_rng(child))
    return tuple(out)


def _told(cls: type[Effect], problem: ValidationError) -> str:
    """A fault as a sentence: an unknown name first, for it is often why another is missing."""
    error = min(problem.errors(), key=lambda found: found["type"] != "extra_forbidden")
    key = ".".join(str(part) for part in error["loc"])
    known = ", ".join(f"'{item}'" for item in cls.model_fields)
    if error["type"] == "extra_forbidden":
        return f"unknown parameter '{key}' (there are {known})"
    if error["type"] == "missing":
        return f"lacks its parameter '{key}'"
    message = error["msg"].removeprefix("Value error, ")
    if not key:
        return message
    given = "" if error["type"] == "value_error" else f", not {error['input']!r:.80}"
    return f"'{key}' {message[0].lower()}{message[1:]}{given}"
