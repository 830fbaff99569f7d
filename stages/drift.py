"""The slow drift of the attitude match, taken out without a filter."""

from __future__ import annotations

import numpy as np

from schemas.rig import FloatArray
from stages.paired import Observations

BREAK_S = 0.1  # s: bridging a longer gap can miss more of the relative rotation than flexure moves meanwhile
SHORTEST_PIECE_S = 30.0  # s: less motion than this does not tell drift from flexure


def drift_in_m(obs: Observations, longest: float = BREAK_S) -> FloatArray:
    """(N, 3) rad, m-axes: ``A_m^T d`` with ``d = d_0 + int A_m eps``, by least squares on the increments of z.

    Increments, because those of the flexure are nearly white while its angle is not. Each piece between gaps
    longer than ``longest`` (s) has its own d_0 and eps; NaN in pieces too short for them.
    """
    drift = np.full_like(obs.z, np.nan)
    starts = np.flatnonzero(obs.jump_s > longest)
    for first, last in zip([0, *starts], [*starts, len(obs.dt)]):
        piece = slice(int(first), int(last))
        if np.sum(obs.dt[piece]) >= SHORTEST_PIECE_S and np.isfinite(obs.z[piece, 0]).sum() > SHORTEST_PIECE_S:
            drift[piece] = _fitted(
                obs.z[piece], np.swapaxes(obs.A_end[piece], 1, 2), (obs.A_mid * obs.dt[:, None, None])[piece]
            )
    return drift


def _fitted(z: FloatArray, A_T: FloatArray, A_integral: FloatArray) -> FloatArray:
    columns = np.concatenate([A_T, A_T @ np.cumsum(A_integral, axis=0)], axis=2)
    change, shown = np.diff(columns, axis=0), np.diff(z, axis=0)
    seen = np.isfinite(shown[:, 0])
    matrix = change[seen].reshape(-1, 6)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    solution = np.linalg.lstsq(matrix / scale, shown[seen].reshape(-1), rcond=1e-6)[0] / scale
    return np.asarray(columns @ solution)
