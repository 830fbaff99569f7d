"""Noise levels and flexure by the exact likelihood of the innovations, one parameter after the other.

For what a spectrum or a mean square cannot settle: several levels that act on the same innovations, and flexure that
coarse gyros hide. A parameter is moved up or down by a factor as long as that gains, then by finer factors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from physics.whittle import PRIOR_CORRELATION_S, PRIOR_SPREAD
from stages.estimate.states import Noise

GAIN_NATS = 0.5  # what a move has to bring
MOVES_AT_MOST = 5  # of one parameter in one direction by one factor

Score = Callable[[list[Noise]], list[float]]
Move = Callable[[Noise, float], Noise]


def climb(noise: Noise, score: Score, moves: Sequence[Move], factors: Sequence[float]) -> Noise:
    """The noise moved uphill. score: log-likelihood of several; moves: each changes one parameter by a factor."""
    (best,) = score([noise])
    for factor in factors:
        for move in moves:
            noise, best = _along(noise, best, score, move, factor)
    return noise


def _along(noise: Noise, best: float, score: Score, move: Move, factor: float) -> tuple[Noise, float]:
    tried = [move(noise, factor), move(noise, 1.0 / factor)]
    values = score(tried)
    up = values[0] >= values[1]
    step, value, candidate = (factor, values[0], tried[0]) if up else (1.0 / factor, values[1], tried[1])
    for _ in range(MOVES_AT_MOST):
        if value < best + GAIN_NATS:
            break
        noise, best, candidate = candidate, value, move(candidate, step)
        (value,) = score([candidate])
    return noise, best


def _scaled(name: str, noise: Noise, factor: float) -> Noise:
    return replace(noise, **{name: factor * getattr(noise, name)})


def _jitter(axis: int, noise: Noise, factor: float) -> Noise:
    return replace(noise, jitter=_times(noise.jitter, axis, factor))


def _spread(axis: int, noise: Noise, factor: float) -> Noise:
    """sigma, and with it the forcing."""
    return replace(noise, std=_times(noise.std, axis, factor))


def _rate(axis: int, noise: Noise, factor: float) -> Noise:
    """mu and b together; the forcing 4 mu b^2 sigma^2 stays."""
    return replace(
        noise, damping=_times(noise.damping, axis, factor), stiffness=_times(noise.stiffness, axis, factor**2),
        std=_times(noise.std, axis, factor**-1.5),
    )  # fmt: skip


def _damping(axis: int, noise: Noise, factor: float) -> Noise:
    """mu alone; the forcing stays."""
    return replace(noise, damping=_times(noise.damping, axis, factor), std=_times(noise.std, axis, factor**-0.5))


def _times(values: np.ndarray, axis: int, factor: float) -> np.ndarray:
    out = values.copy()
    out[axis] *= factor
    return out


LEVELS: tuple[Move, ...] = tuple(partial(_scaled, name) for name in ("accel", "velocity", "jitter"))
JITTERS: tuple[Move, ...] = tuple(partial(_jitter, axis) for axis in range(3))
FLEXURE: tuple[Move, ...] = tuple(partial(move, axis) for axis in range(3) for move in (_spread, _rate, _damping))


def flexure_prior(noise: Noise) -> float:
    """Log of the weak prior on 1/b and mu/b, that of the Whittle fit."""
    b = np.sqrt(noise.stiffness)
    deviations = np.log(b * PRIOR_CORRELATION_S), np.log(noise.damping / b)
    return float(-0.5 * np.sum(np.square(deviations)) / PRIOR_SPREAD**2)
