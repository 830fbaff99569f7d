"""Spectrum and autocorrelation of the flexure found, and of the model identified."""

from __future__ import annotations

import numpy as np
from scipy.fft import next_fast_len

from physics.interpolation import gap_starts
from schemas.products import Deformation, FlexureModel
from schemas.rig import FloatArray
from stages.slabs import SLAB

SEGMENT = 200.0  # s, length of a Welch segment, at most a quarter of the record
MAX_LAG = 60.0  # s
HIGHEST = 2.0  # Hz drawn
MIN_SAMPLES = 64


def longest_run(deformation: Deformation) -> slice:
    """The longest stretch of the estimate without a gap."""
    edges = np.concatenate([[0], gap_starts(deformation.stamp) + 1, [len(deformation.stamp)]])
    best = int(np.argmax(np.diff(edges)))
    return slice(int(edges[best]), int(edges[best + 1]))


def drawable(deformation: Deformation) -> tuple[FloatArray, float] | None:
    """Flexure (n, 3) rad of the longest run and its rate, Hz; None where that is too short or shows no flexure."""
    run = longest_run(deformation)
    theta, stamp = deformation.dynamic_part[run], deformation.stamp[run]
    if len(stamp) < MIN_SAMPLES or not np.isfinite(theta).all() or not np.ptp(theta):
        return None
    rate = 1e9 / float(np.median(np.diff(stamp)))
    longest = max(min(SEGMENT * rate, len(theta) / 4), MIN_SAMPLES)
    return (theta, rate) if 2 * rate / longest < HIGHEST else None


def measured_spectrum(theta: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Frequency (k,) Hz and one-sided density (k, 3) rad^2/Hz of flexure (n, 3), Welch's method."""
    length = max(int(min(SEGMENT * rate, len(theta) / 4)), MIN_SAMPLES)
    # Axis by axis, here and below: a transform takes several times the memory of its signal.
    density = np.stack([welch(axis, rate, length) for axis in theta.T], axis=1)
    return np.asarray(np.arange(1, len(density)) * rate / length), density[1:]


def welch(x: FloatArray, rate: float, length: int) -> FloatArray:
    """One-sided density, the mean over segments of ``length`` samples that overlap by half: Hann, straight line off."""
    segments = np.lib.stride_tricks.sliding_window_view(x, length)[:: length - length // 2]
    k = np.arange(length) - 0.5 * (length - 1)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    total = np.zeros(length // 2 + 1)
    few = max(1, SLAB // length)  # segments at a time
    for first in range(0, len(segments), few):
        level = segments[first : first + few] - segments[first : first + few].mean(axis=1, keepdims=True)
        transform = np.fft.rfft((level - np.outer(level @ k / (k @ k), k)) * window)
        total += np.sum(transform.real**2 + transform.imag**2, axis=0)
    density = total / (len(segments) * rate * (window @ window))
    density[1 : (length + 1) // 2] *= 2.0  # not the mean nor, at an even length, the highest frequency
    return np.asarray(density)


def model_spectrum(f: FloatArray, model: FlexureModel) -> FloatArray:
    """``2 q / ((b^2 - w^2)^2 + 4 mu^2 w^2)``, one-sided (k, 3) rad^2/Hz, w = 2 pi f."""
    w2 = (2 * np.pi * f[:, None]) ** 2
    density: FloatArray = 2 * model.forcing / ((model.stiffness - w2) ** 2 + 4 * model.damping**2 * w2)
    return density


def measured_autocorrelation(theta: FloatArray, lags: int) -> FloatArray:
    """Autocorrelation (lags, 3) of flexure (n, 3), 1 at lag 0."""
    raw = np.stack([_correlated(axis - axis.mean(), lags) for axis in theta.T], axis=1)
    return raw / np.where(raw[:1] > 0, raw[:1], 1.0)


def _correlated(x: FloatArray, lags: int) -> FloatArray:
    """Sums of products of x (n,) with itself that many samples later, (lags,), a block of x at a time."""
    block = max(SLAB, lags)
    out = np.zeros(lags)
    for start in range(0, len(x), block):
        first, all_ = x[start : start + block], x[start : start + block + lags]
        size = next_fast_len(len(all_) + lags, real=True)  # products that wrap around do not reach these lags
        out += np.fft.irfft(np.fft.rfft(first, size).conj() * np.fft.rfft(all_, size), size)[:lags]
    return out


def model_autocorrelation(lag: FloatArray, model: FlexureModel) -> FloatArray:
    """``e^(-mu t) (cos(l t) + mu / l sin(l t))`` (k, 3) with l^2 = b^2 - mu^2, which may be negative."""
    root = np.sqrt((model.stiffness - model.damping**2).astype(complex))
    root = np.where(np.abs(root) < 1e-9, 1e-9, root)
    t = lag[:, None]
    values: FloatArray = np.real(
        np.exp(-model.damping * t) * (np.cos(root * t) + model.damping / root * np.sin(root * t))
    )
    return values
