"""Nuisances: what a twin may be wrong about without there being a gap, as regressors with priors.

Biases, static angle, PHINS installation, the amplitude of slow bending, and how flexure moves the lever arm, which is a
property of the ship and in no twin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, detrend, lfilter, sosfiltfilt
from scipy.spatial.transform import Rotation

from physics import quaternions
from physics.flexure import driven
from physics.units import ARCMIN, DEG_PER_HOUR, MICRO_G
from schemas.products import FlexureModel
from schemas.rig import FloatArray
from stages.diagnose.columns import Response, trapezoid_means
from stages.diagnose.view import Believed, foretold, log_view, longest_step
from stages.paired import Linearisation, Observations
from twin import effects
from twin.effects._prediction import OnAxis, Signals, on_axis
from twin.effects.heel_bending import LAG as LAG_OF_HEEL

GYRO_BIAS = 0.05 * DEG_PER_HOUR  # how far a twin's figure may be off without being a gap, one sigma
ACCEL_BIAS = 50.0 * MICRO_G
STATIC = 1.0 * ARCMIN
INSTALLATION = 2.0 * ARCMIN
TOLERANCES = {"gyro_scale_factor": 5.0, "gyro_nonorthogonality": 5.0, "accel_scale_factor": 10.0}  # ppm, arcsec, ppm
IMPULSE = 0.01  # rad
LAG = 1e-3  # s
SLOW_SHARE = 0.1  # of the quasi-static amplitude
COUPLING_SHARE = 0.1  # of the lever arm
DRIFT_WINDOW_S = 60.0  # s, over which theta is freed of the gyros' drift at least
WHOLE_FLEXURE = 180.0  # windows times the slowest damping that leave all but 2 % of the flexure
DRIFT_SHARE = 0.1  # of the flexure, up to which the gyros' drift within a window does no harm
SETTLING = 10.0 * ARCMIN
STIFFNESS_SHARE = 1.0  # of stiffness and damping: how far the model's may be off
LAGGING_HZ = (0.5, 2.0, 8.0)
IN_PHASE_HZ = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0)


@dataclass(frozen=True)
class Nuisance:
    """A regressor (N, 9) with the standard deviation of its prior."""

    name: str
    column: FloatArray
    sigma: float


def believed_nuisances(
    obs: Observations, at: Linearisation, response: Response, jumps: Sequence[float] = ()
) -> tuple[Nuisance, ...]:
    """Those of every log: constants, and how flexure moves the lever arm; jumps: s, at which no lever moves."""
    one = np.ones(len(obs.t))
    kinds: tuple[tuple[str, Callable[[OnAxis], Signals], float], ...] = (
        ("gyro bias", lambda x: Signals(gyro=x), GYRO_BIAS),
        ("accel bias", lambda x: Signals(accel=x), ACCEL_BIAS),
        ("static", lambda x: Signals(mount=x), STATIC),
        ("installation", lambda x: Signals(phins=x), INSTALLATION),
    )
    told = [(f"{kind} {'xyz'[axis]}", signals(on_axis(axis, one)), sigma)
            for kind, signals, sigma in kinds for axis in range(3)]  # fmt: skip
    return (*_answers(response, told), *_couplings(obs, at, jumps))


def _answers(response: Response, told: Sequence[tuple[str, Signals, float]]) -> list[Nuisance]:
    """Names, signals and standard deviations as nuisances: what many signals do is worked out side by side."""
    columns = response.many(signals for _, signals, _ in told)
    return [Nuisance(name, columns[:, :, k], sigma) for k, (name, _, sigma) in enumerate(told)]


def _couplings(obs: Observations, at: Linearisation, jumps: Sequence[float]) -> list[Nuisance]:
    """How flexure moves the lever arm: each element of B, and each column's share above a corner frequency.

    The lever follows flexure only below some frequency, with a lag or without: what it lacks is a mixture of
    ``theta - LP(theta)`` over corners, with first-order filters of either kind. And how much of the second order
    it has.
    """
    theta = without_jumps(obs.t, full_rate(obs, at.R_ref), jumps)
    size = COUPLING_SHARE * max(float(np.linalg.norm(at.lever_arm)), 1.0)
    moved = _moved(obs, theta)
    out = [
        Nuisance(f"coupling {'xyz'[i]}{'xyz'[j]}", _on_u(moved(theta, np.eye(3)[i][:, None] * np.eye(3)[j])), size)
        for i in range(3)
        for j in range(3)
    ]
    step = float(np.median(np.diff(obs.t)))
    for kind, corners in (("lagging", LAGGING_HZ), ("in phase", IN_PHASE_HZ)):
        for corner in corners:
            lost = _low_pass(theta, min(corner * step, 0.45), kind == "in phase") - theta
            for j in range(3):
                column = _on_u(moved(lost, at.coupling[:, [j]] * np.eye(3)[j]))
                out.append(Nuisance(f"lever {kind} {corner:g} Hz {'xyz'[j]}", column, 1.0))
    return [*out, second_order(obs, at.lever_arm, _freed(obs, theta, DRIFT_WINDOW_S))]


def second_order(obs: Observations, arm: FloatArray, theta: FloatArray) -> Nuisance:
    """What a lever arm (3,) m that turns with the deck moves by beyond theta x r: theta x (theta x r) / 2. How much of
    it a deck has is its own: a beam that bends turns less on the way than at its end. theta: (n, 3) rad."""
    moved = 0.5 * np.cross(theta, np.cross(theta, arm))
    return Nuisance("lever of second order", _on_u(_moved(obs, theta)(moved, np.eye(3))), 1.0)


def _moving_mean(x: FloatArray, width: int) -> FloatArray:
    """Moving mean (n, c), windows cut short at the ends."""
    total = np.vstack([np.zeros(x.shape[1]), np.cumsum(x, axis=0)])
    k = np.arange(len(x))
    low, high = np.maximum(k - width // 2, 0), np.minimum(k + width // 2 + 1, len(x))
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def seen_flexure(obs: Observations, R_ref: FloatArray, window: float = DRIFT_WINDOW_S) -> FloatArray:
    """(n, 3) rad, the flexure that the gyros show, freed of their drift over a window (s), or of its trend where the
    record is shorter. The shorter window frees it of slow bending too, and takes some of the flexure along."""
    # Across gaps theta is not known.
    return _freed(obs, full_rate(obs, R_ref), DRIFT_WINDOW_S if obs.jump_s.any() else window)


def _freed(obs: Observations, theta: FloatArray, window: float) -> FloatArray:
    """theta (n, 3) without what is slower than a window."""
    t = obs.t
    if window > t[-1] - t[0]:
        return np.asarray(detrend(theta, axis=0))
    return theta - _moving_mean(theta, max(3, int(window / float(np.median(np.diff(t))))))


def whole_window(flexure: FlexureModel, arw: float) -> float:
    """A window (s) as long as the flexure needs and the gyros' drift allows; arw: of both units, rad/sqrt(s)."""
    drift = (DRIFT_SHARE * float(flexure.std.min()) / max(arw, 1e-12)) ** 2
    return max(DRIFT_WINDOW_S, min(WHOLE_FLEXURE / float(flexure.damping.min()), drift))


