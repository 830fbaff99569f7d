"""Coarse alignment: rotation of any size and delay, from rates.

    R = argmin sum |w_m(t) - R w_s(t + delay)|^2 = U diag(1, 1, det U det V) V^T,   U S V^T = svd(sum w_m w_s^T)

on mean-free rates, at every delay of a fine set; the delay with the largest share of common motion wins and a parabola
through its neighbours refines it. On rates and not on their integrals, which accumulate drift and earth rate.
Source: Wahba 1965 in Markley's SVD form; TD-MA (5) as corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.rig import FloatArray
from stages.align.tracks import Cells, Track, cells, shared_spans

SEARCH_REACH = 1.2  # s, largest delay looked for, either sign
LAG_STEP = 0.1  # s between the delays tried
COARSE_STEP = 0.1  # s, cell of the coarse search
GRAVITY_SHARE = 1e-3  # weight of the gravity pair beside the rates: decides only what the rates leave open
CLOSENESS = 1e-9  # weight of "no rotation": decides only what nothing else decides


@dataclass(frozen=True)
class Coarse:
    """rotation: (3, 3). delay: s. correlation: share of common motion, 0..1. at_edge: the best delay is an end one.

    rms: (2,) rad/s of the mean-free rates of both units.
    """

    rotation: FloatArray
    delay: float
    correlation: float
    at_edge: bool
    rms: tuple[float, float]


def rotation_between(profile: FloatArray) -> tuple[FloatArray, float]:
    """Wahba's rotation (3, 3) and gain trace(R^T B) for an attitude profile B = sum first second^T (3, 3)."""
    u, singular, vt = np.linalg.svd(profile)
    sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return u @ np.diag([1.0, 1.0, sign]) @ vt, float(singular[0] + singular[1] + sign * singular[2])


def search(
    first: Sequence[Track], second: Sequence[Track], shortest: float, step: float, gravity: FloatArray | None = None
) -> Coarse | None:
    """Rotation and delay over the whole range; None when the records share no span. gravity: (3, 3) unit profile."""
    spans = shared_spans(first, second, shortest, (-SEARCH_REACH, SEARCH_REACH))
    if not spans:
        return None
    lags = np.arange(-SEARCH_REACH, SEARCH_REACH + 0.5 * LAG_STEP, LAG_STEP)
    profiles, shares, rms = zip(*(_profile(cells(spans, max(COARSE_STEP, step), lag)) for lag in lags))
    best = int(np.argmax(shares))
    at_edge = best in (0, len(lags) - 1)
    delay = lags[best] if at_edge else lags[best] + LAG_STEP * _vertex(*shares[best - 1 : best + 2])
    anchor = CLOSENESS * np.eye(3) + (0.0 if gravity is None else GRAVITY_SHARE * gravity)
    rotation, _ = rotation_between(profiles[best] + anchor)
    return Coarse(rotation, float(delay), float(shares[best]), at_edge, rms[best])


def _profile(pair: Cells) -> tuple[FloatArray, float, tuple[float, float]]:
    first, second = pair.centred(pair.first), pair.centred(pair.second)
    power = float(np.sum(first**2)), float(np.sum(second**2))
    profile = first.T @ second / max(np.sqrt(power[0] * power[1]), np.finfo(float).tiny)
    size = len(first)
    return profile, rotation_between(profile)[1], (np.sqrt(power[0] / size), np.sqrt(power[1] / size))


def _vertex(left: float, middle: float, right: float) -> float:
    curvature = left - 2.0 * middle + right
    return 0.0 if curvature >= 0.0 else 0.5 * (left - right) / curvature
