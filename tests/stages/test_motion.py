"""The main gyro's noise and the motion behind it, on series whose noise is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stages.motion import likely, main_noise

RATE = 50.0
T = np.arange(6000) / RATE
STATIC = Rotation.from_rotvec([0.1, -0.2, 0.5])
WALK = 9e-5  # rad/sqrt(s)


def path(seed: int, main: float, sub: float) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes of both units by products of their increments: a rolling ship, bending, noise of each gyro."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 6.0, (2, 3))
    ship = Rotation.from_euler("XYZ", np.sin(np.multiply.outer(T, [0.8, 0.9, 0.7]) + phase[0]) * [0.02, 0.1, 0.03])
    bend = Rotation.from_rotvec(2e-3 * np.sin(np.multiply.outer(T, [1.1, 0.9, 1.3]) + phase[1]))
    out = []
    for true, noise in ((ship, main), (ship * bend * STATIC, sub)):
        turn = true[:-1].inv() * true[1:]
        turn = Rotation.from_rotvec(turn.as_rotvec() + noise / np.sqrt(RATE) * rng.standard_normal((len(T) - 1, 3)))
        attitude = [true[0]]
        for one in turn:
            attitude.append(attitude[-1] * one)
        out.append(Rotation.concatenate(attitude))
    return out[0].as_quat(), (out[1] * STATIC.inv()).as_quat()


@pytest.mark.parametrize(("main", "sub"), [(WALK, WALK), (WALK, 1e-7), (1e-7, WALK)])
def test_the_main_gyros_noise_is_told_from_the_other_ones(main: float, sub: float) -> None:
    found, std = main_noise(T, *path(1, main, sub), np.ones(len(T), bool))
    assert found == pytest.approx(main**2, abs=4.0 * std)
    assert std < 0.05 * WALK**2


def test_bridged_samples_do_not_count() -> None:
    main, sub = path(2, WALK, WALK)
    good = np.ones(len(T), bool)
    good[2000:2100] = False
    main[2000:2100] = main[2000]  # a frozen unit: at the end of it a jump
    found, std = main_noise(T, main, sub, good)
    assert found == pytest.approx(WALK**2, abs=4.0 * std)
    assert std < 0.05 * WALK**2


def test_a_record_too_short_tells_no_noise() -> None:
    assert main_noise(T[:60], *(q[:60] for q in path(3, WALK, WALK)), np.ones(60, bool)) == (0.0, np.inf)


def test_what_multiplies_the_likely_motion_is_not_underrated() -> None:
    """Regression of truth on the likely motion has slope one; on the measured one it falls short by noise over all."""
    rng = np.random.default_rng(4)
    t = 0.2 * np.arange(4000)
    true = sum(np.sin(np.multiply.outer(0.5 + 0.05 * k + 0.01 * np.arange(3), t)).T for k in range(8)) / 2.0
    seen = true + rng.standard_normal(true.shape)
    found = likely(seen, 1.0, 0.2)
    slope = lambda x: float(np.sum(x * true) / np.sum(x * x))  # noqa: E731
    assert slope(seen) < 0.6
    assert slope(found) == pytest.approx(1.0, abs=0.03)
    assert np.sum((found - true) ** 2) < 0.15 * np.sum((seen - true) ** 2)


def test_noise_alone_leaves_hardly_any_motion_but_its_mean() -> None:
    x = 5.0 + np.random.default_rng(5).standard_normal((500, 3))
    found = likely(x, 1.0, 0.2)
    np.testing.assert_allclose(found.mean(axis=0), x.mean(axis=0), rtol=1e-12)
    assert np.var(found) < 0.05


def test_without_noise_the_motion_is_what_was_measured() -> None:
    x = np.random.default_rng(6).standard_normal((50, 3))
    np.testing.assert_array_equal(likely(x, 0.0, 0.2), x)
