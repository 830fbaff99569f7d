"""The 24-state filter, compiled: prediction, model prediction (MPF), maximum-correntropy update (MCE).

State (IDAM 73): ``[l, dV, phi, eps, nabla, V_r, theta, theta']``, three each; see the package for the equations. F
has few entries beside its unit diagonal, so ``F P F^T`` is a handful of row and column additions; the update is one
Cholesky factor of 6 x 6 and ``P - W^T W``, symmetric by construction.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from physics.compiled import put

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

L, DV, PHI, EPS, NABLA, VR, THETA, RATE = 0, 3, 6, 9, 12, 15, 18, 21
SIZE, SEEN = 24, 6
WHAT = 9  # kept of the state at each sample: l, phi, theta


@njit(cache=True, nogil=True)
def _matrix(q: FloatArray, out: FloatArray) -> None:
    x, y, z, w = q[0], q[1], q[2], q[3]
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


@njit(cache=True, nogil=True)
def _middle(before: FloatArray, after: FloatArray, out: FloatArray) -> None:
    """Matrix of the attitude half way between two that are close, on one half of the quaternion sphere."""
    q = before + after if np.dot(before, after) >= 0.0 else after - before
    _matrix(q / np.sqrt(np.dot(q, q)), out)


@njit(cache=True, nogil=True)
def _skew(v: FloatArray, out: FloatArray) -> None:
    out[0, 0], out[0, 1], out[0, 2] = 0.0, -v[2], v[1]
    out[1, 0], out[1, 1], out[1, 2] = v[2], 0.0, -v[0]
    out[2, 0], out[2, 1], out[2, 2] = -v[1], v[0], 0.0


@njit(cache=True, nogil=True)
def _times(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True, nogil=True)
def _lever_blocks(
    C_m: FloatArray, omega: FloatArray, omega_dot: FloatArray, L0: FloatArray, damping: FloatArray,
    stiffness: FloatArray, A: FloatArray,
) -> None:  # fmt: skip
    """A[0] = C_m A_r1, A[1] = C_m A_r2, A[2] = C_m L0 (55), (56), (76)."""
    turning, change, inner, rate = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    _skew(omega, turning)
    _skew(omega_dot, change)
    _times(turning, turning, inner)
    inner += change
    _times(inner, L0, change)
    _times(turning, L0, rate)
    for i in range(3):
        for j in range(3):
            change[i, j] -= L0[i, j] * stiffness[j]
            rate[i, j] = 2.0 * rate[i, j] - 2.0 * L0[i, j] * damping[j]
    _times(C_m, change, A[0])
    _times(C_m, rate, A[1])
    _times(C_m, L0, A[2])


@njit(cache=True, nogil=True)
def _flexure_steps(damping: FloatArray, stiffness: FloatArray, T: float, F: FloatArray) -> None:
    """(3, 2, 2): exp(M T) of (theta, theta') to second order, of which b T << 1 leaves nothing over."""
    for a in range(3):
        mu, b2, half = damping[a], stiffness[a], 0.5 * T * T
        F[a, 0, 0], F[a, 0, 1] = 1.0 - b2 * half, T - 2.0 * mu * half
        F[a, 1, 0], F[a, 1, 1] = -b2 * T + 2.0 * mu * b2 * half, 1.0 - 2.0 * mu * T + (4.0 * mu * mu - b2) * half


@njit(cache=True, nogil=True)
def _advance(M: FloatArray, T: float, f: FloatArray, C_s: FloatArray, A: FloatArray, F: FloatArray) -> None:
    """M (24, k) := F M in place; rows are used before they change."""
    turn = np.empty((3, 3))
    _skew(f, turn)
    for i in range(3):
        dv, vr = M[DV + i], M[VR + i]
        for j in range(3):
            dv += T * turn[i, j] * M[PHI + j] + T * C_s[i, j] * M[NABLA + j]
            vr += T * A[0, i, j] * M[THETA + j] + T * A[1, i, j] * M[RATE + j]
    for i in range(3):
        phi = M[PHI + i]
        for j in range(3):
            phi -= T * C_s[i, j] * M[EPS + j]
        theta, rate = M[THETA + i].copy(), M[RATE + i].copy()
        put(M[THETA + i], F[i, 0, 0] * theta + F[i, 0, 1] * rate)
        put(M[RATE + i], F[i, 1, 0] * theta + F[i, 1, 1] * rate)


@njit(cache=True, nogil=True)
def _add_noise(P: FloatArray, T: float, C_mL0: FloatArray, q: FloatArray, jump: FloatArray) -> None:
    """P += G Q G^T T (77); q: (5,) w_g, w_a and the three of w_f. jump: (2,) rad^2 and m^2/s^2 for a bridged gap."""
    for i in range(3):
        P[PHI + i, PHI + i] += q[0] * T + jump[0]
        P[DV + i, DV + i] += q[1] * T + jump[1]
        P[RATE + i, RATE + i] += q[2 + i] * T
        for j in range(3):
            share = C_mL0[i, j] * q[2 + j] * T
            P[VR + i, RATE + j] += share
            P[RATE + j, VR + i] += share
            for k in range(3):
                P[VR + i, VR + k] += share * C_mL0[k, j]


@njit(cache=True, nogil=True)
def _measure(
    x: FloatArray, sums: FloatArray, W_s: FloatArray, C_s: FloatArray, C_m: FloatArray, h: FloatArray, H: FloatArray
) -> None:
    """h(x) (6,) of (78) and its Jacobian H (6, 24), the terms of d/dl among them."""
    plus, minus, block = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    _skew(x[L : L + 3], plus)
    for i in range(3):
        for j in range(3):
            unit = 1.0 if i == j else 0.0
            minus[i, j] = unit - plus[i, j]
            plus[i, j] += unit
    _skew(W_s, block)
    error = block @ x[PHI : PHI + 3] + C_s @ x[EPS : EPS + 3]
    flexure = C_m @ x[RATE : RATE + 3]
    _times(plus, block, H[3:, PHI : PHI + 3])
    _times(plus, C_s, H[3:, EPS : EPS + 3])
    _times(minus, C_m, H[3:, RATE : RATE + 3])
    for i in range(3):
        put(H[i, DV : DV + 3], plus[i])
        put(H[i, VR : VR + 3], minus[i])
    velocity = x[DV : DV + 3] - x[VR : VR + 3]
    _skew(sums[:3] - velocity, H[:3, L : L + 3])
    _skew(sums[3:] - (error - flexure), H[3:, L : L + 3])
    _skew(sums[:3], block)
    put(h[:3], block @ x[L : L + 3] + plus @ x[DV : DV + 3] + minus @ x[VR : VR + 3])
    _skew(sums[3:], block)
    put(h[3:], block @ x[L : L + 3] + plus @ error + minus @ flexure)


@njit(cache=True, nogil=True)
def _cholesky(S: FloatArray) -> None:
    """Lower factor of (m, m) in place; the upper triangle is left as it was."""
    m = S.shape[0]
    for i in range(m):
        for j in range(i + 1):
            total = S[i, j]
            for k in range(j):
                total -= S[i, k] * S[j, k]
            S[i, j] = np.sqrt(total) if i == j else total / S[j, j]


@njit(cache=True, nogil=True)
def _forward(S: FloatArray, rows: FloatArray) -> None:
    """rows (m, k) := chol(S)^-1 rows in place."""
    for i in range(S.shape[0]):
        row = rows[i]
        for j in range(i):
            row -= S[i, j] * rows[j]
        row /= S[i, i]


@njit(cache=True, nogil=True)
def _backward(S: FloatArray, v: FloatArray) -> None:
    """v (m,) := chol(S)^-T v in place."""
    m = S.shape[0]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            v[i] -= S[j, i] * v[j]
        v[i] /= S[i, i]


@njit(cache=True, nogil=True)
def _weights(v: FloatArray, spread: FloatArray, width: float, floor: float, C: FloatArray) -> None:
    """Correntropy weights (53): exp(-v^2 / (2 width^2 spread)), at least floor; 1 where width is 0."""
    for i in range(SEEN):
        C[i] = max(np.exp(-0.5 * v[i] * v[i] / (width * width * spread[i])), floor) if width > 0.0 else 1.0


@njit(cache=True, nogil=True)
def _predict_model(
    x: FloatArray, v: FloatArray, H: FloatArray, T: float, C_s: FloatArray, C_mL0: FloatArray, q: FloatArray,
    weight: float, R: FloatArray,
) -> None:  # fmt: skip
    """MPF (40), (41): x += Gamma D with D = A^-1 B^T (B A^-1 B^T + R)^-1 v, B = H Gamma, Gamma = G T.

    A^-1 = Q / (T weight), the inversion lemma applied to (40).
    """
    Gamma = np.zeros((SIZE, 9))
    for i in range(3):
        for j in range(3):
            Gamma[PHI + i, j] = -T * C_s[i, j]
            Gamma[DV + i, 3 + j] = T * C_s[i, j]
            Gamma[VR + i, 6 + j] = T * C_mL0[i, j]
        Gamma[RATE + i, 6 + i] = T
    B = H @ Gamma
    spread = np.empty((9, SEEN))
    for a in range(9):
        put(spread[a], B[:, a] * (q[max(a // 3, a - 4)] / (T * weight)))
    S = B @ spread
    for i in range(SEEN):
        S[i, i] += R[i]
    _cholesky(S)
    y = v.copy()
    _forward(S, y.reshape(SEEN, 1))
    _backward(S, y)
    x += Gamma @ (spread @ y)


@njit(cache=True, nogil=True)
def _update(
    x: FloatArray, P: FloatArray, HP: FloatArray, S: FloatArray, v: FloatArray, C: FloatArray, printed: bool
) -> None:
    """x, P after the measurement; S = H P H^T + R C^-1 is overwritten. printed: covariance (51), not symmetric."""
    _cholesky(S)
    y = v.copy()
    _forward(S, y.reshape(SEEN, 1))
    W = HP.copy()
    _forward(S, W)
    for i in range(SEEN):
        x += W[i] * y[i]
    if printed:
        gain = W.copy()
        for j in range(SIZE):
            column = gain[:, j].copy()
            _backward(S, column)
            put(gain[:, j], column * C)
        P -= HP.T @ gain
        return
    for i in range(SIZE):
        row = P[i]
        for k in range(SEEN):
            row -= W[k, i] * W[k]


@njit(cache=True, nogil=True)
def _total_covariance(x: FloatArray, P: FloatArray, A_m: FloatArray, out: FloatArray) -> None:
    """(3, 3) of the error of ``A_m^T C(l)^T Exp(phi) A_s``: J P J^T with J = A_m^T [2 (I + [l x])/(1 + l^2), C^T]."""
    l2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    q = np.array([x[0], x[1], x[2], 1.0]) / np.sqrt(1.0 + l2)
    J, C_T, onto = np.empty((3, 6)), np.empty((3, 3)), np.empty((3, 3))
    _matrix(q, C_T)
    _skew(x[:3], onto)
    for i in range(3):
        onto[i, i] += 1.0
    onto *= 2.0 / (1.0 + l2)
    by_l, by_phi = A_m.T @ onto, A_m.T @ C_T
    for i in range(3):
        put(J[i, :3], by_l[i])
        put(J[i, 3:], by_phi[i])
    block = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            block[i, j] = P[i if i < 3 else i + 3, j if j < 3 else j + 3]
    found = J @ block @ J.T
    for i in range(3):
        put(out[i], found[i])


@njit(cache=True, nogil=True)
def run(
    dt: FloatArray, q_m: FloatArray, q_s: FloatArray, omega: FloatArray, omega_dot: FloatArray, force: FloatArray,
    W_s: FloatArray, z: FloatArray, sums: FloatArray, good: BoolArray, jump: FloatArray, L0: FloatArray,
    damping: FloatArray, stiffness: FloatArray, q: FloatArray, R: FloatArray, x0: FloatArray, P0: FloatArray,
    mpf_weight: float, width: float, floor: float, printed: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Filter n samples. Returns l, phi, theta (n, 9); covariance of the total (n, 3, 3); innovations and their variance
    (n, 6), NaN where not measured; last x (24,) and P (24, 24). mpf_weight, width of 0 switch MPF and MCE off."""
    n = len(dt)
    kept, covariance = np.empty((n, WHAT)), np.empty((n, 3, 3))
    innovation, variance = np.full((n, SEEN), np.nan), np.full((n, SEEN), np.nan)
    x, P = x0.copy(), P0.copy()
    C_m, C_s, A, F = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3)), np.empty((3, 2, 2))
    h, H, C, v, S_ii = np.empty(SEEN), np.zeros((SEEN, SIZE)), np.ones(SEEN), np.empty(SEEN), np.empty(SEEN)
    for k in range(n):
        if k > 0:
            T = dt[k]
            _middle(q_m[k - 1], q_m[k], C_m)
            _middle(q_s[k - 1], q_s[k], C_s)
            _lever_blocks(C_m, omega[k], omega_dot[k], L0, damping, stiffness, A)
            _flexure_steps(damping, stiffness, T, F)
            _advance(x.reshape(SIZE, 1), T, force[k], C_s, A, F)
            _advance(P, T, force[k], C_s, A, F)
            P = P.T.copy()
            _advance(P, T, force[k], C_s, A, F)
            _add_noise(P, T, A[2], q, jump[k])
        if k > 0 and good[k]:
            _measure(x, sums[k], W_s[k], C_s, C_m, h, H)
            put(v, z[k] - h)
            HP = H @ P
            S = HP @ H.T
            for i in range(SEEN):
                S_ii[i] = S[i, i] + R[i]
            put(innovation[k], v)
            put(variance[k], S_ii)
            _weights(v, R if printed else S_ii, width, floor, C)
            if mpf_weight > 0.0:
                _predict_model(x, v, H, T, C_s, A[2], q, mpf_weight, R if printed else R / C)
                _measure(x, sums[k], W_s[k], C_s, C_m, h, H)
                put(v, z[k] - h)
            for i in range(SEEN):
                S[i, i] += R[i] / C[i]
            _update(x, P, HP, S, v, C, printed)
        put(kept[k, :3], x[L : L + 3])
        put(kept[k, 3:6], x[PHI : PHI + 3])
        put(kept[k, 6:], x[THETA : THETA + 3])
        _matrix(q_m[k], C_m)
        _total_covariance(x, P, C_m, covariance[k])
    return kept, covariance, innovation, variance, x, P
