"""Spectrum and autocorrelation of the flexure found, and of the model identified."""

from __future__ import annotations

import numpy as np
from scipy.signal import welch

from physics.interpolation import gap_starts
from schemas.products import Deformation, FlexureModel
from schemas.rig import FloatArray

SEGMENT = 200.0  # s, length of a Welch segment, at most a quarter of the record
MAX_LAG = 60.0  # s
HIGHEST = 2.0  # Hz drawn
MIN_SAMPLES = 64


def longest_run(deformation: Deformation) -> slice:
    """The longest stretch of the estimate without a gap."""
    edges = np.concatenate([[0], gap_starts(deformation.stamp) + 1, [len(deformation.stamp)]])
    best = int(np.argmax(np.diff(edges)))
    return slice(int(edges[best]), int(edges[best + 1]))


def measured_spectrum(theta: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Frequency (k,) Hz and one-sided density (k, 3) rad^2/Hz of flexure (n, 3), Welch's method."""
    length = int(min(SEGMENT * rate, len(theta) / 4))
    f, density = welch(theta, rate, nperseg=max(length, MIN_SAMPLES), axis=0, detrend="linear")
    return f[1:], density[1:]


def model_spectrum(f: FloatArray, model: FlexureModel) -> FloatArray:
    """``2 q / ((b^2 - w^2)^2 + 4 mu^2 w^2)``, one-sided (k, 3) rad^2/Hz, w = 2 pi f."""
    w2 = (2 * np.pi * f[:, None]) ** 2
    density: FloatArray = 2 * model.forcing / ((model.stiffness - w2) ** 2 + 4 * model.damping**2 * w2)
    return density


def measured_autocorrelation(theta: FloatArray, lags: int) -> FloatArray:
    """Autocorrelation (lags, 3) of flexure (n, 3), 1 at lag 0."""
    n = len(theta)
    spectrum = np.fft.rfft(theta - theta.mean(axis=0), 2 * n, axis=0)
    raw = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[:lags]
    return raw / np.where(raw[:1] > 0, raw[:1], 1.0)


def model_autocorrelation(lag: FloatArray, model: FlexureModel) -> FloatArray:
    """``e^(-mu t) (cos(l t) + mu / l sin(l t))`` (k, 3) with l^2 = b^2 - mu^2, which may be negative."""
    root = np.sqrt((model.stiffness - model.damping**2).astype(complex))
    root = np.where(np.abs(root) < 1e-9, 1e-9, root)
    t = lag[:, None]
    values: FloatArray = np.real(
        np.exp(-model.damping * t) * (np.cos(root * t) + model.damping / root * np.sin(root * t))
    )
    return values
