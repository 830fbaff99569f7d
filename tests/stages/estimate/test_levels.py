"""Climbing a likelihood one parameter after the other, and what each move keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stages.estimate import levels
from tests.stages.estimate.test_model import NOISE


def hill(best: np.ndarray) -> levels.Score:
    """Highest where jitter is ``best``, a nat down at a factor of 1.16."""
    return lambda tried: [-50.0 * float(np.sum(np.log(one.jitter / best) ** 2)) for one in tried]


def test_climb_finds_the_top_of_each_axis() -> None:
    best = NOISE.jitter * np.array([8.0, 0.03, 1.0])
    found = levels.climb(NOISE, hill(best), levels.JITTERS, (5.0, 2.0, 1.2))
    np.testing.assert_allclose(found.jitter, best, rtol=0.15)


def test_climb_stays_where_nothing_is_to_be_gained() -> None:
    asked = []
    found = levels.climb(NOISE, lambda tried: asked.append(len(tried)) or [0.0] * len(tried), levels.LEVELS, (2.0,))
    assert found is NOISE
    assert asked == [1, 2, 2, 2]


@pytest.mark.parametrize("move", levels.FLEXURE)
def test_moves_of_flexure_touch_one_axis_and_all_but_the_spread_keep_the_forcing(move) -> None:
    forcing = lambda noise: 4.0 * noise.damping * noise.stiffness * noise.std**2  # noqa: E731
    ratio = forcing(move(NOISE, 2.0)) / forcing(NOISE)
    assert np.count_nonzero(~np.isclose(move(NOISE, 2.0).std, NOISE.std)) == 1
    assert np.isclose(ratio, 1.0).sum() == (2 if move.func is levels._spread else 3)
    np.testing.assert_allclose(move(move(NOISE, 2.0), 0.5).std, NOISE.std, rtol=1e-12)


def test_prior_of_flexure_is_highest_at_eight_seconds_and_critical_damping() -> None:
    usual = replace(NOISE, damping=np.full(3, 0.125), stiffness=np.full(3, 0.125**2))
    assert levels.flexure_prior(usual) == pytest.approx(0.0)
    assert levels.flexure_prior(replace(usual, damping=np.array([0.125, 0.125 * np.exp(1.5), 0.125]))) == pytest.approx(
        -0.5
    )
