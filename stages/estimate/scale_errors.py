"""How large the scale factors and the non-orthogonality of the gyros are, learnt from the record.

The filter's end holds the posterior of the errors e of both units, given a prior sigma of each. From it follows the
marginal likelihood of the record under any other prior S, without a further run: with ``Lambda = P^-1 - S_0^-1`` and
``eta = P^-1 e``

    ln p(S) = -1/2 ln |I + W Lambda W| + 1/2 (W eta)^T (I + W Lambda W)^-1 (W eta),   W^2 = S

Learnt by it, under a weak hyper-prior, are a factor on the usual sizes of all errors and, about that, one for scale
factors and one for axes of either unit. The directions that the motion shows decide; what it does not show stays as
uncertain as what it shows is large.
"""

from __future__ import annotations

import numpy as np

from schemas.products import BoolArray
from schemas.rig import FloatArray

SPREAD, APART = 1.2, 0.5  # natural-log sigmas of the common factor and of the others about it; their mean square is one
GRID = np.linspace(-5.0, 5.0, 31)  # natural logs of a factor
LEAST = 1e-9


def sizes(
    mean: FloatArray, covariance: FloatArray, prior: FloatArray, usual: FloatArray, free: BoolArray
) -> FloatArray:
    """(2, 3, 3) prior sigmas of the sub-IMU's and of the main gyro's errors, learnt.

    mean (18,), covariance (18, 18): posterior of both units' errors, sub first, each row-major. prior: (2, 3, 3) sigmas
    that went in. usual: (2, 3, 3), on which the factors act. free: (4,) which of them are learnt: scale factors and
    axes of the sub-IMU, then of the main one.
    """
    sigma = np.maximum(prior.ravel(), LEAST)
    information, shown = _information(mean / sigma, covariance / np.outer(sigma, sigma))
    members, width = _members(), usual.ravel() / sigma
    common = members[free].any(axis=0)
    for group, spread in ((common, SPREAD), *[(members[k], APART) for k in np.flatnonzero(free)]):
        widths = width * np.where(group, np.exp(GRID)[:, None], 1.0)
        weight = _log_marginal(information, shown, widths) - 0.5 * (GRID / spread + spread) ** 2
        weight = np.exp(weight - weight.max())
        width = np.where(group, width * np.sqrt(weight @ np.exp(2.0 * GRID) / weight.sum()), width)
    return np.asarray(width * sigma).reshape(2, 3, 3)


def _members() -> BoolArray:
    """(4, 18) which errors each factor acts on."""
    diagonal, nothing = np.eye(3, dtype=bool).ravel(), np.zeros(9, bool)
    return np.array([
        np.concatenate(row)
        for row in ([diagonal, nothing], [~diagonal, nothing], [nothing, diagonal], [nothing, ~diagonal])
    ])  # fmt: skip


def _information(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lambda and eta in units of the prior sigmas; what rounding makes of nothing is nothing."""
    inverse = np.linalg.inv(0.5 * (covariance + covariance.T))
    values, vectors = np.linalg.eigh(0.5 * (inverse + inverse.T) - np.eye(len(mean)))
    return (vectors * np.maximum(values, 0.0)) @ vectors.T, inverse @ mean


def _log_marginal(information: FloatArray, shown: FloatArray, widths: FloatArray) -> FloatArray:
    """(k,) up to a constant, for k sets of prior sigmas (k, 18)."""
    B = np.eye(len(shown)) + widths[:, :, None] * information * widths[:, None, :]
    y = widths * shown
    solved = np.linalg.solve(B, y[..., None])[..., 0]
    return np.asarray(-0.5 * np.linalg.slogdet(B)[1] + 0.5 * np.sum(y * solved, axis=1))
