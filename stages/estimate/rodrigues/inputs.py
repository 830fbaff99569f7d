"""What the 24-state filter is fed: both units in their inertial frames, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from physics.rotations import skew
from schemas.products import Alignment, BoolArray
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial
from stages.drift import calibrated
from stages.estimate.rodrigues.lever import LeverArm, lever_arm
from stages.paired import Linearisation, Observations, Paired, observe, pair

GAP_RATE = 0.05  # rad/s^3: rate jerk of a lively ship, which bridging a gap with straight lines leaves out
GAP_ANGLE = 5e-3  # rad, of longer gaps: the angle between the units is held there, and only flexure changes it
GAP_FORCE = 2.0  # m/s^4, likewise of specific force
GAP_SHAKE = 0.01  # (m/s)/sqrt(s), of the lever arm that flexure shakes meanwhile
GAP_FORCE_LIMIT = 2.0  # m/s^2


@dataclass(frozen=True)
class Matching:
    """n samples on the main IMU's axis, the sub-IMU's delay taken out.

    stamp: (n,) ns. t: (n,) s. dt: (n,) s, 0 at the first. good: (n,) bool, measured by both. jump: (n, 2) rad^2 and
    m^2/s^2, what bridging a gap that ends here may have missed. q_m, q_s: (n, 4) x, y, z, w of A_m, A_s. omega,
    omega_dot: (n, 3) mean rate of the main unit over the interval, m-axes, rad/s, and its change, rad/s^2. force:
    (n, 3) m/s^2, mean specific force of the sub in i_s. W_s: (n, 3) rad/s, its mean rate in i_s. z: (n, 6) measurement
    of (78), m/s and rad/s; sums: (n, 6) the sums in it. lever: r. index: (N,) the steps of the rest of the pipeline.
    bias: (3,) rad/s in m-axes, taken out of the sub-IMU's rates before.
    """

    stamp: IntArray
    t: FloatArray
    dt: FloatArray
    good: BoolArray
    jump: FloatArray
    q_m: FloatArray
    q_s: FloatArray
    omega: FloatArray
    omega_dot: FloatArray
    force: FloatArray
    W_s: FloatArray
    z: FloatArray
    sums: FloatArray
    lever: LeverArm
    index: IntArray
    bias: FloatArray

    @property
    def lever_block(self) -> FloatArray:
        """(3, 3) L_0 of (56): ``L_0 theta = theta x r``."""
        return np.asarray(-skew(self.lever.value))


def matching(trial: Trial, alignment: Alignment) -> Matching:
    """Both units of a trial, integrated and paired. DataError when they hardly overlap."""
    paired = pair(trial, alignment)
    obs, bias = calibrated(partial(observe, paired), Linearisation.at(alignment))
    return _matching(trial, paired, obs, alignment.rotation, lever_arm(obs, trial.rig), bias)


def _matching(
    trial: Trial, paired: Paired, obs: Observations, R_0: FloatArray, lever: LeverArm, bias: FloatArray
) -> Matching:
    t = obs.t
    dt = np.diff(t, prepend=t[0])
    # The sub's path was handed over turned into i_m by R_0; the filter wants it in its own inertial frame.
    back = Rotation.from_matrix(R_0).inv()
    A_m, A_s = Rotation.from_quat(obs.main.attitude), back * Rotation.from_quat(obs.sub.attitude)
    V_s = back.apply(obs.sub.velocity)
    first = int(np.searchsorted(paired.main.t, t[0]))
    omega = paired.main.gyro[first : first + len(t)]
    at_stamps = instantaneous(omega)
    carried = A_m.apply(np.cross(at_stamps, lever.value))
    V_m = obs.main.velocity + carried - carried[0]
    W_m, W_s = _mean_rates(A_m, dt), _mean_rates(A_s, dt)
    return Matching(
        stamp=trial.epoch + np.rint(t * 1e9).astype(np.int64), t=t, dt=dt, good=obs.good, jump=_jumps(obs),
        q_m=A_m.as_quat(), q_s=A_s.as_quat(), omega=omega, omega_dot=_rate_of(at_stamps, dt), force=_rate_of(V_s, dt),
        W_s=W_s, z=np.concatenate([V_s - V_m, W_s - W_m], axis=1),
        sums=np.concatenate([V_s + V_m, W_s + W_m], axis=1), lever=lever, index=obs.index, bias=bias,
    )  # fmt: skip


def instantaneous(means: FloatArray) -> FloatArray:
    """Values (n, 3) at the stamps from means over the intervals that end there; exact for cubics but at the ends.

    ``(-x[k-1] + 7 x[k] + 7 x[k+1] - x[k+2]) / 12``.
    """
    x = np.concatenate([means[:1], means, means[-1:], means[-1:]])
    values = (-x[:-3] + 7.0 * x[1:-2] + 7.0 * x[2:-1] - x[3:]) / 12.0
    values[-1] = 1.5 * means[-1] - 0.5 * means[-2]
    return values


def _rate_of(values: FloatArray, dt: FloatArray) -> FloatArray:
    rate = np.zeros_like(values)
    rate[1:] = np.diff(values, axis=0) / dt[1:, None]
    return rate


def _mean_rates(A: Rotation, dt: FloatArray) -> FloatArray:
    """(n, 3) rad/s in inertial axes, ``Log(A_k A_{k-1}^T) / dt``."""
    rates = np.zeros((len(dt), 3))
    rates[1:] = (A[1:] * A[:-1].inv()).as_rotvec() / dt[1:, None]
    return rates


def _jumps(obs: Observations) -> FloatArray:
    """(n, 2): variances of what was missed of rotation and velocity in the gap that ends at a sample."""
    jump = np.zeros((len(obs.t), 2))
    good = np.flatnonzero(obs.good)
    ends, starts = good[1:], good[:-1]
    gap = np.where(ends - starts > 1, obs.t[ends] - obs.t[starts], 0.0)
    jump[ends, 0] = np.minimum(GAP_RATE * gap**3, GAP_ANGLE) ** 2
    velocity = np.hypot(GAP_FORCE * gap**3, GAP_SHAKE * np.sqrt(gap))
    jump[ends, 1] = np.minimum(velocity, GAP_FORCE_LIMIT * gap) ** 2
    return jump
