"""From curvature curves to the product: comparison with a design and limits, and the deformed line."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from physics.rotations import exp
from schemas.products import BoolArray, DeckPass
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.shape.track import Pass, Track

Design = Callable[[FloatArray], FloatArray] | FloatArray | None
SIGNIFICANT = 3.0  # std: a smaller excess is not told from noise
NO_LIMIT = (np.inf, np.inf, np.inf)


def design_curve(design: Design, s: FloatArray) -> FloatArray | None:
    """Design curvature (n, 3) rad/m at arc lengths s (n,).

    design: a function of s; or rows s, about x, about y, about z (m, 4), interpolated; or one constant triple; or None.
    """
    if design is None:
        return None
    if callable(design):
        return np.asarray(design(s), dtype=float)
    table = np.asarray(design, dtype=float)
    if table.shape == (3,):
        return np.tile(table, (len(s), 1))
    if table.ndim != 2 or table.shape[1] != 4:
        raise ValueError("a design curve is a function, a triple, or rows of arc length and three curvatures")
    return np.stack([np.interp(s, table[:, 0], table[:, i]) for i in (1, 2, 3)], axis=-1)


def exceeds(curvature: FloatArray, std: FloatArray, design: FloatArray | None, limit: FloatArray) -> BoolArray:
    """(n, 3): |k - k_design| > limit and > 3 std, all (n, 3) rad/m but limit (3,)."""
    apart = np.abs(curvature - (0.0 if design is None else design))
    return np.asarray((apart > limit) & (apart > SIGNIFICANT * std))


def deck_pass(
    run: Pass,
    track: Track,
    stamp: IntArray,
    s: FloatArray,
    curvature: FloatArray,
    std: FloatArray,
    design: Design,
    limit: FloatArray,
) -> DeckPass:
    """One run's product from its curvature (n, 3) at stamps (n,) ns and arc lengths s (n,)."""
    over = exceeds(curvature, std, design_curve(design, s), limit)
    return DeckPass(run.index, run.forward, stamp, s, track.position(s), curvature, std, over)


def deformed_line(track: Track, s: FloatArray, curvature: FloatArray) -> FloatArray:
    """Line (k, 3) m, deck frame, of a straight path bent by curvature (k, 3) rad/m at s (k,).

    dR/ds = [k x] R, dp/ds = R t0 in hull axes, by exact rotations over each step; the result is turned so that its
    chord is the measured one, because curvature says nothing of where the path starts or how it points.
    """
    step = np.diff(s)[:, None]
    turns = exp(0.5 * (curvature[1:] + curvature[:-1]) * step)
    heading = np.empty((len(s), 3))
    heading[0] = track.direction
    for i, turn in enumerate(turns):
        heading[i + 1] = turn @ heading[i]
    bent = np.vstack([np.zeros(3), np.cumsum(0.5 * (heading[1:] + heading[:-1]) * step, axis=0)])
    ends = track.position(s[[0, -1]])
    return np.asarray(ends[0] + bent @ _onto(bent[-1], ends[1] - ends[0]).T)


def _onto(a: FloatArray, b: FloatArray) -> FloatArray:
    """Smallest rotation (3, 3) that turns direction a (3,) into b (3,)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = float(np.linalg.norm(axis))
    return exp(axis / sine * np.arctan2(sine, float(a @ b))) if sine > 0.0 else np.eye(3)
