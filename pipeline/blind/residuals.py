"""What the baselines look at: the log less the twin's prediction from the main IMU, whitened with the twin's spectra.

Nothing is fitted: biases, flexure and noise are taken as the twin has them. Channels are taken as independent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physics.rotations import exp, from_euler, skew
from physics.units import ARCMIN, ARCSEC, DEG, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G, PPM, STANDARD_GRAVITY
from schemas.trial import Trial
from twin.config import Imu, Twin

FloatArray = NDArray[np.float64]

STEP = 0.1  # s, of the residuals
HIGHEST = 4.0  # Hz
CHANNELS = ("sub.gyro", "sub.accel", "phins_sub.attitude")


@dataclass(frozen=True)
class View:
    """Residuals (3 channels, n, 3) every STEP and what predictions are made of, (n, 3), in m-axes.

    omega, omega_dot, force, jerk: of the sub-IMU's place. temperature: (n,) K above 20 deg C. roll: (n,) rad.
    """

    t: FloatArray
    residual: FloatArray
    omega: FloatArray
    omega_dot: FloatArray
    force: FloatArray
    jerk: FloatArray
    turned: FloatArray
    temperature: FloatArray | None
    roll: FloatArray | None
    variance: FloatArray  # (3 channels, bins, 3): what the twin expects of the transform
    window: FloatArray


def view(trial: Trial, twin: Twin) -> View:
    """Residuals of a log against a twin."""
    t = trial.seconds(trial.main.stamp)
    own = trial.seconds(trial.sub.stamp)
    turned = exp(np.array(twin.mount.static_arcmin) * ARCMIN)
    gyro = _on(t, own, trial.sub.gyro - np.array(twin.imu.sub.gyro_bias_dph) * DEG_PER_HOUR)
    accel = _on(t, own, trial.sub.accel - np.array(twin.imu.sub.accel_bias_ug) * MICRO_G)
    omega = _corrected(trial.main.gyro, twin.imu.main)
    force = trial.main.accel - np.array(twin.imu.main.accel_bias_ug) * MICRO_G
    omega_dot = np.gradient(omega, t, axis=0)
    arm = np.array(twin.mount.lever_arm)
    force = force + np.cross(omega_dot, arm) + np.cross(omega, np.cross(omega, arm))
    rate = _corrected(gyro + np.array(twin.imu.sub.gyro_bias_dph) * DEG_PER_HOUR, twin.imu.sub) @ turned.T
    attitude, roll = _attitudes(trial, twin, turned)
    residual = np.stack([rate - omega, accel @ turned.T - force, attitude])
    every = max(1, round(STEP / float(np.median(np.diff(t)))))
    thin = _thinner(every)
    grid = thin(t)
    window = np.hanning(len(grid))
    warmth = trial.temperature_sub
    reading = None
    if warmth is not None:
        reading = np.interp(grid, trial.seconds(warmth.stamp), warmth.value) - 20.0
    return View(
        t=grid, residual=np.stack([thin(part) for part in residual]), omega=thin(omega), omega_dot=thin(omega_dot),
        force=thin(force), jerk=np.gradient(thin(force), grid, axis=0), turned=turned, temperature=reading,
        roll=None if roll is None else thin(roll),
        variance=_expected(twin, len(grid), float((window**2).sum()), trial.phins_sub is not None), window=window,
    )  # fmt: skip


def whitened(seen: View, signals: FloatArray) -> FloatArray:
    """Real and imaginary parts (k,) of the transforms of signals (3, n, 3), unit variance if the twin is right."""
    spectrum = np.fft.rfft(signals * seen.window[:, None], axis=1)[:, : seen.variance.shape[1]]
    scaled = spectrum / np.sqrt(0.5 * seen.variance)
    flat = scaled[np.isfinite(seen.variance)]
    return np.concatenate([flat.real, flat.imag])


def columns(seen: View) -> Iterator[tuple[str, list[str], list[FloatArray]]]:
    """Effects by name, with their parameters and the signal (3, n, 3) that a unit of each adds."""
    turned = seen.turned
    inside = seen.omega @ turned
    pulled = seen.force @ turned
    n = len(seen.t)
    yield "time_delay", ["delay"], [_signal(n, -seen.omega_dot, -seen.jerk)]
    growing = seen.t[:, None] * PPM
    yield "clock_drift", ["drift"], [_signal(n, -seen.omega_dot * growing, -seen.jerk * growing)]
    yield "gyro_scale_factor", list("xyz"), [_signal(n, np.outer(inside[:, i], turned[:, i]) * PPM) for i in range(3)]
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    skewed = [_signal(n, np.outer(inside[:, j], turned[:, i]) * ARCSEC) for i, j in pairs]
    yield "gyro_nonorthogonality", ["xyz"[i] + "xyz"[j] for i, j in pairs], skewed
    unit = DEG_PER_HOUR / STANDARD_GRAVITY
    yield "gyro_g_sensitivity", list("xyz"), [_signal(n, np.outer(pulled[:, i], turned[:, i]) * unit) for i in range(3)]
    level = np.ones(n)
    yield "gyro_bias", list("xyz"), [_signal(n, np.outer(level, turned[:, i]) * DEG_PER_HOUR) for i in range(3)]
    if seen.temperature is not None:
        warm = [_signal(n, np.outer(seen.temperature, turned[:, i]) * DEG_PER_HOUR) for i in range(3)]
        yield "gyro_temperature", [f"slope.{axis}" for axis in "xyz"], warm
    yield "accel_bias", list("xyz"), [_signal(n, None, np.outer(level, turned[:, i]) * MICRO_G) for i in range(3)]
    scaled = [_signal(n, None, np.outer(pulled[:, i], turned[:, i]) * PPM) for i in range(3)]
    yield "accel_scale_factor", list("xyz"), scaled
    moved = [np.cross(seen.omega_dot, e) + np.cross(seen.omega, np.cross(seen.omega, e)) for e in np.eye(3)]
    yield "lever_arm", list("xyz"), [_signal(n, None, m) for m in moved]
    yield "static_misalignment", list("xyz"), [_bent(seen, level * ARCMIN, i) for i in range(3)]
    if seen.roll is not None:
        yield "wave_forced_bending", list("xyz"), [_bent(seen, seen.roll / DEG * ARCMIN, i) for i in range(3)]
    yield "heel_bending", list("xyz"), [_bent(seen, _lagged(seen.force[:, 0]) * ARCMIN, i) for i in range(3)]


def _signal(n: int, gyro: FloatArray | None, accel: FloatArray | None = None) -> FloatArray:
    out = np.zeros((3, n, 3))
    if gyro is not None:
        out[0] = gyro
    if accel is not None:
        out[1] = accel
    return out


def _bent(seen: View, angle: FloatArray, axis: int) -> FloatArray:
    """theta' + w x theta in the gyros, F x theta in the accelerometers, theta in the attitude."""
    theta = np.outer(angle, np.eye(3)[axis])
    out = _signal(len(angle), np.gradient(theta, seen.t, axis=0) + np.cross(seen.omega, theta))
    out[1], out[2] = np.cross(seen.force, theta), theta
    return out


