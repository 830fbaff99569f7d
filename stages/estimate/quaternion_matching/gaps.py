"""Gaps: bridged where they are short, otherwise the match starts anew behind them.

A gap is bridged by rates that run linearly across it. Where that can be off by more than the match was uncertain at its
very start, nothing is kept of it: the sub-IMU's path is turned so that Y goes on as it was, and d starts again from its
prior. Neither unit is used to carry the other across, as their alignment is what is looked for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from physics import quaternions
from physics.matching import Strapdown, strapdown
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial
from stages.paired import Observations, Paired, clean_unit

GAP_TURN = 0.05  # rad/s^3 for short gaps, rad/s for long ones: what bridging may miss of the ship's motion


def integrated(trial: Trial) -> Paired:
    """Both units cleaned, gaps bridged, and integrated, each by itself."""
    main, spikes_main = clean_unit(trial.main, trial.epoch)
    sub, spikes_sub = clean_unit(trial.sub, trial.epoch)
    return Paired(main, sub, strapdown(main), strapdown(sub), (spikes_main, spikes_sub))


def bridging_error(length: FloatArray) -> FloatArray:
    """(k,) rad, 1 sigma, of attitudes across bridged gaps of length (k,) s."""
    return np.asarray(np.minimum(GAP_TURN * length**3, GAP_TURN * length))


def drift_variance(jump: FloatArray, d_prior: FloatArray) -> FloatArray:
    """(N, 3) rad^2 that gaps of length jump (N,) s add to d."""
    bridged = bridging_error(jump)
    anew = bridged > d_prior.min()
    return np.where(anew[:, None], d_prior**2, (bridged**2)[:, None])


def rejoined(obs: Observations, R_ref: FloatArray, d_prior: FloatArray) -> Observations:
    """The same observations, Y continued across every gap that is too long to be bridged."""
    before, after = _gaps(obs, float(d_prior.min()))
    if len(before) == 0:
        return obs
    main, old = obs.main.attitude, obs.sub.attitude
    turned = old.copy()
    for a, b, end in zip(before, after, [*after[1:], len(old)]):
        Y = quaternions.multiply(quaternions.conjugate(main[a]), turned[a])
        turn = quaternions.multiply(quaternions.multiply(main[b], Y), quaternions.conjugate(old[b]))
        turned[b:end] = quaternions.multiply(turn, old[b:end])
    to_m = quaternions.conjugate(main[obs.index])
    total = quaternions.multiply(to_m, turned[obs.index])
    z = quaternions.log(quaternions.multiply(total, Rotation.from_matrix(R_ref.T).as_quat()))
    z[np.isnan(obs.z[:, 0])] = np.nan
    sub = Strapdown(obs.sub.t, turned, obs.sub.velocity)
    return replace(obs, sub=sub, z=z)


def _gaps(obs: Observations, tolerated: float) -> tuple[IntArray, IntArray]:
    """Last good sample before and first one after each gap that bridging may miss by more than ``tolerated``, rad."""
    good = np.flatnonzero(obs.good)
    before, after = good[:-1], good[1:]
    long = (after - before > 1) & (bridging_error(obs.t[after] - obs.t[before]) > tolerated)
    return before[long], after[long]
