"""Correlation of the forcing of the flexure's axes, from the cross-spectra of the rate residual.

    S_ij(w) = rho_ij sqrt(q_i q_j) / (D_i(w) D_j*(w)),  D_i = b_i^2 - w^2 + 2 i mu_i w,  q_i = 4 mu_i b_i^2 sigma_i^2

sampled, aliases summed. The spectra of the axes themselves are held at their fit; L = -sum (ln det S + tr S^-1 I).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from schemas.rig import FloatArray
from stages.diagnose.spectral_data import SHARE, ComplexArray, Grid, Spectra
from stages.diagnose.spectral_fit import Fit

PAIRS = ((0, 1), (0, 2), (1, 2))
NAMES = ("xy", "xz", "yz")
ALIASES = 6  # on either side: what is left out is 1e-4 of the spectrum at half the sample rate
STEP = 3e-4  # of a correlation, of the numeric second derivative
EDGE = 0.999  # of a correlation


@dataclass(frozen=True)
class Coupling:
    """rho: (3,) xy xz yz, beyond the twin's. std: (3,). evidence_nats: on the halves held out."""

    rho: FloatArray
    std: FloatArray
    evidence_nats: float


def coupling(data: Spectra, halves: tuple[Fit, Fit], whole: Fit) -> Coupling:
    """Correlations with their evidence, given fits of the axes' own spectra to the halves and to all data."""
    known = np.array(whole.model.twin.flexure.correlation)
    evidence = 0.0
    for k, fit in enumerate(halves):
        rho = _Likelihood(data.half(k), fit, known).maximum()[0]
        other = _Likelihood(data.half(1 - k), fit, known)
        evidence += other(rho) - other(np.zeros(3))
    rho, covariance = _Likelihood(data, whole, known).maximum()
    return Coupling(rho, np.sqrt(np.maximum(np.diag(covariance), 0.0)), float(evidence))


class _Likelihood:
    """Log-likelihood of correlations rho (3,) added to the twin's."""

    def __init__(self, data: Spectra, fit: Fit, known: FloatArray) -> None:
        data = fit.model.data(data)
        shares = data.share.mean(axis=0)
        weight = SHARE * data.count.sum(axis=0)
        part = data.count / np.maximum(data.count.sum(axis=0), 1e-300)
        self.power = (data.power * part[..., None, None]).sum(axis=0)
        self.weight, self.known = weight, known
        self.diagonal = np.stack([fit.model.spectrum(fit.x, axis, shares) for axis in range(3)])
        self.cross = [_cross(fit, i, j, shares) for i, j in PAIRS]

    def __call__(self, rho: FloatArray) -> float:
        total = np.clip(self.known + rho, -EDGE, EDGE)
        S = np.zeros_like(self.power)
        for axis in range(3):
            S[..., axis, axis] = self.diagonal[axis]
        for (i, j), value, shape in zip(PAIRS, total, self.cross):
            S[..., i, j], S[..., j, i] = value * shape, value * shape.conj()
        determinant = np.linalg.det(S).real / np.prod(self.diagonal, axis=0)
        if determinant.min() <= 1e-9:
            return -np.inf
        fitted = np.einsum("...ij,...ji->...", np.linalg.inv(S), self.power).real
        return -float(np.sum(self.weight * (np.log(determinant) + fitted)))

    def maximum(self) -> tuple[FloatArray, FloatArray]:
        """The best rho and its covariance."""
        nothing = self(np.zeros(3))
        found = minimize(lambda rho: min(nothing - self(rho), 1e12), np.zeros(3), method="Nelder-Mead",
                         options={"xatol": 1e-4, "fatol": 1e-3, "initial_simplex": _SIMPLEX})  # fmt: skip
        return found.x, np.asarray(np.linalg.pinv(self._information(found.x), hermitian=True), dtype=float)

    def _information(self, rho: FloatArray) -> FloatArray:
        basis = STEP * np.eye(3)
        value = lambda i, j, a, b: self(rho + a * basis[i] + b * basis[j])  # noqa: E731
        return np.array([[-(value(i, j, 1, 1) - value(i, j, 1, -1) - value(i, j, -1, 1) + value(i, j, -1, -1))
                          / (4.0 * STEP**2) for j in range(3)] for i in range(3)])  # fmt: skip


_SIMPLEX = np.concatenate([np.zeros((1, 3)), 0.05 * np.eye(3)])


def _cross(fit: Fit, i: int, j: int, shares: FloatArray) -> ComplexArray:
    """Cross-spectrum (g, k) of full correlation as Hann segments see it."""
    grid, model = fit.model.grid, fit.model
    bare = _sampled(fit.x, i, j, grid)
    out = []
    for share in shares:
        gain = np.ones(len(grid.points))
        for effect in model.acting(fit.x):
            gain *= np.sqrt(_gain(effect, i, grid, share) * _gain(effect, j, grid, share))
        out.append(grid.seen(bare * gain))
    return np.stack(out)


def _gain(effect, axis: int, grid: Grid, share: float) -> FloatArray:  # type: ignore[no-untyped-def]
    """What an effect multiplies a spectrum by; what it adds drops out."""
    one = np.ones(len(grid.points))
    more = effect.flexure_density(axis, grid.points, grid.interval, 2.0 * one, share)
    return np.asarray(more - effect.flexure_density(axis, grid.points, grid.interval, one, share))


def _sampled(x: FloatArray, i: int, j: int, grid: Grid) -> ComplexArray:
    T, w = grid.interval, grid.points
    damping, stiffness, std = np.exp(x[:3]), np.exp(x[3:6]), np.exp(x[6:9])
    q = 4.0 * damping * stiffness * std**2
    total = np.zeros(len(w), dtype=complex)
    for alias in range(-ALIASES, ALIASES + 1):
        c = (w + 2.0 * np.pi * alias) / T
        D = [stiffness[k] - c**2 + 2j * damping[k] * c for k in (i, j)]
        total += 1.0 / (D[0] * D[1].conj())
    return np.sqrt(q[i] * q[j]) * total * 4.0 * np.sin(0.5 * w) ** 2 / T**3
