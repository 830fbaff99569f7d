"""A straight line through values of unequal certainty that scatter more than their own standard deviations say.

    y_i = value + slope (x_i - centre) + u_i + e_i,   e_i ~ N(0, std_i^2),   u_i ~ N(0, excess^2)

Voyages differ by more than each one's own uncertainty (loading, sea, temperature), so the excess is estimated with the
line, by restricted maximum likelihood; the standard deviations of the line are never smaller than the residuals allow.
Sources: Searle, Casella, McCulloch, Variance Components (1992), section 6.6 (restricted likelihood); Knapp and Hartung,
Statistics in Medicine 22 (2003) 2693-2710, eq. 4 (scaled variance), applied only where it widens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t as student

from schemas.rig import FloatArray

FEWEST = 3  # points that a line with its excess can be fitted to
CONFIDENCE = 0.95
NO_EXCESS = 1e-6  # of the scatter: below it, the excess is called zero


@dataclass(frozen=True)
class Line:
    """centre: where value holds, the weighted mean of x. excess: standard deviation beyond the points' own.

    slope_ci95: (low, high) by Student's t with count - 2 degrees of freedom. p_value: of a slope of zero. chi2: of the
    points about the line by their own standard deviations alone, dof degrees of freedom. All NaN below FEWEST points or
    where x does not vary.
    """

    count: int
    centre: float
    value: float
    value_std: float
    slope: float
    slope_std: float
    slope_ci95: tuple[float, float]
    p_value: float
    excess: float
    chi2: float
    dof: int

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The line at x, and its standard deviation there (value and slope are uncorrelated at the centre)."""
        away = np.asarray(x, dtype=float) - self.centre
        return self.value + self.slope * away, np.hypot(self.value_std, self.slope_std * away)


def fitted(x: FloatArray, y: FloatArray, std: FloatArray) -> Line:
    """The line through y (n,) with their standard deviations std (n,) at x (n,); what is not finite is left out."""
    x, y, std = (np.asarray(values, dtype=float) for values in (x, y, std))
    good = np.isfinite(x) & np.isfinite(y) & np.isfinite(std) & (std >= 0)
    x, y, std = x[good], y[good], std[good]
    if len(x) < FEWEST or np.ptp(x) == 0.0:
        return unknown(len(x))
    scale_x, scale_y = float(np.std(x)), float(np.ptp(y)) or 1.0
    design = np.stack([np.ones(len(x)), (x - x.mean()) / scale_x], axis=1)
    unit_y, unit_std = (y - y.mean()) / scale_y, np.maximum(std / scale_y, 1e-9)
    excess = _excess(design, unit_y, unit_std)
    return _line(x, y, std, np.hypot(unit_std, excess) * scale_y, excess * scale_y)


def unknown(count: int) -> Line:
    """No line: too few points, or all at one place."""
    nan = float("nan")
    return Line(count, nan, nan, nan, nan, nan, (nan, nan), nan, nan, nan, max(count - 2, 0))


def _line(x: FloatArray, y: FloatArray, std: FloatArray, spread: FloatArray, excess: float) -> Line:
    weight = spread**-2.0
    centre = float(np.sum(weight * x) / np.sum(weight))
    away, dof = x - centre, len(x) - 2
    value = float(np.sum(weight * y) / np.sum(weight))
    slope = float(np.sum(weight * away * y) / np.sum(weight * away**2))
    rest = y - value - slope * away
    widened = np.sqrt(max(1.0, float(np.sum(weight * rest**2)) / dof))
    slope_std = widened / np.sqrt(np.sum(weight * away**2))
    reach = float(student.ppf(0.5 + 0.5 * CONFIDENCE, dof)) * slope_std
    own = np.maximum(std, 1e-9 * (float(np.ptp(y)) or 1.0))
    return Line(
        count=len(x),
        centre=centre,
        value=value,
        value_std=float(widened / np.sqrt(np.sum(weight))),
        slope=slope,
        slope_std=float(slope_std),
        slope_ci95=(float(slope - reach), float(slope + reach)),
        p_value=float(2.0 * student.sf(abs(slope) / slope_std, dof)),
        excess=excess,
        chi2=float(np.sum((rest / own) ** 2)),
        dof=dof,
    )


def _excess(design: FloatArray, y: FloatArray, std: FloatArray) -> float:
    """The standard deviation beyond the points' own that makes the restricted likelihood largest; 0 where it may be."""
    most = 2.0 * float(np.std(y)) + 1e-12
    if most <= 2e-12:
        return 0.0
    low, high = np.log(NO_EXCESS * most), np.log(most)
    starts = np.linspace(low, high, 13)
    losses = [_restricted(np.exp(log), design, y, std) for log in starts]
    best = int(np.argmin(losses))
    bounds = (starts[max(best - 1, 0)], starts[min(best + 1, len(starts) - 1)])
    found = minimize_scalar(
        lambda log: _restricted(np.exp(log), design, y, std), bounds=bounds, method="bounded", options={"xatol": 1e-7}
    )
    none = _restricted(0.0, design, y, std)
    return 0.0 if none <= found.fun + 1e-9 else float(np.exp(found.x))


def _restricted(excess: float, design: FloatArray, y: FloatArray, std: FloatArray) -> float:
    """Minus the restricted log-likelihood, constants left out."""
    variance = std**2 + excess**2
    normal = design.T @ (design / variance[:, None])
    solution = np.linalg.solve(normal, design.T @ (y / variance))
    rest = y - design @ solution
    return 0.5 * float(np.sum(np.log(variance)) + np.linalg.slogdet(normal)[1] + np.sum(rest**2 / variance))
