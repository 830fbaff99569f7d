"""Functions of arc length: cubic B-splines for curvature with their smoothness prior, hats for the flexure's share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

from schemas.rig import FloatArray

KNOT = 1.0  # m between knots, unless the path would need more than MOST or fewer than FEWEST intervals
FEWEST, MOST = 20, 100
LEVEL_STD = 1e-2  # rad/m: a curvature beyond any deck, keeps the prior proper
SHARE_KNOTS = 6  # hats along the path
SHARE_STD = 1.0  # of the flexure's share


@dataclass(frozen=True)
class CurveBasis:
    """Cubic B-splines on uniform knots over [low, high] (m)."""

    low: float
    high: float

    @property
    def intervals(self) -> int:
        """Number of knot intervals."""
        return int(np.clip(round((self.high - self.low) / KNOT), FEWEST, MOST))

    @property
    def step(self) -> float:
        """Knot spacing, m."""
        return (self.high - self.low) / self.intervals

    @property
    def knots(self) -> FloatArray:
        """(intervals + 7,) m."""
        return np.asarray(self.low + self.step * np.arange(-3, self.intervals + 4), dtype=np.float64)

    @property
    def size(self) -> int:
        """Number of splines."""
        return self.intervals + 3

    def matrix(self, s: FloatArray) -> csr_array:
        """Values (n, size) of the splines at arc lengths s (n,)."""
        return csr_array(BSpline.design_matrix(np.clip(s, self.low, self.high), self.knots, 3))

    def turned(self, coefficients: FloatArray, s: FloatArray) -> FloatArray:
        """Angle (n, k) turned from s = 0 to s by curvature coefficients (size, k)."""
        whole = BSpline(self.knots, coefficients, 3).antiderivative()
        inside = np.clip(s, self.low, self.high)
        return np.asarray(whole(inside) - whole(np.clip(0.0, self.low, self.high)))

    def precision(self, log_psd: FloatArray) -> FloatArray:
        """Prior precision (size, size): k'' is white with PSD exp(log_psd) at the inner splines (size - 2,).

        The integrated Wiener process whose posterior mean is a cubic smoothing spline (Wahba, J. R. Stat. Soc. B 40,
        1978), on B-splines (Eilers and Marx, Stat. Sci. 11, 1996); its intensity changes along the path.
        """
        bend = np.diff(np.eye(self.size), n=2, axis=0) / self.step**2
        weighted = bend * (self.step * np.exp(-log_psd))[:, None]
        return np.asarray(bend.T @ weighted + np.eye(self.size) / LEVEL_STD**2)

    def log_psd(self, smooth: FloatArray) -> FloatArray:
        """log PSD of k'' (size - 2,) = log(q0 + q1 exp(-(s - low)/l) + q2 exp(-(high - s)/l)), smooth = logs of them.

        Decks bend most at their edges, so each end has its own intensity, dying away over the same length l.
        """
        s = self.low + self.step * np.arange(self.intervals + 1)
        q0, q1, q2, length = np.asarray(smooth)
        inward, outward = s - self.low, self.high - s
        scale = np.exp(length)
        return np.asarray(np.logaddexp(q0, np.logaddexp(q1 - inward / scale, q2 - outward / scale)))


@dataclass(frozen=True)
class ShareBasis:
    """Piecewise linear functions over [low, high] (m): the share of the sub-IMU's flexure that the sled feels."""

    low: float
    high: float

    @property
    def knots(self) -> FloatArray:
        """(SHARE_KNOTS,) m."""
        return np.linspace(self.low, self.high, SHARE_KNOTS)

    def matrix(self, s: FloatArray) -> FloatArray:
        """Values (n, SHARE_KNOTS) at arc lengths s (n,)."""
        width = (self.high - self.low) / (SHARE_KNOTS - 1)
        inside = np.clip(s, self.low, self.high)
        return np.asarray(np.maximum(0.0, 1.0 - np.abs(inside[:, None] - self.knots) / width))

    def slope(self, share: FloatArray, s: FloatArray) -> FloatArray:
        """Slope (n,) 1/m at s (n,) of the share with values (knots,), over one hat's width."""
        half = 0.5 * (self.knots[1] - self.knots[0])
        a, b = np.clip(s - half, self.low, self.high), np.clip(s + half, self.low, self.high)
        return np.asarray((np.interp(b, self.knots, share) - np.interp(a, self.knots, share)) / (b - a))

    def precision(self, log_wiggle: float) -> FloatArray:
        """Prior precision: second differences of std exp(log_wiggle), level of std ``SHARE_STD``."""
        bend = np.diff(np.eye(SHARE_KNOTS), n=2, axis=0)
        return np.asarray(np.exp(-2.0 * log_wiggle) * bend.T @ bend + np.eye(SHARE_KNOTS) / SHARE_STD**2)
