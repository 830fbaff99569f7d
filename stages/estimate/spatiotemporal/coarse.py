"""Coarse alignment by quaternion optimisation.

    beta(t) = q * alpha(t) * q^-1,   K = int D^T D dt,   D = L(beta) - R(alpha)

and q the eigenvector of the least eigenvalue of K: Davenport's solution of Wahba's problem (TD-MA 5-7). As printed
alpha and beta are the integrals of the rates since the start: earth rate and bias grow in them, so that the answer gets
worse with time. By default they are the rates themselves, averaged over a cell and free of their mean (erratum of 5).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from physics.matching import Unit
from physics.rotations import skew
from physics.units import ARCMIN, DEG
from schemas.errors import DataError
from schemas.products import BoolArray
from schemas.rig import FloatArray
from stages.paired import Paired

CELL_S = 0.2  # s, over which rates are averaged
CLOSENESS = 1e-9  # weight of "no rotation": decides only what the motion leaves open
LEAST_CELLS = 20
BLOCK_CELLS = 50  # 10 s: longer than the residual rates remember
INFLATION = 2.0  # on the standard deviation of the coarse alignment
STD_FLOOR = 1.0 * ARCMIN
STD_CEILING = 10.0 * DEG  # and what an alignment on integrals is given, whose residuals say nothing about its error


@dataclass(frozen=True)
class Coarse:
    """rotation: (3, 3) R_m_s. std: (3,) rad, cautious, in m-axes."""

    rotation: FloatArray
    std: FloatArray


class Vectors(StrEnum):
    """What the quaternion optimisation matches."""

    RATES = "rates"
    INTEGRALS = "integrals"


def quaternion_optimisation(beta: FloatArray, alpha: FloatArray) -> FloatArray:
    """Rotation (3, 3) with ``beta ~ R alpha``, vectors (n, 3), by the least eigenvalue of K (4, 4)."""
    difference, total = beta - alpha, beta + alpha
    D = np.zeros((len(beta), 4, 4))
    D[:, 0, 1:], D[:, 1:, 0] = -difference, difference
    D[:, 1, 2], D[:, 1, 3], D[:, 2, 3] = -total[:, 2], total[:, 1], -total[:, 0]
    D[:, 2, 1], D[:, 3, 1], D[:, 3, 2] = total[:, 2], -total[:, 1], total[:, 0]
    K = np.einsum("nji,njk->ik", D, D)
    K += CLOSENESS * max(float(np.trace(K)), np.finfo(float).tiny) * np.diag([0.0, 1.0, 1.0, 1.0])
    scalar, *vector = np.linalg.eigh(K)[1][:, 0]
    return np.asarray(Rotation.from_quat([*vector, scalar]).as_matrix())


def coarse_alignment(paired: Paired, delay: float, vectors: Vectors, end: float) -> Coarse:
    """R_m_s from the motion up to time ``end`` (s), the sub-IMU read ``delay`` later.

    Raises DataError when the two units share too little of it.
    """
    main, sub = paired.main, paired.sub
    edges = np.arange(max(main.t[0], sub.t[0] - delay), min(main.t[-1], sub.t[-1] - delay, end), CELL_S)
    if len(edges) < LEAST_CELLS:
        raise DataError(f"the two units share less than {LEAST_CELLS * CELL_S:.0f} s: no coarse alignment")
    beta, alpha = _turned(main, edges), _turned(sub, edges + delay)
    if vectors is Vectors.INTEGRALS:
        rotation = quaternion_optimisation(beta[1:] - beta[0], alpha[1:] - alpha[0])
        return Coarse(rotation, np.full(3, STD_CEILING))
    seen = ~(_bridged(main, edges) | _bridged(sub, edges + delay))
    first, second = (_centred(np.diff(angle, axis=0)[seen]) for angle in (beta, alpha))
    rotation = quaternion_optimisation(first, second)
    return Coarse(rotation, _spread(first, second @ rotation.T))


def _centred(rates: FloatArray) -> FloatArray:
    return np.asarray(rates - rates.mean(axis=0)) if len(rates) else rates


def _spread(beta: FloatArray, turned: FloatArray) -> FloatArray:
    """(3,) rad: sandwich standard deviation of the rotation; scores summed over blocks, for residuals are coloured."""
    score = np.cross(turned, beta - turned)
    blocks = np.add.reduceat(score, np.arange(0, len(score), BLOCK_CELLS)) if len(score) else score
    cross = skew(turned)
    information = np.einsum("nji,njk->ik", cross, cross)
    bread = np.linalg.inv(information + np.finfo(float).eps ** 2 * np.eye(3))
    free = len(blocks) - 3  # three angles were fitted: few blocks say too little of their spread
    if free <= 0:
        return np.full(3, STD_CEILING)
    meat = blocks.T @ blocks * (len(blocks) / free)
    std = INFLATION * np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0))
    return np.clip(np.nan_to_num(std, nan=STD_CEILING), STD_FLOOR, STD_CEILING)


def _turned(unit: Unit, edges: FloatArray) -> FloatArray:
    """(k, 3) rad, integral of the rate components since the start, at ``edges`` (k,)."""
    steps = np.diff(unit.t, prepend=unit.t[0])
    angle = np.cumsum(unit.gyro * steps[:, None], axis=0)
    return np.stack([np.interp(edges, unit.t, angle[:, i]) for i in range(3)], axis=1)


def _bridged(unit: Unit, edges: FloatArray) -> BoolArray:
    """(k - 1,) bool, cells that hold a sample which was put in."""
    count = np.interp(edges, unit.t, np.cumsum(unit.filled))
    return np.asarray(np.diff(count) > 0, dtype=bool)
