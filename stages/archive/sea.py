"""How rough the sea was, by what the ship did: the spread of the main IMU's rates and of its vertical specific force.

The log holds no wave height; the ship's own motion is what bends the deck, and every log has it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.rig import FloatArray
from schemas.trial import Trial

WILD = 8.0  # robust standard deviations: samples further out are drawn in to there


@dataclass(frozen=True)
class Motion:
    """rate_std: (3,) rad/s, standard deviation of the rate about hull x (pitch), y (roll), z (heading).

    vertical_std: m/s^2, standard deviation of the specific force along z.
    """

    rate_std: FloatArray
    vertical_std: float

    @property
    def roughness(self) -> float:
        """sqrt(std(pitch rate)^2 + std(roll rate)^2), rad/s: one figure for how much the ship moved in the waves."""
        return float(np.hypot(self.rate_std[0], self.rate_std[1]))


def motion_of(trial: Trial) -> Motion:
    """The motion of a trial, wild samples drawn in."""
    return Motion(_spread(trial.main.gyro), float(_spread(trial.main.accel[:, 2:])[0]))


def _spread(values: FloatArray) -> FloatArray:
    """(k,) standard deviation of each column of (n, k)."""
    known = values[np.isfinite(values).all(axis=1)]
    if not len(known):
        return np.full(values.shape[1], np.nan)
    middle = np.median(known, axis=0)
    robust = 1.4826 * np.median(np.abs(known - middle), axis=0)
    reach = np.where(robust > 0, WILD * robust, np.inf)
    return np.std(np.clip(known, middle - reach, middle + reach), axis=0)
