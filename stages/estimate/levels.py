"""Noise levels of the velocity match, from the spectrum of what a round leaves of it.

With the smoothed states taken out, ``A_mid (u - H x) = V + noise`` holds the accelerometers' noise, summed up in V, and
on top of it white velocity and the displacement by which the lever arm lags flexure, differenced. Its change from step
to step, in m-axes, is stationary and has the spectrum

    S(w) = a^2 dt (1 - c / 6) + v^2 c + (j / dt)^2 c^2 + g^2 |B|^2 c / dt,    c = 2 - 2 cos(w dt)

with a (m/s)/sqrt(s), v m/s, j m as in :class:`stages.estimate.model.Noise`; c / 6 because u is a mean over the step.
The sub gyro's noise g comes in through flexure. What else is slow, the tilt that the smoothed drift misses and errors
of the model at wave frequencies among it, counts as the accelerometers' noise: it must not be trusted either.
a, v and j follow by maximum Whittle likelihood, S being linear in their squares.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from schemas.rig import FloatArray
from stages.estimate import model as m
from stages.paired import Observations

SEGMENT = 128  # steps
SEGMENTS = 4  # that a spectrum takes at least
FIRST = 2  # lowest frequency used, 1 / segment: the window smears the mean over the one below
ITERATIONS = 30  # of the scoring
LEAST_SHARE = 1e-6  # of the mean spectrum: keeps the first weights finite
VELOCITY_FLOOR = 1e-6  # m/s: what interpolation and the means over a step leave
JITTER_FLOOR = 1e-7  # m
ACCEL_FLOOR = 1e-6  # (m/s)/sqrt(s)


def fitted(
    obs: Observations, noise: m.Noise, coupling: FloatArray, smoothed: FloatArray, last: FloatArray, least: float
) -> m.Noise:
    """The noise with the levels that the record shows; as it was where too little of u is there.

    smoothed: (N, 3 and more) means of d first. last: (SIZE,) mean at the end, for what is constant. coupling: (3, 3).
    least: (m/s)/sqrt(s), below which the accelerometers' noise is not set.
    """
    change = _changes(obs, noise, coupling, smoothed[:, :3], last)
    dt = float(np.median(obs.dt[1:]))
    spectrum = _spectrum(change)
    if spectrum is None:
        return noise
    c = 2.0 - 2.0 * np.cos(2.0 * np.pi * np.arange(FIRST, FIRST + len(spectrum)) / SEGMENT)
    gyros = (1.0 - m.main_share(obs, noise)) * np.sum(coupling**2 * noise.gyro**2, axis=1)
    parts = np.stack([dt * (1.0 - c / 6.0), c, c**2 / dt**2], axis=1)
    known = c[:, None] * gyros / dt
    squares = np.array([most_likely(spectrum[:, i], parts, known[:, i]) for i in range(3)])
    accel = max(float(np.sqrt(squares[:, 0].mean())), least, ACCEL_FLOOR)
    fixed = known + accel**2 * parts[:, :1]
    squares = np.array([most_likely(spectrum[:, i], parts[:, 1:], fixed[:, i]) for i in range(3)])
    return replace(
        noise, accel=accel, velocity=np.maximum(np.sqrt(squares[:, 0]), VELOCITY_FLOOR),
        jitter=np.maximum(np.sqrt(squares[:, 1]), JITTER_FLOOR),
    )  # fmt: skip


def _changes(obs: Observations, noise: m.Noise, coupling: FloatArray, d: FloatArray, last: FloatArray) -> FloatArray:
    """(N, 3) m/s in m-axes: change of A_mid (u - H x) over a step less what the model knows of it; NaN at gaps."""
    x = np.tile(last, (len(d), 1))
    x[:, m.D : m.D + 3] = d
    passing = [
        *range(m.V, m.V + 3),
        *range(m.JITTER, m.JITTER + 3),
        *range(m.JITTER_BEFORE, m.JITTER_BEFORE + 3),
        *range(m.STEP_D, m.STEP_D + 3),
        *range(m.STEP_V, m.STEP_V + 3),
    ]
    x[:, passing] = 0.0
    left = m.velocity_residual(obs, noise, coupling, x)
    in_i = np.einsum("kij,kj->ki", obs.A_mid, left)
    nabla = last[m.NABLA : m.NABLA + 3]
    known = -np.cross(obs.force_i, d) * obs.dt[:, None] + obs.A_integral @ nabla
    change = np.full_like(left, np.nan)
    change[1:] = np.diff(in_i, axis=0) - known[1:]
    change[obs.jump_s > 0.0] = np.nan
    return np.asarray(np.einsum("kji,kj->ki", obs.A_mid, change))


def _spectrum(x: FloatArray) -> FloatArray | None:
    """(SEGMENT / 2 - FIRST, 3) mean periodogram of white unit level one, from whole segments without a gap."""
    starts = np.arange(0, len(x) - SEGMENT + 1, SEGMENT // 2)
    pieces = np.stack([x[k : k + SEGMENT] for k in starts]) if len(starts) else np.empty((0, SEGMENT, 3))
    pieces = pieces[np.isfinite(pieces).all(axis=(1, 2))]
    if len(pieces) < SEGMENTS:
        return None
    window = np.hanning(SEGMENT + 1)[:-1, None]  # periodic
    centred = pieces - pieces.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(centred * window, axis=1)) ** 2 / np.sum(window**2)
    return np.asarray(power.mean(axis=0)[FIRST:-1])


def most_likely(spectrum: FloatArray, parts: FloatArray, known: FloatArray) -> FloatArray:
    """Coefficients (p,) >= 0 of maximum Whittle likelihood in ``S = known + parts @ x``, by iterated least squares."""
    S = np.maximum(known, LEAST_SHARE * spectrum.mean()) + spectrum.mean()
    x = np.zeros(parts.shape[1])
    scale = np.maximum(np.abs(parts).max(axis=0), 1e-300)
    for _ in range(ITERATIONS):
        x, _ = nnls(parts / scale / S[:, None], (spectrum - known) / S)
        S = np.maximum(known + (parts / scale) @ x, LEAST_SHARE * spectrum.mean())
    return np.asarray(x / scale)
