"""Whittle maximum likelihood on the full attitude difference.

The attitude difference ``Log(A_m^T R_0 A_s R_ref^T) = theta + Phi + A_m^T d`` holds theta without the omega x theta
that angle increments carry (IDAM 14-16 drop it, although it is as large as theta' in their own scenario). The slow
drift d of the integrated gyros is fitted and taken out first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from schemas.products import Alignment, BoolArray, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.drift import BREAK_S, LEAST_SHARE, LONGER_BREAKS_S, drift_in_m
from stages.flexure_fit import HOLE_S, fit_flexure
from stages.paired import Linearisation, Observations, observe, pair


class Whittle:
    """Whittle likelihood of increments of the attitude difference, with standard errors; weak prior where short."""

    name: ClassVar[str] = "whittle"
    source: ClassVar[str] = "deckflex; spectrum of IDAM eq. 3 sampled exactly"
    options: ClassVar[Mapping[str, str]] = {}

    def identify(self, trial: Trial, alignment: Alignment) -> FlexureModel:
        """Flexure model of a trial; DataError when the units hardly overlap."""
        obs = observe(pair(trial, alignment), Linearisation.at(alignment))
        drift, unsure = _drift(obs)
        d = np.nan_to_num(np.einsum("kij,kj->ki", obs.A_end, drift))
        total = obs.total(d, np.zeros(len(obs.dt)))
        return fit_flexure(obs.t, total, obs.good & ~unsure, trial.rig, dulled=obs.dulled)


def _drift(obs: Observations) -> tuple[FloatArray, BoolArray]:
    """Drift of each piece between gaps, and the samples (n,) without a sure one; many short gaps cut no pieces."""
    for longest in (BREAK_S, *LONGER_BREAKS_S):
        drift = drift_in_m(obs, longest)
        unsure = _unsure(obs, drift, longest)
        if np.count_nonzero(obs.good & ~unsure) >= LEAST_SHARE * np.count_nonzero(obs.good):
            break
    return drift, unsure


def _unsure(obs: Observations, drift: FloatArray, longest: float) -> BoolArray:
    """(n,) samples without a drift, and those after a gap at which it starts anew, so that no increment spans it."""
    unknown = np.isnan(obs.spread(drift)[:, 0])
    for end in obs.gap_end[obs.jump_s > longest]:
        first, last = np.searchsorted(obs.t, [end, end + 1.5 * HOLE_S])
        unknown[first:last] = True
    return unknown
