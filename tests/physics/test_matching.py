"""Strapdown, interpolation and bridging against trajectories known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import matching
from tests.twin.worlds import perfect
from twin import simulate

CONE, SPIN = np.radians(8.0), 1.7  # half angle rad, rad/s
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)
FORCE = np.array([0.8, -1.1, 0.6])  # amplitudes, m/s^2
PULSE = np.array([1.3, 0.9, 2.1])  # rad/s


def conical(t: np.ndarray) -> Rotation:
    """Rz(w t) Ry(a) Rz(-w t): the body's axis runs round a cone, the classic worst case of attitude algorithms."""
    zero, spin, tilt = np.zeros_like(t), SPIN * t, np.full_like(t, CONE)
    yz = Rotation.from_rotvec(np.stack([zero, tilt, zero], axis=1)) * Rotation.from_rotvec(
        np.stack([zero, zero, -spin], axis=1)
    )
    return Rotation.from_rotvec(np.stack([zero, zero, spin], axis=1)) * yz


def conical_increments(t: np.ndarray) -> np.ndarray:
    """Rotation vectors over the intervals that end at t; the increment of coning is of constant size."""
    attitude = conical(t)
    return (attitude[:-1].inv() * attitude[1:]).as_rotvec()


def inertial_force(t: np.ndarray) -> np.ndarray:
    return np.array([0.0, 0.0, 9.81]) + FORCE * np.sin(np.multiply.outer(t, PULSE))


def inertial_velocity(t: np.ndarray) -> np.ndarray:
    return np.outer(t, [0.0, 0.0, 9.81]) + FORCE / PULSE * (1.0 - np.cos(np.multiply.outer(t, PULSE)))


def unit(duration: float, step: float) -> matching.Unit:
    """A perfect unit on the cone: exact increments, forces as means over the intervals (Gauss, 12 nodes)."""
    t = step * np.arange(round(duration / step) + 1)
    gyro = np.concatenate([np.zeros((1, 3)), conical_increments(t) / step])
    nodes = (t[1:, None] + 0.5 * step * (NODES - 1.0)).ravel()
    body = conical(nodes).inv().apply(inertial_force(nodes)).reshape(-1, len(NODES), 3)
    accel = np.concatenate([np.zeros((1, 3)), 0.5 * np.einsum("j,kji->ki", WEIGHTS, body)])
    return matching.Unit(t, gyro, accel, np.zeros(len(t), bool))


def turned(path: matching.Strapdown) -> Rotation:
    return conical(np.zeros(1)) * Rotation.from_quat(path.attitude)


