"""The slow part of a drift against dense least squares on hat functions, and what it leaves alone."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from physics.units import DEG_PER_HOUR
from schemas.trial import Trial
from stages.drift import calibrated, slow_part
from stages.paired import Linearisation, observe, pair
from tests.stages.estimate.published import no_alignment, simulation

KNOT = 10.0


def hats(t: np.ndarray) -> np.ndarray:
    """(n, k) straight lines between knots at least KNOT apart, evenly spread over t."""
    knots = np.linspace(t[0], t[-1], max(int((t[-1] - t[0]) / KNOT), 1) + 1)
    return np.stack([np.interp(t, knots, row) for row in np.eye(len(knots))], axis=1)


def test_slow_part_is_the_least_squares_polyline_of_each_piece() -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.1, 0.3, 400))
    x = np.cumsum(rng.standard_normal((400, 2)), axis=0)
    found = slow_part(t, x, np.array([150]), KNOT)
    for piece in (slice(0, 150), slice(150, 400)):
        design = hats(t[piece])
        expected = design @ np.linalg.lstsq(design, x[piece], rcond=None)[0]
        np.testing.assert_allclose(found[piece], expected, atol=1e-9)


def test_a_jump_at_a_break_stays_and_pieces_of_a_sample_or_two_are_kept() -> None:
    t = np.arange(50) * 0.2
    x = np.where(t < 4.0, 1.0, 7.0)[:, None]
    np.testing.assert_allclose(slow_part(t, x, np.array([20, 48]), KNOT), x, atol=1e-12)


def sub_with_bias(trial: Trial, bias_dph: np.ndarray) -> Trial:
    """The trial with a constant on the sub-IMU's rates, in m-axes of an unturned sub-IMU."""
    return replace(trial, sub=replace(trial.sub, gyro=trial.sub.gyro + bias_dph * DEG_PER_HOUR))


def test_a_large_bias_is_taken_out_before_angles_are_taken_as_small() -> None:
    trial, added = simulation("idam", 120.0, 100.0, 4).trial, np.array([250.0, -150.0, 100.0])
    at = Linearisation.at(no_alignment())
    own, nothing = calibrated(partial(observe, pair(trial)), at)
    obs, taken = calibrated(partial(observe, pair(sub_with_bias(trial, added))), at)
    np.testing.assert_array_equal(nothing, 0.0)
    np.testing.assert_allclose(taken / DEG_PER_HOUR, added, atol=15.0)
    assert np.abs(obs.z - own.z).max() < np.radians(0.5)