def _lagged(force: FloatArray) -> FloatArray:
    """Through a lag of 20 s."""
    out, keep = np.empty_like(force), np.exp(-STEP / 20.0)
    out[0] = force[: round(60.0 / STEP)].mean()
    for k in range(1, len(force)):
        out[k] = keep * out[k - 1] + (1.0 - keep) * force[k]
    return out


def _thinner(every: int):  # type: ignore[no-untyped-def]
    def thin(values: FloatArray) -> FloatArray:
        n = len(values) // every
        return values[: n * every].reshape(n, every, *values.shape[1:]).mean(axis=1)

    return thin


def _on(t: FloatArray, own: FloatArray, values: FloatArray) -> FloatArray:
    return np.stack([np.interp(t, own, values[:, i]) for i in range(3)], axis=-1)


def _corrected(rate: FloatArray, imu: Imu) -> FloatArray:
    """Bias, scale and non-orthogonality that the twin states taken out."""
    matrix = np.diag(imu.gyro_scale_ppm) * PPM
    for (i, j), value in zip(((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)), imu.gyro_nonorthogonality_arcsec):
        matrix[i, j] = value * ARCSEC
    return (rate - np.array(imu.gyro_bias_dph) * DEG_PER_HOUR) @ np.linalg.inv(np.eye(3) + matrix).T


