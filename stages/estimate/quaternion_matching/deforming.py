"""How the deformation moves between steps: second-order Markov, random walk, or random walk of the rate.

Each axis has the state (phi, phi'); beside it a static angle walks at random. ``x_k = F x_{k-1} + w``, ``cov w = Q``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physics import flexure
from schemas.rig import FloatArray


@dataclass(frozen=True)
class Deforming:
    """F, Q: (3, N, 2, 2) per axis and step. prior: (3, 2) sigma of (phi, phi'), rad and rad/s.

    static_prior: (3,) rad and static_walk: rad/sqrt(s) of the static angle beside it; 0: there is none.
    """

    F: FloatArray
    Q: FloatArray
    prior: FloatArray
    static_prior: FloatArray
    static_walk: float


def markov(
    damping: FloatArray,
    stiffness: FloatArray,
    std: FloatArray,
    dt: FloatArray,
    static_prior: FloatArray,
    static_walk: float,
) -> Deforming:
    """phi'' + 2 mu phi' + b^2 phi = w plus a static angle (TD-MA 28, 29; MF 20, corrected). Parameters: (3,)."""
    lengths, which = np.unique(np.round(dt, 7), return_inverse=True)
    F = np.stack([flexure.transition(mu, b2, lengths)[which] for mu, b2 in zip(damping, stiffness)])
    Q = np.stack([flexure.noise_covariance(mu, b2, s, lengths)[which] for mu, b2, s in zip(damping, stiffness, std)])
    prior = np.stack([std, np.sqrt(stiffness) * std], axis=1)
    return Deforming(F, Q, prior, static_prior, static_walk)


def walk(density: FloatArray, dt: FloatArray, prior: float) -> Deforming:
    """phi' = w, white with density (3,) rad^2/s per axis."""
    F, Q = np.zeros((3, len(dt), 2, 2)), np.zeros((3, len(dt), 2, 2))
    F[..., 0, 0] = 1.0
    Q[..., 0, 0] = density[:, None] * dt
    return Deforming(F, Q, np.tile([prior, 0.0], (3, 1)), np.zeros(3), 0.0)


def integrated_walk(density: FloatArray, dt: FloatArray, prior: float, rate_prior: FloatArray) -> Deforming:
    """phi'' = w, white with density (3,) rad^2/s^3 per axis; rate_prior: (3,) rad/s."""
    F = np.zeros((3, len(dt), 2, 2))
    F[..., 0, 0] = F[..., 1, 1] = 1.0
    F[..., 0, 1] = dt
    shape = np.stack([np.stack([dt**3 / 3, dt**2 / 2], -1), np.stack([dt**2 / 2, dt], -1)], -2)
    Q = density[:, None, None, None] * shape
    return Deforming(F, Q, np.stack([np.full(3, prior), rate_prior], axis=1), np.zeros(3), 0.0)
