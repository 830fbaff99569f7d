"""The compiled 24-state filter against filterpy's classes, closed forms and finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import quaternions
from stages.estimate.rodrigues import kernel
from stages.estimate.rodrigues.filtering import Tuning, run
from tests.oracles.rodrigues_filterpy import FilterpyRodrigues, exact_flexure_step, jacobian, measurement
from tests.stages.estimate.rodrigues_case import Case, case, with_outliers

STEPS = 150


@pytest.fixture(scope="module")
def short() -> Case:
    return case(60.0, 1)


def cut(case: Case, steps: int) -> Case:
    names = ("dt", "jump", "q_m", "q_s", "omega", "omega_dot", "force", "W_s", "z", "sums", "good", "t", "stamp")
    data = replace(case.data, **{name: getattr(case.data, name)[:steps] for name in names})
    return replace(case, data=data)


def state(rng: np.random.Generator) -> np.ndarray:
    size = np.repeat([1e-2, 1.0, 1e-3, 1e-6, 1e-3, 0.1, 1e-3, 1e-3], 3)
    return size * rng.standard_normal(24)


@pytest.mark.parametrize(
    "tuned",
    [Tuning(), Tuning(kernel_width=3.0), Tuning(mpf_weight=100.0), Tuning(mpf_weight=100.0, kernel_width=3.0)],
    ids=["plain", "mce", "mpf", "mpf and mce"],
)
def test_equals_filterpy_to_rounding(short, tuned):
    few = cut(short, STEPS)
    rng = np.random.default_rng(4)
    good = few.data.good.copy()
    good[60:70] = False
    jump = few.data.jump.copy()
    jump[70] = [1e-8, 1e-4]
    few = replace(few, data=replace(few.data, z=with_outliers(few.data.z, 0.02, rng), good=good, jump=jump))
    given = few.setup(tuned)
    compiled = run(few.data, few.flexure, given, tuned)
    plain = FilterpyRodrigues(few.data, few.flexure.damping, few.flexure.stiffness, given, tuned)
    for k in range(1, STEPS):
        plain.step(k)
        assert compiled.theta[k] == pytest.approx(plain.filter.x[18:21], rel=1e-7, abs=1e-14)
    assert compiled.x == pytest.approx(plain.filter.x, rel=1e-7, abs=1e-13)
    scale = np.sqrt(np.outer(np.diag(plain.filter.P), np.diag(plain.filter.P)))
    assert np.max(np.abs(compiled.P - plain.filter.P) / scale) < 1e-6


def test_measurement_and_jacobian_against_the_printed_equation_and_differences():
    rng = np.random.default_rng(2)
    x, sums, W_s = (
        state(rng),
        np.concatenate([500.0 * rng.standard_normal(3), 0.3 * rng.standard_normal(3)]),
        np.ones(3),
    )
    C_s, C_m = Rotation.random(2, rng=rng).as_matrix()
    h, H = np.empty(6), np.zeros((6, 24))
    kernel._measure(x, sums, W_s, C_s, C_m, h, H)
    assert h == pytest.approx(measurement(x, sums, W_s, C_s, C_m), rel=1e-12)
    assert jacobian(x, sums, W_s, C_s, C_m) == pytest.approx(H, abs=1e-12)
    for i in range(24):
        step = np.zeros(24)
        step[i] = 1e-4
        difference = measurement(x + step, sums, W_s, C_s, C_m) - measurement(x - step, sums, W_s, C_s, C_m)
        assert H[:, i] == pytest.approx(difference / 2e-4, rel=1e-6, abs=1e-8)


def test_measurement_equation_holds_without_any_small_angle():
    """C W_m = W_s with C of any size: (W_s - W_m) = (W_s + W_m) x l exactly (67), (69)."""
    rng = np.random.default_rng(3)
    W_m = rng.standard_normal(3)
    C = Rotation.from_rotvec([0.5, -0.9, 1.1])
    angle = -C.as_rotvec()
    l_vector = np.tan(np.linalg.norm(angle) / 2) * angle / np.linalg.norm(angle)
    W_s = C.apply(W_m)
    assert W_s - W_m == pytest.approx(np.cross(W_s + W_m, l_vector), abs=1e-14)


@pytest.mark.parametrize(("damping", "stiffness"), [(0.2146, 0.2146**2), (0.1, 0.08), (0.4, 0.1)])
def test_flexure_steps_are_the_matrix_exponential(damping, stiffness):
    F = np.empty((3, 2, 2))
    kernel._flexure_steps(np.full(3, damping), np.full(3, stiffness), 0.01, F)
    assert F[1] == pytest.approx(exact_flexure_step(damping, stiffness, 0.01), abs=2e-7)


def test_covariance_of_the_total_is_that_of_finite_changes():
    rng = np.random.default_rng(5)
    x = np.zeros(24)
    x[:3], x[6:9] = [0.2, -0.1, 0.3], [1e-4, -2e-4, 1e-4]
    A_m, A_s = Rotation.random(2, rng=rng)

    def total(y: np.ndarray) -> Rotation:
        return A_m.inv() * Rotation.from_quat(np.append(y[:3], 1.0)) * Rotation.from_rotvec(y[6:9]) * A_s

    J = np.zeros((3, 24))
    for i in (0, 1, 2, 6, 7, 8):
        step = np.zeros(24)
        step[i] = 1e-6
        J[:, i] = (total(x + step) * total(x - step).inv()).as_rotvec() / 2e-6
    root = rng.standard_normal((24, 24))
    P, out = root @ root.T, np.empty((3, 3))
    kernel._total_covariance(x, P, A_m.as_matrix(), out)
    assert out == pytest.approx(J @ P @ J.T, rel=1e-3)


def test_lever_block_is_the_cross_product_and_the_second_derivative_of_it(short):
    """A_r1, A_r2, L_0 give ``theta'' x r + 2 omega x (theta' x r) + (omega' x + omega x omega x)(theta x r)``."""
    rng = np.random.default_rng(6)
    r, omega, change, theta, rate = (rng.standard_normal(3) for _ in range(5))
    damping, stiffness, w = np.array([0.1, 0.2, 0.3]), np.array([0.05, 0.07, 0.2]), rng.standard_normal(3)
    L_0 = -np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
    A = np.empty((3, 3, 3))
    kernel._lever_blocks(np.eye(3), omega, change, L_0, damping, stiffness, A)
    bend = w - 2 * damping * rate - stiffness * theta
    moved = np.cross(theta, r)
    expected = (
        np.cross(bend, r)
        + 2 * np.cross(omega, np.cross(rate, r))
        + np.cross(change, moved)
        + np.cross(omega, np.cross(omega, moved))
    )
    assert A[0] @ theta + A[1] @ rate + A[2] @ w == pytest.approx(expected, abs=1e-12)


def test_covariance_stays_symmetric_and_positive(short):
    tuned = Tuning(mpf_weight=100.0, kernel_width=3.0)
    found = run(short.data, short.flexure, short.setup(tuned), tuned)
    assert np.array_equal(found.P, found.P.T) or np.allclose(found.P, found.P.T, rtol=1e-10, atol=0.0)
    scale = np.sqrt(np.diag(found.P))
    assert np.linalg.eigvalsh(found.P / np.outer(scale, scale)).min() > 0.0


def test_nothing_of_the_caller_is_changed(short):
    tuned = Tuning(kernel_width=3.0)
    given = short.setup(tuned)
    before = given.x0.copy(), given.P0.copy(), short.data.z.copy()
    run(short.data, short.flexure, given, tuned)
    assert np.array_equal(given.x0, before[0])
    assert np.array_equal(given.P0, before[1])
    assert np.array_equal(short.data.z, before[2])


def test_the_total_starts_where_the_alignment_is(short):
    tuned = Tuning()
    found = run(short.data, short.flexure, short.setup(tuned), tuned)
    assert quaternions.log(found.total[:1])[0] == pytest.approx(short.alignment.static.value, abs=1e-12)
