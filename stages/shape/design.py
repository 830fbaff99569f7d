"""Rows of the joint regression: the sled's samples averaged over short blocks, with all their regressors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.shape.basis import CurveBasis, ShareBasis
from stages.shape.flexure import Flexure
from stages.shape.rates import Reference
from stages.shape.regression import Run
from stages.shape.robust import hampel
from stages.shape.samples import Sled

BLOCK = 0.2  # s averaged into one row
LONGEST = 600  # rows of one run: slower runs get longer blocks
ROTATION_STD = 2e-2  # rad, left after Wahba
SCALE_STD = 2e-3
DELAY_STD = 0.05  # s


@dataclass(frozen=True)
class Calibration:
    """What is renewed between refinements: R_m_c (3, 3), delay s, curvature (size, 3) and share (knots, 3)."""

    R_m_c: FloatArray
    delay: float
    curvature: FloatArray
    share: FloatArray


@dataclass(frozen=True)
class Layout:
    """Columns of X: curvature splines, share of flexure (none without theta), 3 rates, delay, bias."""

    curve: CurveBasis
    share: ShareBasis | None
    bias_std: float

    @property
    def shares(self) -> slice:
        """Columns of the share."""
        return slice(self.curve.size, self.curve.size + (0 if self.share is None else len(self.share.knots)))

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.shares.stop + 5

    def precision(self, axis: int, prior: FloatArray) -> FloatArray:
        """Prior precision (size, size); prior: logs of q0, q1, q2, l of the curve and of the share's wiggle."""
        P, n = np.zeros((self.size, self.size)), self.curve.size
        P[:n, :n] = self.curve.precision(self.curve.log_psd(prior[:4]))
        if self.share is not None:
            P[self.shares, self.shares] = self.share.precision(float(prior[4]))
        turn = np.full(3, ROTATION_STD)
        turn[axis] = SCALE_STD
        rest = np.arange(self.shares.stop, self.size)
        P[rest, rest] = np.concatenate([turn, [DELAY_STD, self.bias_std]]) ** -2.0
        return P


@dataclass(frozen=True)
class Rows:
    """Block means of all three axes.

    y: (n, 3) rad/s. curve: (n, size). share: (3, n, knots). rate, slope: (n, 3). t: (n,) s. count: (n,) samples.
    run: (n,) index. good: (samples,) those that went in.
    """

    y: FloatArray
    curve: FloatArray
    share: FloatArray
    rate: FloatArray
    slope: FloatArray
    t: FloatArray
    count: FloatArray
    run: IntArray
    good: BoolArray

    def axis(self, i: int) -> list[Run]:
        """Regression of axis i, one piece a run."""
        X = np.column_stack([self.curve, self.share[i], self.rate, -self.slope[:, i], np.ones(len(self.t))])
        cuts = np.flatnonzero(np.diff(self.run)) + 1
        pieces = np.split(np.arange(len(self.t)), cuts)
        return [Run(self.y[p, i], X[p], self.t[p], self.count[p]) for p in pieces]

    @property
    def order(self) -> IntArray:
        """Index of the run of each piece that :meth:`axis` yields."""
        return self.run[np.concatenate([[0], np.flatnonzero(np.diff(self.run)) + 1])]


def rows(sled: Sled, main: Reference, bent: Flexure | None, layout: Layout, state: Calibration) -> Rows:
    """Block means of the rate difference and its regressors; samples off their local spread are left out."""
    begin, end = sled.unit.begin - state.delay, sled.unit.end - state.delay
    w_m = main.mean(begin, end)
    apart = sled.unit.rate @ state.R_m_c.T - w_m
    good = main.covered(begin, end) & ~hampel(apart).any(axis=1)
    if bent is not None:
        good &= bent.covered(begin, end)
    share, angle = _share(sled, bent, layout, state)
    angle = angle + layout.curve.turned(state.curvature, sled.s)
    mean, which = _blocks(sled, good)
    curve = layout.curve.matrix(sled.s) * sled.speed[:, None]
    return Rows(
        y=mean @ (apart - np.cross(w_m, angle)),
        curve=(mean @ csr_array(curve)).toarray(),
        share=np.stack([mean @ part for part in share]),
        rate=mean @ w_m,
        slope=mean @ main.slope(begin, end),
        t=mean @ sled.unit.end,
        count=np.diff(mean.indptr).astype(float),
        run=which,
        good=good,
    )


def _share(sled: Sled, bent: Flexure | None, layout: Layout, state: Calibration) -> tuple[list[FloatArray], FloatArray]:
    """Per axis, mean rate of each hat times theta (n, knots); flexure angle (n, 3) at the sled so far."""
    n = len(sled.stamp)
    if bent is None or layout.share is None:
        return [np.zeros((n, 0))] * 3, np.zeros((n, 3))
    u = sled.unit
    theta0, theta1 = bent.angle(u.begin - state.delay), bent.angle(u.end - state.delay)
    hats0, hats1 = layout.share.matrix(sled.s0), layout.share.matrix(sled.s1)
    length = (u.end - u.begin)[:, None]
    share = [(hats1 * theta1[:, i, None] - hats0 * theta0[:, i, None]) / length for i in range(3)]
    return share, 0.5 * (hats0 + hats1) @ state.share * 0.5 * (theta0 + theta1)


def _blocks(sled: Sled, good: BoolArray) -> tuple[csr_array, IntArray]:
    """Averaging matrix (blocks, samples) over the good samples, and the run (blocks,) of each block."""
    use = np.flatnonzero(good)
    t, run = sled.unit.end[use], sled.run[use]
    first = np.concatenate([[True], np.diff(run) > 0])
    start, group = t[first], np.cumsum(first) - 1
    last = t[np.concatenate([np.flatnonzero(first)[1:] - 1, [len(t) - 1]])]
    length = np.maximum(BLOCK, (last - start) / LONGEST)
    place = np.floor((t - start[group]) / length[group] + 1e-6).astype(np.int64)
    fresh = np.concatenate([[True], (np.diff(place) != 0) | (np.diff(run) != 0)])
    pointer = np.concatenate([np.flatnonzero(fresh), [len(use)]])
    weight = 1.0 / np.repeat(np.diff(pointer), np.diff(pointer))
    return csr_array((weight, use, pointer), shape=(len(pointer) - 1, len(good))), run[fresh]
