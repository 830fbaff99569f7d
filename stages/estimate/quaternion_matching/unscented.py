"""Online network trained by an unscented Kalman filter, compiled.

    z = s g(u, W) + A_m^T d - omega_m delay + v,   g(u, W) = W_out tanh(W_in u + b_in) + b_out   (MF 10-19, TD-MA 36-42)

W walks at random; d, eps and delay move as in :mod:`stages.estimate.quaternion_matching.linear`. Everything but tanh is
linear, so that only the update needs sigma points: scaled, redrawn after the prediction (R. van der Merwe, 2004).
Angles are carried in arcminutes: the covariances stay near one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from physics.units import ARCMIN
from schemas.rig import FloatArray
from stages.estimate.quaternion_matching.linear import BIAS_WALK, Noise, drift_walk, turning_integral
from stages.paired import Observations

NEURONS = 3  # l
WEIGHTS_PRIOR = 1.0
OUTPUT_SCALE = 60.0 * ARCMIN  # rad, s
R_STD = 0.02 * ARCMIN  # rad per step
ALPHA, BETA, KAPPA = 0.1, 2.0, 0.0  # of the sigma points
LINEAR = 7  # d, eps, delay


@dataclass(frozen=True)
class Trained:
    """x: (N, n) means, the last LINEAR of them d (rad, i-axes), eps (rad/s), delay (s). P: (N, 7, 7) of these.

    deformation: (N, 3) rad, what the network puts out. innovation: (N, 3), normalised; NaN where nothing was measured.
    """

    x: FloatArray
    P: FloatArray
    deformation: FloatArray
    innovation: FloatArray


def weights(neurons: int) -> int:
    """Number of weights, 7 l + 3."""
    return 7 * neurons + 3


def start(neurons: int) -> FloatArray:
    """(7 l + 3,) initial weights: small and all different, for equal neurons would stay equal."""
    return np.asarray(0.5 * np.sin(1.0 + 2.0 * np.arange(weights(neurons))))


def train(
    obs: Observations, z: FloatArray, inputs: FloatArray, density: float, noise: Noise, neurons: int = NEURONS
) -> Trained:
    """Filter all steps. z: (N, 3) rad in m-axes. inputs: (N, 3) u. density: rad^2/s of the random walk that the walking
    weights make of each component of the output."""
    x0 = np.concatenate([start(neurons), np.zeros(LINEAR)])
    linear = [*noise.d_prior / ARCMIN, *np.full(3, noise.bias_prior / ARCMIN), noise.delay_prior]
    prior = np.concatenate([np.full(weights(neurons), WEIGHTS_PRIOR), linear]) ** 2
    share = density / (1.0 + neurons) / OUTPUT_SCALE**2
    walk = np.zeros((len(z), len(x0)))
    walk[:, : weights(neurons)] = (share * obs.dt)[:, None]
    walk[:, -7:-4] = drift_walk(obs, noise) / ARCMIN**2
    walk[:, -4:-1] = ((BIAS_WALK * noise.bias_prior / ARCMIN) ** 2 * obs.dt)[:, None]
    x, P, g, innovation = unscented_filter(
        np.nan_to_num(inputs), z / ARCMIN, np.ascontiguousarray(np.swapaxes(obs.A_end, 1, 2)), turning_integral(obs),
        obs.rate_m / ARCMIN, walk, (R_STD / ARCMIN) ** 2, OUTPUT_SCALE / ARCMIN, x0, np.diag(prior), neurons,
        np.array([ALPHA, BETA, KAPPA]),
    )  # fmt: skip
    units = np.array([*np.full(6, ARCMIN), 1.0])
    x[:, -LINEAR:] *= units
    return Trained(x, P * units[:, None] * units, g * ARCMIN, innovation)


@njit(cache=True, nogil=True)
def network(u: FloatArray, x: FloatArray, neurons: int, out: FloatArray) -> None:
    """g(u, W) into out (3,); x begins with W_in (l, 3), b_in (l,), W_out (3, l), b_out (3,)."""
    b_in, w_out, b_out = 3 * neurons, 4 * neurons, 7 * neurons
    for i in range(3):
        out[i] = x[b_out + i]
    for j in range(neurons):
        hidden = np.tanh(x[3 * j] * u[0] + x[3 * j + 1] * u[1] + x[3 * j + 2] * u[2] + x[b_in + j])
        for i in range(3):
            out[i] += x[w_out + i * neurons + j] * hidden


@njit(cache=True, nogil=True)
def _measure(
    u: FloatArray, x: FloatArray, A_T: FloatArray, rate: FloatArray, scale: float, neurons: int, out: FloatArray
) -> None:
    network(u, x, neurons, out)
    n = len(x)
    for i in range(3):
        out[i] = scale * out[i] - rate[i] * x[n - 1]
        for j in range(3):
            out[i] += A_T[i, j] * x[n - 7 + j]


@njit(cache=True, nogil=True)
def _root(P: FloatArray, factor: float, L: FloatArray) -> None:
    """Lower Cholesky factor of factor * P; a pivot that rounding made negative counts as zero."""
    n = P.shape[0]
    for j in range(n):
        pivot = factor * P[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        L[j, j] = np.sqrt(pivot) if pivot > 0.0 else 0.0
        for i in range(j + 1, n):
            value = factor * P[i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            L[i, j] = value / L[j, j] if L[j, j] > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _solve(L: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """L^-1 b of a lower triangle (3, 3); out may be b."""
    for i in range(3):
        value = b[i]
        for j in range(i):
            value -= L[i, j] * out[j]
        out[i] = value / L[i, i]


@njit(cache=True, nogil=True)
def _correct(x: FloatArray, P: FloatArray, root: FloatArray, cross: FloatArray, nu: FloatArray) -> None:
    """x += G nu, P -= G G^T with G = P_xz C^-T and S = C C^T; cross is used up."""
    n = len(x)
    for r in range(n):
        _solve(root, cross[r], cross[r])
        for i in range(3):
            x[r] += cross[r, i] * nu[i]
    for r in range(n):
        for c in range(r + 1):
            value = 0.5 * (P[r, c] + P[c, r])
            for i in range(3):
                value -= cross[r, i] * cross[c, i]
            P[r, c] = P[c, r] = value


@njit(cache=True, nogil=True)
def _predict(x: FloatArray, P: FloatArray, A_int: FloatArray, walk: FloatArray) -> None:
    n = len(x)
    d, eps = n - 7, n - 4
    for i in range(3):
        for j in range(3):
            x[d + i] += A_int[i, j] * x[eps + j]
            for c in range(n):
                P[d + i, c] += A_int[i, j] * P[eps + j, c]
    for i in range(3):
        for j in range(3):
            for r in range(n):
                P[r, d + i] += A_int[i, j] * P[r, eps + j]
    for i in range(n):
        P[i, i] += walk[i]


@njit(cache=True, nogil=True)
def unscented_filter(
    inputs: FloatArray, z: FloatArray, A_T: FloatArray, A_int: FloatArray, rate: FloatArray, walk: FloatArray,
    R: float, scale: float, x0: FloatArray, P0: FloatArray, neurons: int, spread: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Means (N, n), covariances (N, 7, 7) of the last seven, outputs of the network and normalised innovations (N, 3).

    inputs, z, rate: (N, 3), NaN in z: nothing measured. A_T, A_int: (N, 3, 3). walk: (N, n) variances that are added.
    spread: alpha, beta, kappa.
    """
    steps, n = walk.shape
    excess = spread[0] ** 2 * (n + spread[2]) - n
    W = 0.5 / (n + excess)
    W_mean, W_cov = excess / (n + excess), excess / (n + excess) + 1.0 - spread[0] ** 2 + spread[1]
    x, P = x0.copy(), P0.copy()
    L, sigma = np.zeros((n, n)), np.zeros(n)
    h, mean, cross, S = np.zeros((2 * n + 1, 3)), np.zeros(3), np.zeros((n, 3)), np.zeros((3, 3))
    root = np.zeros((3, 3))
    xs, Ps, g, nu = np.zeros((steps, n)), np.zeros((steps, 7, 7)), np.zeros((steps, 3)), np.full((steps, 3), np.nan)
    for k in range(steps):
        _predict(x, P, A_int[k], walk[k])
        if not np.isnan(z[k, 0]):
            _root(P, n + excess, L)
            for j in range(2 * n + 1):
                side, column = (1.0 if j <= n else -1.0), (j - 1) % n
                for i in range(n):
                    sigma[i] = x[i] + side * L[i, column] if j > 0 else x[i]
                _measure(inputs[k], sigma, A_T[k], rate[k], scale, neurons, h[j])
            _moments(h, L, W, W_mean, W_cov, R, mean, S, cross)
            _root(S, 1.0, root)
            for i in range(3):
                mean[i] = z[k, i] - mean[i]
            _solve(root, mean, nu[k])
            _correct(x, P, root, cross, nu[k])
        for i in range(n):
            xs[k, i] = x[i]
        for i in range(7):
            for j in range(7):
                Ps[k, i, j] = P[n - 7 + i, n - 7 + j]
        network(inputs[k], x, neurons, g[k])
    return xs, Ps, scale * g, nu


@njit(cache=True, nogil=True)
def _moments(
    h: FloatArray, L: FloatArray, W: float, W_mean: float, W_cov: float, R: float,
    mean: FloatArray, S: FloatArray, cross: FloatArray,
) -> None:  # fmt: skip
    """Mean and covariance of the predicted measurement and its covariance with the state."""
    n = L.shape[0]
    for i in range(3):
        mean[i] = W_mean * h[0, i]
        for j in range(1, 2 * n + 1):
            mean[i] += W * h[j, i]
    for i in range(3):
        for c in range(3):
            S[i, c] = W_cov * (h[0, i] - mean[i]) * (h[0, c] - mean[c])
            for j in range(1, 2 * n + 1):
                S[i, c] += W * (h[j, i] - mean[i]) * (h[j, c] - mean[c])
        S[i, i] += R
        for r in range(n):
            cross[r, i] = 0.0
            for j in range(r + 1):
                cross[r, i] += W * L[r, j] * (h[1 + j, i] - h[1 + n + j, i])
