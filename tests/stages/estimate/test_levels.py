"""The noise levels of the velocity match are those that went into the trial."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from physics.units import MICRO_G
from stages import align, identify
from stages.estimate import levels
from stages.estimate.solve import Solution, solve
from tests.stages.estimate.runs import WHITE, simulated, twin_of

NOISE_UG = 30.0  # micro-g/sqrt(Hz), each unit


@pytest.fixture(scope="module")
def solution() -> Solution:
    twin = twin_of("idam", 300.0, 25.0, WHITE | {"accel_vrw_ug": NOISE_UG})
    trial, _ = simulated(twin, 5)
    alignment = align.align(trial)
    return solve(trial, alignment, identify.get("whittle")().identify(trial, alignment))


def test_the_accelerometers_noise_is_found_to_a_tenth(solution) -> None:
    assert solution.noise.accel == pytest.approx(np.sqrt(2.0) * NOISE_UG * MICRO_G, rel=0.1)


def test_innovations_of_the_velocity_are_white_and_of_unit_variance(solution) -> None:
    filtered = solution.filtered
    values = (filtered.innovation / np.sqrt(filtered.innovation_variance))[50:, 3:]
    n = len(values)
    assert np.mean(values**2, axis=0) == pytest.approx(np.ones(3), abs=4.0 * np.sqrt(2.0 / n))
    neighbours = np.mean(values[1:] * values[:-1], axis=0) / np.mean(values**2, axis=0)
    assert np.abs(neighbours).max() < 4.0 / np.sqrt(n)


def test_levels_of_a_spectrum_are_the_most_likely_ones() -> None:
    """Against a general optimiser of the same likelihood."""
    rng = np.random.default_rng(3)
    c = np.linspace(0.01, 4.0, 60)
    parts, known = np.stack([np.ones(60), c, c**2], axis=1), 0.2 * c
    spectrum = (known + parts @ [1.0, 0.3, 0.05]) * rng.gamma(20.0, 1.0 / 20.0, 60)

    def loss(logs: np.ndarray) -> float:
        S = known + parts @ np.exp(logs)
        return float(np.sum(np.log(S) + spectrum / S))

    best = np.exp(minimize(loss, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-12}).x)
    assert levels.most_likely(spectrum, parts, known) == pytest.approx(best, rel=1e-4)