def without_jumps(t: FloatArray, theta: FloatArray, jumps: Sequence[float]) -> FloatArray:
    """theta (n, 3) less what it changes by in the one sample that ends at each time, beyond its neighbours' change."""
    out = theta.copy()
    for time in jumps:
        k = int(np.clip(np.argmin(np.abs(t - time)), 2, len(t) - 2))
        change = theta[k] - theta[k - 1] - 0.5 * (theta[k - 1] - theta[k - 2] + theta[k + 1] - theta[k])
        out[k:] -= change
    return out


def full_rate(obs: Observations, R_ref: FloatArray) -> FloatArray:
    """(n, 3) rad, Log(Y R_ref^T) at the samples."""
    back = quaternions.exp(-Rotation.from_matrix(R_ref).as_rotvec())
    Y = quaternions.multiply(quaternions.conjugate(obs.main.attitude), obs.sub.attitude)
    return quaternions.log(quaternions.multiply(Y, back[None, :]))


def _moved(obs: Observations, theta: FloatArray) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Velocity (N, 3) that a displacement B angle (n, 3) of the lever arm shows in u."""

    def velocity(angle: FloatArray, B: FloatArray) -> FloatArray:
        moved = angle @ B.T
        out = np.cross(obs.omega, trapezoid_means(moved, obs.index))
        at_steps = moved[obs.index]
        out[1:] += np.diff(at_steps, axis=0) / obs.dt[1:, None]
        return out

    return velocity


def _low_pass(x: FloatArray, corner: float, in_phase: bool) -> FloatArray:
    """Corner as a share of the rate: first order and lagging, or second-order Butterworth from either side."""
    start = x[0]
    if in_phase:
        sos = butter(2, 2.0 * corner, output="sos")
        return np.asarray(sosfiltfilt(sos, x - start, axis=0) + start)
    a = np.exp(-2.0 * np.pi * corner)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], x - start, axis=0) + start)


def _on_u(u: FloatArray) -> FloatArray:
    return np.hstack([np.zeros_like(u), u, np.zeros_like(u)])


def structure(flexure: FlexureModel, obs: Observations, R_ref: FloatArray, response: Response) -> list[Nuisance]:
    """Stiffness and damping of each axis: the answer to a lacking moment b^2 theta or 2 mu theta'."""
    theta = seen_flexure(obs, R_ref)  # with slow bending in it they would explain just that
    step = float(np.median(np.diff(obs.t)))
    angle, rate = foretold(theta, flexure, step, longest_step(obs))
    out = []
    for axis, (mu, b2) in enumerate(zip(flexure.damping, flexure.stiffness)):
        for name, moment in (("stiffness", b2 * angle[:, axis]), ("damping", 2.0 * mu * rate[:, axis])):
            bending = on_axis(axis, driven(mu, b2, step, -moment))
            out.append(Nuisance(f"{name} {'xyz'[axis]}", response(Signals(bending=bending)), STIFFNESS_SHARE))
    return out


