"""The published recipe: its window, its reduced filter against the full 12 states, and what it reaches."""

import numpy as np
import pytest
import pywt
from filterpy.kalman import KalmanFilter
from scipy.linalg import solve_discrete_are

from stages.shape.wavelet_kalman import (
    WaveletKalmanShape,
    db3_taps,
    filtered,
    gains,
    ins_model,
    moving_db3,
    sins_model,
)
from tests.stages.shape.generator import Case, curvature, rms, trial

STEP = 0.01
BETA, SIGMA = (0.15, 0.12, 0.10), (5.0, 5.0, 20.0)


def rates(n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(2)
    return 1e-4 * np.sin(np.arange(n)[:, None] * 0.02 + np.arange(3)) + 1e-5 * rng.standard_normal((n, 3))


def test_window_keeps_the_last_point_of_pywavelets_on_each_six_samples() -> None:
    x = rates(40)
    out = moving_db3(x)
    for k in (5, 17, 39):
        for axis in range(3):
            coarse, _ = pywt.dwt(x[k - 5 : k + 1, axis], "db3")
            assert out[k, axis] == pytest.approx(pywt.idwt(coarse, None, "db3")[5], rel=1e-12)
    np.testing.assert_array_equal(out[:5], x[:5])


def test_window_hardly_touches_noise_as_limits_say() -> None:
    taps = db3_taps()
    assert taps.sum() == pytest.approx(1.0)
    assert np.sqrt(np.sum(taps**2)) == pytest.approx(1.07, abs=0.01)


@pytest.mark.parametrize("which", ["ins", "sins"])
def test_reduced_filter_equals_the_twelve_state_filter(which: str) -> None:
    z = rates()
    model = ins_model(z, STEP, None) if which == "ins" else sins_model(z, STEP, BETA, SIGMA, True)
    run = np.repeat([0, 1], 200)
    mine, variance = filtered(model, z, run)
    full = KalmanFilter(dim_x=12, dim_z=6)  # position, velocity, angle, rate (three each); position and rate measured
    full.F = np.eye(12)
    full.F[:3, 3:6] = STEP * np.eye(3)
    full.Q, full.R = 1e-6 * np.eye(12), np.diag([1e-2] * 3 + list(model.variance))
    for axis in range(3):
        at = np.ix_([6 + axis, 9 + axis], [6 + axis, 9 + axis])
        full.F[at], full.Q[at] = model.transition[axis], model.noise[axis]
    full.H = np.zeros((6, 12))
    full.H[:3, :3] = full.H[3:, 9:] = np.eye(3)
    arcmin = np.pi / 180 / 60
    for start in (0, 200):
        full.x, full.P = np.zeros((12, 1)), np.diag([1.0] * 6 + [(20 * arcmin) ** 2] * 3 + [1e-4] * 3)
        for k in range(start, start + 200):
            if k > start:
                full.predict()
            full.update(np.concatenate([[0.0, 0.1 * k, 0.0], z[k]])[:, None])
            np.testing.assert_allclose(mine[k], full.x[9:, 0], rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(variance, np.diag(full.P)[9:], rtol=1e-9)


def test_transition_is_the_closed_form_of_a_critically_damped_flexure() -> None:
    model = sins_model(rates(), STEP, BETA, SIGMA, True)
    b, e = BETA[0], np.exp(-BETA[0] * STEP)
    expected = e * np.array([[1 + b * STEP, STEP], [-(b**2) * STEP, 1 - b * STEP]])
    np.testing.assert_allclose(model.transition[0], expected, rtol=1e-12)
    stationary = np.diag([1.0, b**2]) * (SIGMA[0] * np.pi / 10800) ** 2
    leaves = model.transition[0] @ stationary @ model.transition[0].T + model.noise[0]
    np.testing.assert_allclose(leaves, stationary, atol=1e-12 * stationary[0, 0])


def test_variance_settles_where_the_riccati_equation_says() -> None:
    model = sins_model(rates(), STEP, BETA, SIGMA, True)
    _, variance = gains(model, 6000)
    for axis in range(3):
        R = model.variance[axis]
        before = solve_discrete_are(
            model.transition[axis].T, np.array([[0.0], [1.0]]), model.noise[axis], np.array([[R]])
        )[1, 1]
        assert variance[axis] == pytest.approx(before * R / (before + R), rel=1e-3)


def test_recipe_finds_the_shape_and_its_danger_zone() -> None:
    data, _ = trial(Case(passes=4))
    shape = WaveletKalmanShape(limit=(1e-4, 1e-4, 1e-4)).shape(data)
    assert np.all(rms(shape.curvature - curvature(shape.arc_length)) < 5e-6)
    zone = shape.arc_length[shape.exceeds[:, 0]]
    assert 0.0 < zone.min() < 2.0
    assert 5.0 < zone.max() < 12.0
    assert not shape.exceeds[:, 2].any()


def test_printed_forms_fail() -> None:
    data, _ = trial(Case(passes=4))
    error = [
        rms(s.curvature - curvature(s.arc_length))
        for s in (WaveletKalmanShape().shape(data), WaveletKalmanShape(as_printed=True).shape(data))
    ]
    assert np.all(error[1][:2] > 10.0 * error[0][:2])
