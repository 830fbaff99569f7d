"""The slow drift of the attitude match, taken out without a filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.linalg import solveh_banded

from physics.units import DEG
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.paired import Linearisation, Observations

BREAK_S = 0.1  # s: bridging a longer gap can miss more of the relative rotation than flexure moves meanwhile
LONGER_BREAKS_S = (1.0, np.inf)  # s: gaps that cut the record where shorter ones would leave too little of it
LEAST_SHARE = 0.5  # of the record that pieces must keep
BEARABLE = 1.0 * DEG  # of drift over a record, up to which angles may be taken as small
CALIBRATIONS = 3
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


def drift_of_pieces(obs: Observations) -> FloatArray:
    """:func:`drift_in_m` with the breaks that leave most of the record: many short gaps cut no pieces."""
    for longest in (BREAK_S, *LONGER_BREAKS_S):
        drift = drift_in_m(obs, longest)
        if np.isfinite(drift[:, 0]).mean() >= LEAST_SHARE:
            break
    return drift


def calibrated(observed: Callable[[Linearisation], Observations], at: Linearisation) -> tuple[Observations, FloatArray]:
    """Observations, and the difference of the gyros' biases, (3,) rad/s in m-axes, taken out of the sub-IMU before.

    observed: observations about a linearisation, such as go on across gaps without a jump.

    It is zero unless the match would drift by more than methods for small angles bear, as that of coarse gyros does.
    """
    obs, taken = observed(at), np.zeros(3)
    for _ in range(CALIBRATIONS):
        rate = _drift_rate(obs)
        if np.linalg.norm(rate) * (obs.t[-1] - obs.t[0]) < BEARABLE:
            break
        taken = taken + rate
        obs = observed(replace(at, gyro_bias=at.gyro_bias + at.R_ref.T @ taken))
    return obs, taken


def _drift_rate(obs: Observations) -> FloatArray:
    """(3,) rad/s, eps of :func:`drift_in_m` over the whole record, longer gaps left out."""
    z = np.where((obs.jump_s > BREAK_S)[:, None], np.nan, obs.z)
    if np.isfinite(z[:, 0]).sum() < 10:
        return np.zeros(3)
    return _solved(z, _columns(np.swapaxes(obs.A_end, 1, 2), obs.A_integral))[3:]


def _fitted(z: FloatArray, A_T: FloatArray, A_integral: FloatArray) -> FloatArray:
    columns = _columns(A_T, A_integral)
    return np.asarray(columns @ _solved(z, columns))


def _columns(A_T: FloatArray, A_integral: FloatArray) -> FloatArray:
    """(N, 3, 6) of d_0 and eps."""
    return np.concatenate([A_T, A_T @ np.cumsum(A_integral, axis=0)], axis=2)


def _solved(z: FloatArray, columns: FloatArray) -> FloatArray:
    """(6,) d_0 and eps."""
    change, shown = np.diff(columns, axis=0), np.diff(z, axis=0)
    seen = np.isfinite(shown[:, 0])
    matrix = change[seen].reshape(-1, 6)
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
    return np.asarray(np.linalg.lstsq(matrix / scale, shown[seen].reshape(-1), rcond=1e-6)[0] / scale)


def slow_part(t: FloatArray, x: FloatArray, breaks: IntArray, knot_s: float) -> FloatArray:
    """x (N, c) at t (N,) s by least squares as straight lines between knots at least knot_s apart; anew at breaks."""
    out = np.empty_like(x)
    for first, last in zip([0, *breaks], [*breaks, len(t)]):
        piece = slice(int(first), int(last))
        out[piece] = _polyline(t[piece], x[piece], knot_s)
    return out


def _polyline(t: FloatArray, x: FloatArray, knot_s: float) -> FloatArray:
    length = t[-1] - t[0]
    if len(t) < 3 or length <= 0.0:
        return x
    count = max(int(length / knot_s), 1)
    place = (t - t[0]) / length * count
    left = np.minimum(place.astype(int), count - 1)
    weight = place - left
    normal, right = np.zeros((2, count + 1)), np.zeros((count + 1, x.shape[1]))
    for share, k in ((1.0 - weight, left), (weight, left + 1)):
        normal[1] += np.bincount(k, share**2, count + 1)
        for c in range(x.shape[1]):
            right[:, c] += np.bincount(k, share * x[:, c], count + 1)
    normal[0, 1:] = np.bincount(left, weight * (1.0 - weight), count)
    node = solveh_banded(normal, right)
    return np.asarray((1.0 - weight)[:, None] * node[left] + weight[:, None] * node[left + 1])