def tolerances(
    source: Believed, flexure: FlexureModel, obs: Observations, R_ref: FloatArray, response: Response
) -> list[Nuisance]:
    """Small errors of the sub-IMU's scale factors and axes, which no calibration leaves out."""
    view = log_view(source, obs, R_ref, np.zeros((len(obs.t), 3)), flexure)
    told = [(f"{name} {column.parameter}", column.signals, sigma)
            for name, sigma in TOLERANCES.items() for column in effects.get(name).predict(view)]  # fmt: skip
    return _answers(response, told)


def gyro_lag(source: Believed, obs: Observations, R_ref: FloatArray, response: Response) -> list[Nuisance]:
    """Seconds by which the gyros alone lag, beyond the low-pass that was taken out."""
    if not source.lagging:
        return []
    main, stamp = source.trial.main, source.trial.seconds(source.trial.main.stamp)
    omega = np.stack([np.interp(obs.t, stamp, column) for column in main.gyro.T], axis=1) @ R_ref
    slope = np.gradient(omega, float(np.median(np.diff(obs.t))), axis=0)
    return [Nuisance("gyro lag", response(Signals(gyro=-slope)), LAG)]


def slow_bending(source: Believed, response: Response) -> list[Nuisance]:
    """Its amplitude and phase are never exactly the twin's."""
    belief, out = source.twin.flexure, []
    phase = 2.0 * np.pi * response.obs.t / belief.quasi_static_period
    for axis, amplitude in enumerate(belief.quasi_static_amplitude_arcmin):
        if amplitude:
            for name, wave in (("sine", np.sin(phase)), ("cosine", np.cos(phase))):
                bending = response(Signals(bending=on_axis(axis, wave)))
                sigma = SLOW_SHARE * abs(amplitude) * ARCMIN
                out.append(Nuisance(f"slow bending {name} {'xyz'[axis]}", bending, sigma))
    return out


def settling(response: Response) -> list[Nuisance]:
    """What a deck that follows heel with its lag still has of the time before the record."""
    left = np.exp(-(response.obs.t - response.obs.t[0]) / LAG_OF_HEEL)
    return [
        Nuisance(f"settling {'xyz'[axis]}", response(Signals(bending=on_axis(axis, left))), SETTLING)
        for axis in range(3)
    ]


def impulses(times: Sequence[float], response: Response) -> list[Nuisance]:
    """A single false gyro sample at each time, rad about each axis."""
    t, out = response.obs.t, []
    for time in times:
        k = int(np.argmin(np.abs(t - time)))
        for axis in range(3):
            one = np.zeros((len(t), 3))
            one[k, axis] = 1.0 / response.dt[k]
            out.append(Nuisance(f"impulse {time:.2f} s {'xyz'[axis]}", response(Signals(gyro=one)), IMPULSE))
    return out


def steps(times: Sequence[float], response: Response) -> list[Nuisance]:
    """A step of the mounting from each time on, rad about each axis."""
    t, out = response.obs.t, []
    for time in times:
        after = (t > time - 0.5 * response.dt[-1]).astype(float)
        for axis in range(3):
            column = response(Signals(mount=on_axis(axis, after)))
            out.append(Nuisance(f"step {time:.2f} s {'xyz'[axis]}", column, IMPULSE))
    return out