def test_strapdown_reproduces_conical_motion() -> None:
    t = unit(120.0, 0.01)
    path = matching.strapdown(t)
    assert np.abs((turned(path).inv() * conical(path.t)).as_rotvec()).max() < 1e-12
    np.testing.assert_array_equal(path.attitude[0], [0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(np.linalg.norm(path.attitude, axis=1), 1.0, atol=1e-14)


def test_both_paths_of_a_noiseless_twin_meet_in_the_total_deformation() -> None:
    tables = {"mount": {"static_arcmin": [360.0, -900.0, 200.0]}, "run": {"duration": 60.0, "rate": 100.0}}
    simulation = simulate(perfect(**tables), np.random.default_rng(2))
    trial, total = simulation.trial, Rotation.from_rotvec(simulation.truth.total)
    t, never = trial.seconds(trial.main.stamp), np.zeros(6000, bool)
    main = matching.strapdown(matching.Unit(t, trial.main.gyro, trial.main.accel, never))
    sub = matching.strapdown(matching.Unit(t, trial.sub.gyro, trial.sub.accel, never))
    found = Rotation.from_quat(main.attitude).inv() * total[0] * Rotation.from_quat(sub.attitude)
    assert np.abs((found * total.inv()).as_rotvec()).max() < 1e-9


def velocity_error(step: float) -> float:
    path = matching.strapdown(unit(20.0, step))
    found = conical(np.zeros(1)).apply(path.velocity)
    # The first interval has no one before it to tell how the rate varies: leave it out of the order.
    return float(np.abs((found - found[1]) - (inertial_velocity(path.t) - inertial_velocity(path.t[1])))[1:].max())


def test_velocity_converges_with_the_third_power_of_the_step() -> None:
    """Rotation within the sample to second order, and rate and force varying linearly: what is left is of third."""
    coarse, middle, fine = (velocity_error(step) for step in (0.04, 0.02, 0.01))
    assert np.log2(coarse / middle) > 2.8
    assert np.log2(middle / fine) > 2.8
    assert fine < 1e-6  # of 200 m/s


def test_sculling_matters_where_rate_and_force_go_together() -> None:
    """Rotation about x in phase with force along y drifts along z by the rectified product unless it is corrected."""
    step, w = 0.02, 8.0
    t = step * np.arange(1001)
    swing = lambda x: np.stack([0.02 * np.sin(w * x), 0.0 * x, 0.0 * x], axis=1)  # noqa: E731
    nodes = t[1:, None] + 0.5 * step * (NODES - 1.0)
    push = np.stack([0.0 * nodes, 2.0 * np.sin(w * nodes), 0.0 * nodes], axis=2)
    accel = 0.5 * np.einsum("j,kji->ki", WEIGHTS, push)
    gyro = np.diff(swing(t), axis=0) / step
    zero = np.zeros((1, 3))
    path = matching.strapdown(
        matching.Unit(t, np.concatenate([zero, gyro]), np.concatenate([zero, accel]), np.zeros(1001, bool))
    )
    # A f = (0, cos a f, sin a f), a = 0.02 sin wt, f = 2 sin wt: the mean along z is about 0.02.
    fine = np.linspace(0.0, t[-1], 200_001)
    a, f = 0.02 * np.sin(w * fine), 2.0 * np.sin(w * fine)
    assert path.velocity[-1, 2] == pytest.approx(np.trapezoid(np.sin(a) * f, fine), rel=1e-4)


def test_interpolation_is_exact_for_steady_rotation_and_cubic_velocity() -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.05, 0.15, 40))
    rate = np.array([0.9, -2.0, 1.4])
    cubic = lambda x: np.stack([x**3 - x, 2.0 - x**2, 0.3 * x**3 + x], axis=1)  # noqa: E731
    path = matching.Strapdown(t, Rotation.from_rotvec(np.outer(t, rate)).as_quat(), cubic(t))
    at = np.linspace(t[0], t[-1], 997)
    found = matching.interpolate(path, at)
    expected = Rotation.from_rotvec(np.outer(at, rate))
    assert np.abs((Rotation.from_quat(found.attitude).inv() * expected).as_rotvec()).max() < 1e-13
    np.testing.assert_allclose(found.velocity, cubic(at), atol=1e-11)
    np.testing.assert_array_equal(found.t, at)


def test_interpolation_hits_the_stamps_whatever_the_sign_of_the_quaternions() -> None:
    t = 0.1 * np.arange(50)
    quaternions = conical(t).as_quat() * np.where(np.arange(50) % 2, 1.0, -1.0)[:, None]
    found = matching.interpolate(matching.Strapdown(t, quaternions, inertial_velocity(t)), t)
    assert np.abs((Rotation.from_quat(found.attitude).inv() * conical(t)).as_rotvec()).max() < 1e-14
    np.testing.assert_allclose(found.velocity, inertial_velocity(t), atol=1e-13)


def interpolation_error(step: float) -> tuple[float, float]:
    t = step * np.arange(round(20.0 / step) + 1)
    at = np.linspace(2 * step, 20.0 - 2 * step, 5001)
    found = matching.interpolate(matching.Strapdown(t, conical(t).as_quat(), inertial_velocity(t)), at)
    angle = np.abs((Rotation.from_quat(found.attitude).inv() * conical(at)).as_rotvec()).max()
    return float(angle), float(np.abs(found.velocity - inertial_velocity(at)).max())


def test_interpolation_is_of_fourth_order() -> None:
    coarse, fine = interpolation_error(0.1), interpolation_error(0.05)
    assert np.log2(coarse[0] / fine[0]) == pytest.approx(4.0, abs=0.3)
    assert np.log2(coarse[1] / fine[1]) == pytest.approx(4.0, abs=0.3)


def test_interpolation_refuses_instants_outside_and_paths_too_short() -> None:
    path = matching.Strapdown(np.arange(5.0), np.tile([0.0, 0.0, 0.0, 1.0], (5, 1)), np.zeros((5, 3)))
    for outside in (-0.1, 4.1):
        with pytest.raises(ValueError, match="outside"):
            matching.interpolate(path, np.array([outside]))
    short = matching.Strapdown(path.t[:3], path.attitude[:3], path.velocity[:3])
    with pytest.raises(ValueError, match="four"):
        matching.interpolate(short, np.array([1.0]))


