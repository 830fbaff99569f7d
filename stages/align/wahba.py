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
from stages.align.tracks import Span, Track, shared_spans

LAG_STEP = 0.1  # s between the delays tried
LAGS = 12  # of them on either side of none
SEARCH_REACH = LAGS * LAG_STEP  # s, largest delay looked for, either sign
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
    """Rotation and delay over the whole range; None when the records share no span. gravity: (3, 3) unit profile.

    step: length of the cells, s, a multiple of LAG_STEP.
    """
    spans = shared_spans(first, second, shortest, (-SEARCH_REACH, SEARCH_REACH))
    if not spans:
        return None
    lags = LAG_STEP * np.arange(-LAGS, LAGS + 1)
    products, powers = (sum(part) for part in zip(*(_moments(span, step) for span in spans)))
    size = sum(span.count(step) for span in spans)
    profiles, shares, rms = zip(*(_profile(*moments, size) for moments in zip(products, powers)))
    best = int(np.argmax(shares))
    at_edge = best in (0, len(lags) - 1)
    delay = lags[best] if at_edge else lags[best] + LAG_STEP * _vertex(*shares[best - 1 : best + 2])
    anchor = CLOSENESS * np.eye(3) + (0.0 if gravity is None else GRAVITY_SHARE * gravity)
    rotation, _ = rotation_between(profiles[best] + anchor)
    return Coarse(rotation, float(delay), float(shares[best]), at_edge, rms[best])


def _moments(span: Span, step: float) -> tuple[FloatArray, FloatArray]:
    """Per lag, sums over the cells of a span: first second^T (l, 3, 3), powers of both (l, 2); rates mean-free."""
    count, stride = span.count(step), round(step / LAG_STEP)
    first = span.first.rate(span.start, step, count)
    first -= first.mean(axis=0)
    turned = span.second.turned(span.start - LAGS * LAG_STEP, LAG_STEP, 2 * LAGS + count * stride + 1)
    second = (turned[stride:] - turned[:-stride]) / step  # over cells that begin every LAG_STEP
    shifted = [second[lag::stride][:count] for lag in range(2 * LAGS + 1)]
    power = [(np.sum(first**2), np.sum(part**2) - count * np.sum(part.mean(axis=0) ** 2)) for part in shifted]
    return np.array([first.T @ part for part in shifted]), np.array(power)


def _profile(profile: FloatArray, power: FloatArray, size: int) -> tuple[FloatArray, float, tuple[float, float]]:
    profile = profile / max(np.sqrt(power[0] * power[1]), np.finfo(float).tiny)
    first, second = np.sqrt(power / size)
    return profile, rotation_between(profile)[1], (float(first), float(second))


def _vertex(left: float, middle: float, right: float) -> float:
    curvature = left - 2.0 * middle + right
    return 0.0 if curvature >= 0.0 else 0.5 * (left - right) / curvature
