"""Simpler ways to the same question, as reports of the log contract: what a diagnosis has to beat.

largest_residual  the channel with the largest residual, and the effect that explains most of it
global_nis        one chi-square test of all whitened residuals: says that, never what
in_sample         the effect with the greatest gain of likelihood on the data it was fitted to
bic               the same less half the number of parameters times ln n
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pipeline.blind import residuals
from pipeline.blind.residuals import CHANNELS, View

FloatArray = NDArray[np.float64]

SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class Fit:
    """An effect fitted by least squares on the whitened residual: gain in nats, estimates with standard deviation."""

    name: str
    keys: Sequence[str]
    value: FloatArray
    std: FloatArray
    gain: float
    columns: FloatArray


def largest_residual(log: Path, twin: Path, without: tuple[str, ...]) -> dict[str, Any]:
    """Report by the largest residual."""
    seen, z = _look(log, twin)
    power = _channel_power(seen, z)
    channel, axis = np.unravel_index(int(np.argmax(power)), power.shape)
    part = _part(seen, int(channel), int(axis))
    fits = _fits(seen, z, without)
    best = max(fits, key=lambda fit: _explained(z[part], fit.columns[part]))
    return _report(seen, z, [best] if _alarm(z) else [])


def global_nis(log: Path, twin: Path, without: tuple[str, ...]) -> dict[str, Any]:
    """Report by one test of everything."""
    seen, z = _look(log, twin)
    return _report(seen, z, [], "unknown_effect" if _alarm(z) else "no_gap")


def in_sample(log: Path, twin: Path, without: tuple[str, ...]) -> dict[str, Any]:
    """Report by the likelihood of the data fitted to, against a chi-square of its parameters."""
    seen, z = _look(log, twin)
    best = max(_fits(seen, z, without), key=lambda fit: fit.gain)
    return _report(seen, z, [best] if 2.0 * best.gain > chi2.isf(SIGNIFICANCE, len(best.keys)) else [])


def bic(log: Path, twin: Path, without: tuple[str, ...]) -> dict[str, Any]:
    """Report by the Bayesian information criterion."""
    seen, z = _look(log, twin)

    def criterion(fit: Fit) -> float:
        return fit.gain - 0.5 * len(fit.keys) * float(np.log(len(z)))

    best = max(_fits(seen, z, without), key=criterion)
    return _report(seen, z, [best] if criterion(best) > 0.0 else [])


def _look(log: Path, twin: Path) -> tuple[View, FloatArray]:
    from stages.decode import decode
    from twin.loading import load_twin

    seen = residuals.view(decode(log).trial, load_twin(twin))
    return seen, residuals.whitened(seen, seen.residual)


def _fits(seen: View, z: FloatArray, without: Sequence[str]) -> list[Fit]:
    return [_fit(seen, z, name, keys, units) for name, keys, units in residuals.columns(seen) if name not in without]


def _fit(seen: View, z: FloatArray, name: str, keys: Sequence[str], units: Sequence[FloatArray]) -> Fit:
    matrix = np.stack([residuals.whitened(seen, unit) for unit in units], axis=-1)
    scale = np.sqrt((matrix**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    normal = matrix / scale
    covariance = np.linalg.pinv(normal.T @ normal, hermitian=True)
    value = covariance @ (normal.T @ z)
    gain = 0.5 * float(value @ (normal.T @ z))
    return Fit(name, keys, value / scale, np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale, gain, matrix)


def _alarm(z: FloatArray) -> bool:
    return bool((z**2).sum() > chi2.isf(SIGNIFICANCE, len(z)))


def _explained(z: FloatArray, matrix: FloatArray) -> float:
    """Share of the energy of z that the columns explain."""
    solution = np.linalg.lstsq(matrix, z, rcond=None)[0]
    return float(1.0 - ((z - matrix @ solution) ** 2).sum() / (z**2).sum())


def _labels(seen: View) -> NDArray[np.int64]:
    """Channel and axis (3 channel + axis) of each whitened number."""
    marks = np.broadcast_to(np.arange(9).reshape(3, 1, 3), seen.variance.shape)[np.isfinite(seen.variance)]
    return np.concatenate([marks, marks])


def _channel_power(seen: View, z: FloatArray) -> FloatArray:
    labels = _labels(seen)
    return np.array([np.mean(z[labels == k] ** 2) if (labels == k).any() else 0.0 for k in range(9)]).reshape(3, 3)


def _part(seen: View, channel: int, axis: int) -> NDArray[np.bool_]:
    return _labels(seen) == 3 * channel + axis


def _report(seen: View, z: FloatArray, named: Sequence[Fit], verdict: str = "") -> dict[str, Any]:
    power = _channel_power(seen, z)
    order = np.dstack(np.unravel_index(np.argsort(-power, axis=None), power.shape))[0]
    after = float((z**2).sum()) - sum(2.0 * fit.gain for fit in named)
    before, size = max(float((z**2).sum()) / len(z) - 1.0, 1e-12), len(z)
    closed = float(np.clip(1.0 - max(after / size - 1.0, 0.0) / before, 0.0, 1.0))
    return {
        "verdict": verdict or ("explained" if named else "no_gap"),
        "where": [{"channel": CHANNELS[c], "axis": "xyz"[a], "score": float(power[c, a])} for c, a in order.tolist()],
        "effects": [_effect(fit) for fit in named],
        "gap": {"before": before, "after": before * (1.0 - closed), "closed": closed, "closed_ci95": [closed, closed]},
    }


def _effect(fit: Fit) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    for key, value, std in zip(fit.keys, fit.value, fit.std):
        entry = {"value": float(value), "std": float(std)}
        name, _, axis = key.partition(".")
        if axis:
            parameters.setdefault(name, {})[axis] = entry
        else:
            parameters[name] = entry
    return {"name": fit.name, "parameters": parameters, "evidence_nats": fit.gain, "ambiguous_with": []}
