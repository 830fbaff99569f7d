"""The 24-state Rodrigues filter of the IDAM paper written with filterpy's classes: slow and plain, matrix by matrix.

Equations (73)-(78) with the errata; model prediction (40), (41) and the correntropy update (50)-(53) around filterpy's
predict and update.
"""

from __future__ import annotations

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy.linalg import expm
from scipy.spatial.transform import Rotation, Slerp

from stages.estimate.rodrigues.filtering import FLOOR, Setup, Tuning
from stages.estimate.rodrigues.inputs import Matching


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def middle(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    return Slerp([0.0, 1.0], Rotation.from_quat([before, after]))(0.5).as_matrix()


def measurement(x: np.ndarray, sums: np.ndarray, W_s: np.ndarray, C_s: np.ndarray, C_m: np.ndarray) -> np.ndarray:
    """h(x) of (78)."""
    l_vector, dv, phi, eps, vr, rate = x[:3], x[3:6], x[6:9], x[9:12], x[15:18], x[21:24]
    plus, minus = np.eye(3) + skew(l_vector), np.eye(3) - skew(l_vector)
    velocity = np.cross(sums[:3], l_vector) + plus @ dv + minus @ vr
    turning = np.cross(sums[3:], l_vector) + plus @ (np.cross(W_s, phi) + C_s @ eps) + minus @ C_m @ rate
    return np.concatenate([velocity, turning])


def jacobian(x: np.ndarray, sums: np.ndarray, W_s: np.ndarray, C_s: np.ndarray, C_m: np.ndarray) -> np.ndarray:
    """Its derivative, term by term."""
    H = np.zeros((6, 24))
    plus, minus = np.eye(3) + skew(x[:3]), np.eye(3) - skew(x[:3])
    H[:3, :3] = skew(sums[:3]) - skew(x[3:6]) + skew(x[15:18])
    H[:3, 3:6], H[:3, 15:18] = plus, minus
    H[3:, :3] = skew(sums[3:]) - skew(np.cross(W_s, x[6:9]) + C_s @ x[9:12]) + skew(C_m @ x[21:24])
    H[3:, 6:9], H[3:, 9:12], H[3:, 21:24] = plus @ skew(W_s), plus @ C_s, minus @ C_m
    return H


def continuous(data: Matching, k: int, damping: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F and G of (74)-(77) in the middle of the interval that ends at sample k."""
    C_m, C_s = middle(data.q_m[k - 1], data.q_m[k]), middle(data.q_s[k - 1], data.q_s[k])
    w, L_0 = skew(data.omega[k]), data.lever_block
    F, G = np.zeros((24, 24)), np.zeros((24, 9))
    F[3:6, 6:9], F[3:6, 12:15] = skew(data.force[k]), C_s
    F[6:9, 9:12] = -C_s
    F[15:18, 18:21] = C_m @ ((w @ w + skew(data.omega_dot[k])) @ L_0 - L_0 @ np.diag(stiffness))
    F[15:18, 21:24] = C_m @ (2.0 * w @ L_0 - 2.0 * L_0 @ np.diag(damping))
    F[18:21, 21:24] = np.eye(3)
    F[21:24, 18:21], F[21:24, 21:24] = -np.diag(stiffness), -2.0 * np.diag(damping)
    G[6:9, :3], G[3:6, 3:6], G[15:18, 6:9], G[21:24, 6:9] = -C_s, C_s, C_m @ L_0, np.eye(3)
    return F, G


def discrete(F: np.ndarray, T: float) -> np.ndarray:
    """I + F T; flexure's own part to second order."""
    out = np.eye(24) + F * T
    own = slice(18, 24)
    out[own, own] = np.eye(6) + F[own, own] * T + F[own, own] @ F[own, own] * (T * T / 2.0)
    return out


class FilterpyRodrigues:
    """One step at a time; l, phi, theta and P are read off ``filter``."""

    def __init__(self, data: Matching, damping: np.ndarray, stiffness: np.ndarray, given: Setup, tuned: Tuning) -> None:
        self.data, self.damping, self.stiffness, self.given, self.tuned = data, damping, stiffness, given, tuned
        self.filter = ExtendedKalmanFilter(dim_x=24, dim_z=6)
        self.filter.x, self.filter.P, self.filter.R = given.x0.copy(), given.P0.copy(), np.diag(given.R)
        self.spectral = np.diag(np.concatenate([np.full(3, given.q[0]), np.full(3, given.q[1]), given.q[2:]]))

    def step(self, k: int) -> None:
        data, ekf, T = self.data, self.filter, float(self.data.dt[k])
        F, G = continuous(data, k, self.damping, self.stiffness)
        ekf.F, ekf.Q = discrete(F, T), G @ self.spectral @ G.T * T
        ekf.Q[6:9, 6:9] += data.jump[k, 0] * np.eye(3)
        ekf.Q[3:6, 3:6] += data.jump[k, 1] * np.eye(3)
        ekf.predict()
        if not data.good[k]:
            return
        args = (data.sums[k], data.W_s[k], middle(data.q_s[k - 1], data.q_s[k]), middle(data.q_m[k - 1], data.q_m[k]))
        H = jacobian(ekf.x, *args)
        C = self._weights(data.z[k] - measurement(ekf.x, *args), H @ ekf.P @ H.T + np.diag(self.given.R))
        R = np.diag(self.given.R / C)
        if self.tuned.mpf_weight > 0.0:
            self._predict_model(H, G * T, R, data.z[k] - measurement(ekf.x, *args), T)
        ekf.update(data.z[k], lambda x: H, lambda x: measurement(x, *args), R=R)

    def _weights(self, v: np.ndarray, S: np.ndarray) -> np.ndarray:
        width = self.tuned.kernel_width
        return np.maximum(np.exp(-(v**2) / (2.0 * width**2 * np.diag(S))), FLOOR) if width > 0.0 else np.ones(6)

    def _predict_model(self, H: np.ndarray, Gamma: np.ndarray, R: np.ndarray, v: np.ndarray, T: float) -> None:
        """(40), (41) as they stand, with the inverse of a 9 x 9 matrix."""
        A = self.tuned.mpf_weight * T * np.linalg.inv(self.spectral)
        B, weight = H @ Gamma, np.linalg.inv(R)
        self.filter.x = self.filter.x + Gamma @ np.linalg.solve(B.T @ weight @ B + A, B.T @ weight @ v)


def exact_flexure_step(damping: float, stiffness: float, T: float) -> np.ndarray:
    """(2, 2) matrix exponential."""
    return expm(np.array([[0.0, 1.0], [-stiffness, -2.0 * damping]]) * T)
