"""Slow bending against slow flexure: the likelihood is the joint one, and flexure alone gains nothing by a sine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physics import flexure
from physics.units import ARCMIN
from schemas.products import FlexureModel
from stages.diagnose import slow

MU, B2, STD = 0.08, 0.0064, 5.0 * ARCMIN
STEP, LENGTH = 0.5, 900.0
WALK = (0.002 * ARCMIN) ** 2


def seen(rng: np.random.Generator, bending: float = 0.0, period: float = 700.0) -> slow.Angle:
    """Critically damped flexure about each axis, a gyro's walk, and a sine about y (arcmin)."""
    t = np.arange(0.0, LENGTH, STEP)
    theta = np.stack([flexure.sample(MU, B2, STD, np.full(len(t) - 1, STEP), rng)[0] for _ in range(3)], axis=1)
    theta += np.sqrt(WALK * STEP) * np.cumsum(rng.standard_normal(theta.shape), axis=0)
    theta[:, 1] += bending * ARCMIN * np.sin(2.0 * np.pi * t / period)
    one = np.repeat(np.eye(3)[None], len(t), axis=0)
    free = np.concatenate([one, one * (t / LENGTH)[:, None, None]], axis=2)
    believed = np.log(np.tile([MU, B2, STD], (3, 1)))
    return slow.Angle(t, theta, free, np.full(len(t), WALK * STEP), believed, believed)


def sine(angle: slow.Angle, period: float) -> np.ndarray:
    return np.sin(2.0 * np.pi * angle.t / period)[:, None]


NOTHING = np.zeros((int(LENGTH / STEP), 0))


def test_slow_flexure_by_itself_is_no_bending_of_the_sun() -> None:
    gained = []
    for seed in range(3):
        angle = seen(np.random.default_rng(seed))
        lesser = slow.fit(angle, NOTHING).nats.sum()
        gained.append(
            max(slow.fit(angle, sine(angle, period)).nats.sum() - lesser for period in (500.0, 900.0, 2000.0))
        )
    assert max(gained) < slow.price(4, angle) + 6.0


def test_bending_that_flexure_cannot_explain_is_told() -> None:
    angle = seen(np.random.default_rng(5), bending=25.0)
    found = slow.fit(angle, sine(angle, 700.0))
    gained = found.nats - slow.fit(angle, NOTHING).nats
    assert gained[1] > 30.0
    assert abs(gained[[0, 2]]).max() < 8.0
    np.testing.assert_allclose(found.x[1], angle.believed[1], atol=0.7)


def test_the_flexure_is_found_beside_slow_bending() -> None:
    angle = seen(np.random.default_rng(6), bending=60.0)
    start = FlexureModel(
        "soft", np.full(3, MU), np.full(3, B2 / 3.0), np.full(3, 3.0 * STD), np.zeros((3, 3, 3)), np.zeros(3)
    )
    angle = replace(angle, start=np.log(np.stack([start.damping, start.stiffness, start.std], axis=1)))
    found = slow.sober(start, angle, np.zeros((len(angle.t), 0)))
    np.testing.assert_allclose(np.log(found.std / STD), 0.0, atol=0.4)
    np.testing.assert_allclose(np.log(found.damping / MU), 0.0, atol=0.3)


def test_columns_that_are_one_another_or_nothing_gain_what_one_of_them_does() -> None:
    angle = seen(np.random.default_rng(5), bending=20.0)
    one = sine(angle, 700.0)
    alone, twice = slow.fit(angle, one), slow.fit(angle, np.hstack([one, one, 0.0 * one]))
    np.testing.assert_allclose(twice.nats, alone.nats, atol=0.1)


def test_gaps_are_bridged() -> None:
    angle = seen(np.random.default_rng(7), bending=25.0)
    angle.theta[600:700] = np.nan
    assert slow.fit(angle, sine(angle, 700.0)).nats.sum() - slow.fit(angle, NOTHING).nats.sum() > 25.0


def test_what_the_angle_changes_by_while_the_gyros_are_silent_is_no_bending() -> None:
    angle = seen(np.random.default_rng(7), bending=25.0)
    angle.walk[700] += slow.SILENT**2
    moved = replace(angle, theta=angle.theta + 40.0 * ARCMIN * (np.arange(len(angle.t)) >= 700)[:, None])
    gained = [float(np.sum(slow.fit(a, sine(a, 700.0)).nats - slow.fit(a, NOTHING).nats)) for a in (angle, moved)]
    assert gained[0] > 10.0
    assert gained[1] == pytest.approx(gained[0], abs=2.0)