def _attitudes(trial: Trial, twin: Twin, turned: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """Log(R_m_s of the PHINS R_s_m of the twin), (n, 3), zeros without PHINS, and the roll (n,)."""
    main, sub = trial.phins_main, trial.phins_sub
    n = len(trial.main.stamp)
    if main is None or sub is None or main.attitude is None or sub.attitude is None or len(main) != n or len(sub) != n:
        return np.zeros((n, 3)), None
    seats = [
        Rotation.from_matrix(from_euler(*np.array([a[2], a[0], a[1]])[:, None] * DEG)[0])
        for a in (twin.phins.installation_main_deg, twin.phins.installation_sub_deg)
    ]
    R_n_m = Rotation.from_quat(main.attitude) * seats[0].inv()
    R_n_s = Rotation.from_quat(sub.attitude) * seats[1].inv()
    relative = R_n_m.inv() * R_n_s * Rotation.from_matrix(turned).inv()
    return relative.as_rotvec(), R_n_m.as_euler("ZXY")[:, 2]


def _expected(twin: Twin, n: int, energy: float, with_phins: bool) -> FloatArray:
    """Variance (3, bins, 3) of the windowed transform: two-sided densities by window energy over the step."""
    f = np.fft.rfftfreq(n, STEP)
    f = f[f <= HIGHEST]
    w2 = (2.0 * np.pi * f)[:, None] ** 2
    mu, sigma = np.array(twin.flexure.damping), np.array(twin.flexure.std_arcmin) * ARCMIN
    b2 = mu**2 + np.array(twin.flexure.frequency) ** 2
    flexure = 4.0 * mu * b2 * sigma**2 / ((b2 - w2) ** 2 + 4.0 * mu**2 * w2)
    arw = (twin.imu.main.gyro_arw**2 + twin.imu.sub.gyro_arw**2) * DEG_PER_SQRT_HOUR**2
    vrw = (twin.imu.main.accel_vrw_ug**2 + twin.imu.sub.accel_vrw_ug**2) * MICRO_G**2
    band = 1.0 / (1.0 + (f[:, None] / twin.mount.lever_bandwidth) ** 4)
    gain = skew(np.array([0.0, 0.0, STANDARD_GRAVITY]))[None] + (w2 * band)[..., None] * skew(
        np.array(twin.mount.lever_arm)
    )
    drift = np.array(twin.phins.attitude_drift_arcmin) * ARCMIN
    tau = twin.phins.attitude_drift_tau
    noise = 2.0 * (drift**2 * 2.0 * tau / (1.0 + w2 * tau**2)) + 2.0 * (
        twin.phins.attitude_noise_arcmin * ARCMIN
    ) ** 2 / (twin.run.rate)
    accel = np.einsum("fij,fj->fi", gain**2, flexure) + vrw
    out = _leaked(np.stack([w2 * flexure + arw, accel, flexure + noise]))
    if not with_phins:
        out[2] = np.inf
    return out * energy / STEP


def _leaked(density: FloatArray) -> FloatArray:
    """Densities (3, bins, 3) as a Hann window sees them: a sixth of each neighbour, mirrored at zero frequency."""
    before = np.concatenate([density[:, 1:2], density[:, :-1]], axis=1)
    after = np.concatenate([density[:, 1:], density[:, -1:]], axis=1)
    return (before + 4.0 * density + after) / 6.0
