"""Whittle maximum likelihood on the full attitude difference.

The attitude difference ``Log(A_m^T R_0 A_s R_ref^T) = theta + Phi + A_m^T d`` holds theta without the omega x theta
that angle increments carry (IDAM 14-16 drop it, although it is as large as theta' in their own scenario). The slow
drift d of the integrated gyros is fitted and taken out first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.flexure_fit import fit_flexure
from stages.paired import Linearisation, Observations, observe, pair


class Whittle:
    """Whittle likelihood of increments of the attitude difference, with standard errors; weak prior where short."""

    name: ClassVar[str] = "whittle"
    source: ClassVar[str] = "deckflex; spectrum of IDAM eq. 3 sampled exactly"
    options: ClassVar[Mapping[str, str]] = {}

    def identify(self, trial: Trial, alignment: Alignment) -> FlexureModel:
        """Flexure model of a trial; DataError when the units hardly overlap."""
        obs = observe(pair(trial, alignment), Linearisation.at(alignment))
        total = obs.total(_fitted_drift(obs), np.zeros(len(obs.dt)))
        return fit_flexure(obs.t, total, obs.good, trial.rig)


def _fitted_drift(obs: Observations) -> FloatArray:
    """(N, 3) rad, i-axes: least-squares d = d_0 + int A_m eps that, with a constant, explains z."""
    A_T = np.swapaxes(obs.A_end, 1, 2)
    travelled = np.cumsum(obs.A_integral, axis=0)
    constant = np.broadcast_to(np.eye(3), A_T.shape)
    columns = np.concatenate([constant, A_T, A_T @ travelled], axis=2)
    seen = np.isfinite(obs.z[:, 0])
    matrix, z = columns[seen].reshape(-1, 9), obs.z[seen].reshape(-1)
    scale = np.linalg.norm(matrix, axis=0)
    solution = np.linalg.lstsq(matrix / scale, z, rcond=1e-6)[0] / scale
    return np.asarray(solution[3:6] + travelled @ solution[6:9])
