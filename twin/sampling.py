"""From continuous motion to samples: interval means of rate and specific force of the three places on the ship."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics import quaternions
from physics.units import ARCMIN
from twin.bending import LeverPath
from twin.motion import Motion

FloatArray = NDArray[np.float64]

FINEST = 0.005  # s, longest step of the quadrature of specific force


@dataclass(frozen=True)
class Body:
    """A unit at the nodes of a slab: q_i_b (n, 4) attitude against i, force (n, 3) m/s^2 in its own axes."""

    q_i_b: FloatArray
    force: FloatArray


def substeps(rate: float, cutoff: float) -> int:
    """Nodes per sample interval, even: at most 5 ms apart and 20 to a period of the lever arm's band."""
    longest = min(FINEST, 1.0 / (20.0 * cutoff))
    return 2 * max(1, int(np.ceil(0.5 / (rate * longest) - 1e-9)))


def main_body(motion: Motion) -> Body:
    """The main IMU."""
    return Body(motion.q_i_m, motion.specific_force)


def sub_body(motion: Motion, theta: FloatArray, phi: FloatArray, arm: FloatArray, lever: LeverPath) -> Body:
    """The sub-IMU, R_m_s = Exp(theta) Exp(Phi), at rho = r + theta_f x r from the main IMU.

    f_s = R_s_m (f_m + omega' x rho + omega x (omega x rho) + 2 omega x rho' + rho''), theta_f the flexure within the
    lever arm's band; gravity is that of the main IMU's place. theta, phi: (n, 3) rad. arm: (3,) m.
    """
    shift, rate, acceleration = lever.at(motion.t)
    r = np.broadcast_to(arm, shift.shape)
    force = force_at(
        motion, arm + quaternions.cross(shift, r), quaternions.cross(rate, r), quaternions.cross(acceleration, r)
    )
    q_m_s = quaternions.multiply(quaternions.exp(theta), quaternions.exp(phi))
    return Body(quaternions.multiply(motion.q_i_m, q_m_s), quaternions.rotate(quaternions.conjugate(q_m_s), force))


def force_at(motion: Motion, place: FloatArray, velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Specific force (n, 3) in m-axes at a place (n, 3) that moves in m with velocity and acceleration (n, 3)."""
    cross, omega = quaternions.cross, motion.omega
    rigid = cross(motion.omega_dot, place) + cross(omega, cross(omega, place))
    return motion.specific_force + rigid + 2.0 * cross(omega, velocity) + acceleration


def mean_rate(q_i_b: FloatArray, t: FloatArray) -> FloatArray:
    """Log(R(t_{k-1})^T R(t_k)) / (t_k - t_{k-1}), (n, 3) rad/s, exact, from attitudes (n + 1, 4) at edges t."""
    turn = quaternions.log(quaternions.multiply(quaternions.conjugate(q_i_b[:-1]), q_i_b[1:]))
    return turn / np.diff(t)[:, None]


def mean_force(force: FloatArray, per_sample: int) -> FloatArray:
    """Composite Simpson means (n, 3) over intervals of ``per_sample`` (even) steps, nodes (n per_sample + 1, 3)."""
    n = (len(force) - 1) // per_sample
    weight = np.tile([2.0, 4.0], per_sample // 2)
    weight[0] = 1.0
    inner = np.einsum("j,njk->nk", weight, force[:-1].reshape(n, per_sample, 3))
    return (inner + force[per_sample::per_sample]) / (3.0 * per_sample)


def static_angle(arcmin: tuple[float, float, float], n: int) -> FloatArray:
    """Phi (n, 3) rad, constant."""
    return np.broadcast_to(np.array(arcmin) * ARCMIN, (n, 3))
