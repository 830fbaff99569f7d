"""Pairs of simulations, without and with effects, from the same seed."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.twin.worlds import perfect
from twin import Simulation, simulate

STIFF = {"std_arcmin": [0.0] * 3}
LIVELY = {"damping": [0.3, 0.2, 0.25], "frequency": [0.8, 0.6, 0.5], "std_arcmin": [6.0, 6.0, 10.0]}
PLUMB = {"static_arcmin": [0.0] * 3}
ARCMIN = np.pi / 180 / 60

# every effect of the log contract, each plainly there in half a minute
STRONG: dict[str, dict[str, Any]] = {
    "time_delay": {"delay": 0.02},
    "clock_drift": {"drift": 1000.0},
    "timestamp_jitter": {"std": 1e-4},
    "sample_dropout": {"rate": 0.5, "length": 3},
    "gyro_scale_factor": {"x": 1000.0, "z": -500.0},
    "gyro_nonorthogonality": {"xy": 300.0, "zx": -100.0},
    "gyro_g_sensitivity": {"x": 20.0, "z": 5.0},
    "gyro_bias": {"y": 3.0},
    "gyro_bias_instability": {"std": 2.0, "tau": 10.0},
    "gyro_random_walk": {"arw": 0.02},
    "gyro_temperature": {"slope": [0.5, 0.0, -1.0]},
    "gyro_quantization": {"step": 1.0},
    "gyro_saturation": {"limit": 4.0},
    "gyro_bandwidth": {"cutoff": 10.0},
    "accel_bias": {"x": 500.0},
    "accel_scale_factor": {"z": 500.0},
    "lever_arm": {"y": 0.5},
    "static_misalignment": {"x": 5.0, "z": -20.0},
    "misalignment_step": {"z": 3.0, "time": 10.0},
    "thermal_bending": {"amplitude": [2.0, 0.0, 5.0], "period": 600.0},
    "flexure_parameters": {"damping": {"x": 0.4}, "std_arcmin": [3.0, 3.0, 3.0]},
    "second_mode": {"damping": 0.1, "frequency": 4.0, "std_arcmin": 2.0, "axis": "y"},
    "axis_coupling": {"xy": 0.6, "yz": -0.3},
    "amplitude_stiffening": {"gain": 0.05},
    "wave_forced_bending": {"z": 0.8},
    "heel_bending": {"x": 20.0},
    "slamming": {"rate": 10.0, "amplitude": 5.0, "frequency": 8.0, "damping": 0.5},
    "nonstationary_sea": {"growth": 2.0},
    "narrowband_vibration": {"frequency": 12.0, "amplitude": 0.01, "axis": "z"},
    "phins_latency": {"delay": 0.03},
    "phins_attitude_error": {"x": 1.0, "z": 5.0, "period": 60.0},
    "outliers": {"rate": 60.0, "size": 0.2},
}
BENDING = {
    "static_misalignment", "misalignment_step", "thermal_bending", "flexure_parameters", "second_mode", "axis_coupling",
    "amplitude_stiffening", "wave_forced_bending", "heel_bending", "slamming", "nonstationary_sea",
}  # fmt: skip


def table(name: str, **changed: Any) -> dict[str, Any]:
    return {"name": name, **STRONG[name], **changed}


def alone(*effects: dict[str, Any], **tables: Any) -> Simulation:
    """A simulation with perfect instruments."""
    return simulate(perfect(effect=list(effects), **tables))


def pair(*effects: dict[str, Any], **tables: Any) -> tuple[Simulation, Simulation]:
    """Without and with the effects, perfect instruments."""
    return alone(**tables), alone(*effects, **tables)


def sine(t: np.ndarray, x: np.ndarray, frequency: float) -> complex:
    """Complex amplitude of x (n,) at a frequency in Hz, by least squares."""
    w = 2 * np.pi * frequency * t
    basis = np.stack([np.cos(w), np.sin(w), np.ones_like(t), t], axis=-1)
    c, s = np.linalg.lstsq(basis, x, rcond=None)[0][:2]
    return complex(c, -s)
