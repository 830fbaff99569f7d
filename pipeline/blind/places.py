"""Where an effect may rightly be found: channels, and axes in each of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

AXES = ("x", "y", "z")
ANY = frozenset(AXES) | {""}
GYRO, ACCEL, STAMP = "sub.gyro", "sub.accel", "sub.stamp"
ATTITUDE, MAIN_ATTITUDE = "phins_sub.attitude", "phins_main.attitude"

OWN_AXIS = {  # channels in which a sensor's effect shows on its own axis
    "gyro_scale_factor": (GYRO,),
    "gyro_nonorthogonality": (GYRO,),
    "gyro_g_sensitivity": (GYRO,),
    "gyro_bias": (GYRO,),
    "gyro_temperature": (GYRO,),
    "narrowband_vibration": (GYRO,),
    "rate_nonlinearity": (GYRO,),
    "accel_bias": (ACCEL,),
    "accel_scale_factor": (ACCEL,),
    "phins_attitude_error": (ATTITUDE,),
}
ANY_AXIS = {
    "time_delay": (GYRO, ACCEL, STAMP),
    "clock_drift": (GYRO, ACCEL, STAMP),
    "sinusoidal_clock": (GYRO, ACCEL, STAMP),
    "timestamp_jitter": (STAMP, GYRO, ACCEL),
    "sample_dropout": (STAMP, GYRO, ACCEL),
    "gyro_bias_instability": (GYRO,),
    "gyro_random_walk": (GYRO,),
    "gyro_quantization": (GYRO,),
    "gyro_saturation": (GYRO,),
    "gyro_bandwidth": (GYRO,),
    "outliers": (GYRO,),
    "lever_arm": (ACCEL,),
    "phins_latency": (ATTITUDE, MAIN_ATTITUDE, "phins_main.stamp", "phins_sub.stamp"),
    "static_misalignment": (GYRO, ACCEL, ATTITUDE),
    "misalignment_step": (GYRO, ACCEL, ATTITUDE),
    "axis_coupling": (GYRO, ACCEL, ATTITUDE),
    "amplitude_stiffening": (GYRO, ACCEL, ATTITUDE),
    "nonstationary_sea": (GYRO, ACCEL, ATTITUDE),
    "bouc_wen": (GYRO, ACCEL, ATTITUDE),
    "fractional_flexure": (GYRO, ACCEL, ATTITUDE),
}
BENDING = frozenset(
    {"thermal_bending", "flexure_parameters", "second_mode", "wave_forced_bending", "heel_bending", "slamming"}
)


def is_right(effect: Mapping[str, Any], channel: str, axis: str) -> bool:
    """Whether an effect with these parameters shows in this channel and axis.

    Bending about an axis shows there in gyros and attitude, and in the accelerometers on the other axes (the tilt of
    gravity, the lever arm).
    """
    name = effect["name"]
    if name in ANY_AXIS:
        return channel in ANY_AXIS[name]
    own = active_axes(effect)
    if name in OWN_AXIS:
        return channel in OWN_AXIS[name] and axis in own
    if name not in BENDING:
        return False
    if channel == ACCEL:
        return axis not in own or len(own) > 1
    return channel in (GYRO, ATTITUDE) and axis in own


def active_axes(effect: Mapping[str, Any]) -> frozenset[str]:
    """Axes on which an effect acts, as drawn."""
    name, drawn = effect["name"], effect["parameters"]
    if "axis" in drawn:
        return frozenset({drawn["axis"]})
    if name == "slamming":
        return frozenset({"x"})
    found = {key[0] for key, value in drawn.items() if key[:1] in AXES and len(key) <= 2 and value}
    for value in drawn.values():
        if isinstance(value, list):
            found |= {axis for axis, number in zip(AXES, value) if number}
    return frozenset(found) or ANY
