"""How fast the deformation walks, read off the match itself: no model and no parameters of the ship."""

from __future__ import annotations

import numpy as np

from physics.units import ARCMIN
from schemas.rig import FloatArray
from stages.paired import Observations

LAG_S = 0.5  # s, the step of the model-free paper
LEAST = (1e-4 * ARCMIN) ** 2  # rad^2/s, rad^2/s^3


def densities(obs: Observations, z: FloatArray, d: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """(3,) rad^2/s of phi' and (3,) rad^2/s^3 of phi'', white, from first and second differences of ``z - A_m^T d``.

    E[dz^2] = density tau for a random walk, E[ddz^2] = 2/3 density tau^3 for an integrated one. Where d is given the
    first half, in which the filter had not settled, is left out.
    """
    phi = z if d is None else (z - np.einsum("kji,kj->ki", obs.A_end, d))[len(z) // 2 :]
    step = float(np.median(np.diff(obs.t[obs.index])))
    lag = max(1, round(LAG_S / step))
    first = phi[lag:] - phi[:-lag]
    second = first[lag:] - first[:-lag]
    return _mean_square(first) / (lag * step), 1.5 * _mean_square(second) / (lag * step) ** 3


def _mean_square(values: FloatArray) -> FloatArray:
    seen = values[np.isfinite(values[:, 0])]
    return np.maximum(np.mean(seen**2, axis=0), LEAST) if len(seen) else np.full(3, LEAST)
