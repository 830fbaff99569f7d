"""By how much reality departs from the twin where an effect and a nuisance add up: what a diagnosis should find."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physics.units import ARCMIN, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G
from pipeline.blind.reality.nature import Nature
from twin.config import Twin

FloatArray = NDArray[np.float64]


def effective(name: str, drawn: dict[str, Any], twin: Twin, real: Nature) -> dict[str, Any]:
    """The effect's parameters with the nuisance of the same kind included, in the units of the log contract."""
    if name == "gyro_bias":
        return _axes(real.sub.bias / DEG_PER_HOUR - np.array(twin.imu.sub.gyro_bias_dph))
    if name == "accel_bias":
        return _axes(real.sub.accel_bias / MICRO_G - np.array(twin.imu.sub.accel_bias_ug))
    if name == "static_misalignment":
        return _axes(real.deck.static / ARCMIN - np.array(twin.mount.static_arcmin))
    if name == "gyro_random_walk":
        return {"arw": real.sub.arw / DEG_PER_SQRT_HOUR}
    if name == "flexure_parameters":
        deck = {"damping": real.deck.damping, "frequency": real.deck.frequency, "std_arcmin": real.deck.std / ARCMIN}
        return {key: deck[key] for key in drawn}
    return dict(drawn)


def _axes(values: FloatArray) -> dict[str, float]:
    return dict(zip("xyz", values))