def test_deformation_is_the_product_of_its_rotations_and_increments_are_logarithms() -> None:
    rng = np.random.default_rng(5)
    a_m, a_s = Rotation.random(50, rng=rng), Rotation.random(50, rng=rng)
    d, shift = 0.3 * rng.standard_normal((2, 50, 3))
    expected = Rotation.from_rotvec(shift - a_m.inv().apply(d)) * a_m.inv() * a_s
    found = matching.deformation(a_m.as_quat(), a_s.as_quat(), d, shift)
    np.testing.assert_allclose((Rotation.from_quat(found) * expected.inv()).as_rotvec(), 0.0, atol=1e-14)
    steps = (expected[1:] * expected[:-1].inv()).as_rotvec()
    np.testing.assert_allclose(matching.increments(found), steps, atol=1e-13)


def test_step_means_are_those_of_the_trapezoid_rule() -> None:
    t = 0.02 * np.arange(101)
    index = np.array([0, 10, 35, 100])
    A = conical(t).as_matrix()
    main = matching.Strapdown(t, conical(t).as_quat(), inertial_velocity(t))
    sub = matching.Strapdown(t, main.attitude, np.stack([t**2, np.sin(t), 1.0 + t], axis=1))
    A_end, A_mean, u_mean = matching.step_means(main, sub, index)
    u = np.einsum("kji,kj->ki", A, sub.velocity - main.velocity)
    np.testing.assert_allclose(A_end, A[index], atol=1e-14)
    for k in range(1, 4):
        part = slice(index[k - 1], index[k] + 1)
        length = t[part][-1] - t[part][0]
        np.testing.assert_allclose(A_mean[k], np.trapezoid(A[part], t[part], axis=0) / length, atol=1e-13)
        np.testing.assert_allclose(u_mean[k], np.trapezoid(u[part], t[part], axis=0) / length, atol=1e-12)


def test_interval_means_are_exact_for_cubics() -> None:
    t = 0.05 * np.arange(60)
    primitive = np.stack([t**4 / 4 - t, t**3 / 3 + t**2, 2 * t**4 - t**3], axis=1)
    values = np.stack([t**3 - 1, t**2 + 2 * t, 8 * t**3 - 3 * t**2], axis=1)
    means = matching.interval_means(values)
    np.testing.assert_allclose(means[2:-1], (np.diff(primitive, axis=0) / 0.05)[1:-1], atol=1e-12)
    np.testing.assert_allclose(means[[1, -1]], (np.diff(primitive, axis=0) / 0.05)[[0, -1]], atol=0.005)


def test_bridge_leaves_a_gapless_record_alone() -> None:
    rng = np.random.default_rng(3)
    t = 0.01 * np.arange(200) + rng.uniform(-0.002, 0.002, 200)
    gyro, accel = rng.standard_normal((2, 200, 3))
    found = matching.bridge(t, gyro, accel)
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_array_equal(found.gyro, gyro)
    np.testing.assert_array_equal(found.accel, accel)
    assert not found.filled.any()


def test_bridge_fills_gaps_at_the_nominal_rate_and_marks_what_it_put_in() -> None:
    full = 0.01 * np.arange(1000)
    lost = np.zeros(1000, bool)
    lost[[50, 51, 300]] = True
    lost[600:850] = True
    line = np.stack([full, 2 - full, 3 * full], axis=1)
    found = matching.bridge(full[~lost], line[~lost], -line[~lost])
    np.testing.assert_allclose(found.t, full, atol=1e-12)
    np.testing.assert_array_equal(found.filled, lost)
    np.testing.assert_allclose(found.gyro, line, atol=1e-12)
    np.testing.assert_allclose(found.accel, -line, atol=1e-12)


def test_after_a_gap_of_no_whole_number_of_samples_the_measured_intervals_are_nominal() -> None:
    """The mean that ends the gap belongs to the nominal interval before its stamp, not to all of the gap."""
    t = np.concatenate([0.01 * np.arange(100), 0.01 * np.arange(100) + 5.0037])
    values = np.ones((200, 3))
    found = matching.bridge(t, values, values)
    assert np.diff(found.t).min() > 0.0
    assert np.diff(found.t).max() < 0.016
    np.testing.assert_allclose(np.diff(found.t)[~found.filled[1:]], 0.01, atol=1e-12)
    measured = found.t[~found.filled]
    np.testing.assert_array_equal(measured, t)
