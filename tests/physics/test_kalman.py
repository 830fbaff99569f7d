"""The sparse filter and smoother against one dense normal distribution, and against filterpy."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from physics.kalman import SparseModel, log_likelihood, run_filter, run_pieces, run_smoother, selected
from tests.oracles.dense_gaussian import DenseModel, condition

SEEDS = pytest.mark.parametrize("seed", range(6))


def random_models(seed: int, steps: int = 25, n: int = 7, m: int = 3, missing: float = 0.3) -> tuple:
    """The same random model twice, sparse and dense: nearly noise-free rows, entries given twice, padding, NaN."""
    rng = np.random.default_rng(seed)
    e_row, e_col = rng.integers(0, n, 12), rng.integers(0, n, 12)
    e_row[-1], e_col[-1] = e_row[0], e_col[0]  # an entry given twice counts twice
    E = 0.3 * rng.standard_normal((steps, 12))
    E[:, 3] = 0.0
    root = 0.3 * rng.standard_normal((steps, n, 2))
    root[:, n - 2 :] = 0.0  # constants among the states
    Q = root @ np.swapaxes(root, 1, 2)
    q_row, q_col = np.triu_indices(n - 2)
    q = Q[:, q_row, q_col]
    q_row, q_col, q = np.append(q_row, 0), np.append(q_col, 1), np.concatenate([q, 0.02 * q[:, :1]], axis=1)
    Q[:, 0, 1] += q[:, -1]
    Q[:, 1, 0] += q[:, -1]
    Q[:, [0, 1], [0, 1]] += 0.1  # keeps Q positive with the extra entry
    q[:, (q_row == q_col) & (q_row < 2)] += 0.1
    h_col = np.array([rng.permutation(n)[:4] for _ in range(m)])
    h_col[:, 3] = 0  # padding: value zero at a column used elsewhere
    H = rng.standard_normal((steps, m, 4))
    H[:, :, 3] = 0.0
    R = rng.uniform(0.1, 2.0, (steps, m))
    R[:, 0] = 1e-4
    z = 2.0 * rng.standard_normal((steps, m))
    z[rng.random((steps, m)) < missing] = np.nan
    z[7] = np.nan if missing else z[7]
    half = rng.standard_normal((n, n))
    x0, P0 = rng.standard_normal(n), half @ half.T + 0.1 * np.eye(n)
    F, dense_H = np.tile(np.eye(n), (steps, 1, 1)), np.zeros((steps, m, n))
    for a in range(12):
        F[:, e_row[a], e_col[a]] += E[:, a]
    for i in range(m):
        for a in range(4):
            dense_H[:, i, h_col[i, a]] += H[:, i, a]
    return SparseModel(e_row, e_col, E, q_row, q_col, q, h_col, H, z, R, x0, P0), DenseModel(
        F, Q, dense_H, z, R, x0, P0
    )


@SEEDS
def test_smoothed_means_and_covariances_are_those_of_the_joint_distribution(seed: int) -> None:
    sparse, dense = random_models(seed)
    out = np.array([0, 3, 5, 6])
    smoothed = run_smoother(sparse, run_filter(sparse, out))
    mean, covariance, _ = condition(dense)
    scale = np.abs(mean).max()
    np.testing.assert_allclose(smoothed.x, mean[:, out], rtol=1e-9, atol=1e-9 * scale)
    np.testing.assert_allclose(smoothed.P, covariance[:, out][:, :, out], rtol=1e-8, atol=1e-9 * covariance.max())


@SEEDS
def test_filtered_means_and_covariances_see_the_past_alone(seed: int) -> None:
    sparse, dense = random_models(seed)
    out = np.array([1, 2, 4])
    filtered = run_filter(sparse, out)
    for k in (0, 6, 7, 16, 24):
        mean, covariance, _ = condition(dense, last=k)
        np.testing.assert_allclose(filtered.x[k], mean[k], rtol=1e-9, atol=1e-9 * np.abs(mean[k]).max())
        np.testing.assert_allclose(filtered.P_out[k], covariance[k][out], rtol=1e-8, atol=1e-9 * covariance[k].max())
    np.testing.assert_allclose(filtered.P_last, condition(dense)[1][-1], rtol=1e-8, atol=1e-9)


@SEEDS
def test_log_likelihood_is_the_density_of_all_measurements(seed: int) -> None:
    sparse, dense = random_models(seed)
    expected = condition(dense)[2]
    assert run_filter(sparse, np.array([0])).log_likelihood == pytest.approx(expected, rel=1e-9)
    assert run_filter(sparse, np.array([0]), keep=False).log_likelihood == pytest.approx(expected, rel=1e-9)


@SEEDS
def test_forward_pass_equals_filterpy_with_joint_updates(seed: int) -> None:
    sparse, dense = random_models(seed, missing=0.0)
    filtered = run_filter(sparse, np.arange(7))
    reference = KalmanFilter(dim_x=7, dim_z=3)
    reference.x, reference.P = dense.x0.copy(), dense.P0.copy()
    for k in range(len(dense.F)):
        reference.predict(F=dense.F[k], Q=dense.Q[k])
        np.testing.assert_allclose(filtered.innovation[k, 0], dense.z[k, 0] - dense.H[k, 0] @ reference.x, atol=1e-8)
        first = dense.H[k, 0] @ reference.P @ dense.H[k, 0] + dense.R[k, 0]
        np.testing.assert_allclose(filtered.innovation_variance[k, 0], first, rtol=1e-8)
        reference.update(dense.z[k], R=np.diag(dense.R[k]), H=dense.H[k])
        np.testing.assert_allclose(filtered.x[k], reference.x, rtol=1e-8, atol=1e-8 * np.abs(reference.x).max())
        np.testing.assert_allclose(filtered.P_out[k], reference.P, rtol=1e-8, atol=1e-9 * reference.P.max())


def test_without_measurements_the_prior_runs_on() -> None:
    sparse, dense = random_models(1)
    sparse = replace(sparse, z=np.full_like(sparse.z, np.nan))
    filtered = run_filter(sparse, np.arange(7))
    smoothed = run_smoother(sparse, filtered)
    x, P = dense.x0, dense.P0
    for k in range(len(dense.F)):
        x, P = dense.F[k] @ x, dense.F[k] @ P @ dense.F[k].T + dense.Q[k]
    np.testing.assert_allclose(smoothed.x[-1], x, rtol=1e-12)
    np.testing.assert_allclose(smoothed.P[-1], P, rtol=1e-12)
    assert filtered.log_likelihood == 0.0
    assert np.isnan(filtered.innovation).all()


def test_smoother_and_filter_agree_at_the_last_step() -> None:
    sparse, _ = random_models(2)
    filtered = run_filter(sparse, np.arange(7))
    smoothed = run_smoother(sparse, filtered)
    np.testing.assert_array_equal(smoothed.x[-1], filtered.x[-1])
    np.testing.assert_allclose(smoothed.P[-1], filtered.P_last, rtol=1e-12, atol=1e-14)


def cut(model: SparseModel, part: slice) -> SparseModel:
    per_step = ("transition", "noise", "measurement", "z", "variance")
    return replace(model, **{name: getattr(model, name)[part] for name in per_step})


@SEEDS
@pytest.mark.parametrize("edges", [[0, 25], [0, 8, 25], [0, 1, 2, 17, 25]])
def test_a_record_in_pieces_gives_what_it_gives_as_a_whole(seed: int, edges: list[int]) -> None:
    sparse, _ = random_models(seed)
    out = np.array([0, 3, 6])
    whole = run_filter(sparse, out)
    smoothed = run_smoother(sparse, whole)
    pieces = [partial(cut, sparse, slice(a, b)) for a, b in pairwise(edges)]
    course, in_pieces = run_pieces(pieces, out)
    np.testing.assert_allclose(in_pieces.x, smoothed.x, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(in_pieces.P, smoothed.P, rtol=1e-10, atol=1e-12)
    _, means_alone = run_pieces(pieces, out, 0)
    np.testing.assert_allclose(means_alone.x, smoothed.x, rtol=1e-10, atol=1e-12)
    assert means_alone.P.shape == (0, 3, 3)
    np.testing.assert_array_equal(course.x, whole.x[:, out])
    np.testing.assert_array_equal(course.P, whole.P_out[:, :, out])
    np.testing.assert_array_equal(course.innovation, whole.innovation)
    np.testing.assert_array_equal(course.x_last, whole.x[-1])
    np.testing.assert_array_equal(course.P_last, whole.P_last)
    assert course.log_likelihood == pytest.approx(whole.log_likelihood, rel=1e-12)
    assert log_likelihood(pieces) == pytest.approx(whole.log_likelihood, rel=1e-12)


def test_states_that_nothing_sees_can_be_left_out() -> None:
    sparse, _ = random_models(4)
    # Two states more, in front and in the middle, that are driven by the others and drive none.
    kept = np.array([1, 2, 3, 5, 6, 7, 8])
    P0 = np.eye(9)
    P0[np.ix_(kept, kept)] = sparse.P0
    x0 = np.full(9, 3.0)
    x0[kept] = sparse.x0
    larger = replace(
        sparse,
        transition_row=np.append(kept[sparse.transition_row], [0, 4]),
        transition_col=np.append(kept[sparse.transition_col], [3, 4]),
        transition=np.hstack([sparse.transition, np.ones((25, 2))]),
        noise_row=np.append(kept[sparse.noise_row], 4),
        noise_col=np.append(kept[sparse.noise_col], 4),
        noise=np.hstack([sparse.noise, np.ones((25, 1))]),
        measurement_col=np.where(sparse.measurement[0] == 0.0, 0, kept[sparse.measurement_col]),
        x0=x0,
        P0=P0,
    )
    smaller, full = run_filter(selected(larger, kept), np.arange(7)), run_filter(larger, kept)
    np.testing.assert_allclose(smaller.x, full.x[:, kept], rtol=1e-12)
    np.testing.assert_allclose(smaller.P_out, full.P_out[:, :, kept], rtol=1e-12)
    assert smaller.log_likelihood == pytest.approx(full.log_likelihood, rel=1e-12)


def test_inputs_are_left_alone_and_keeping_nothing_changes_no_figure() -> None:
    sparse, _ = random_models(3)
    before = {name: np.array(value) for name, value in vars(sparse).items()}
    filtered = run_filter(sparse, np.array([0]))
    run_smoother(sparse, filtered)
    for name, value in vars(sparse).items():
        np.testing.assert_array_equal(value, before[name])
    short = run_filter(sparse, np.array([0]), keep=False)
    np.testing.assert_array_equal(short.P_last, filtered.P_last)
    np.testing.assert_array_equal(short.innovation, filtered.innovation)
    assert short.x.size == 0


def test_standardised_innovations_of_the_true_model_are_white_and_of_unit_variance() -> None:
    rng = np.random.default_rng(5)
    steps, n = 4000, 2
    E = np.tile([-0.1, 0.1], (steps, 1))
    sparse = SparseModel(
        np.array([0, 1]), np.array([0, 0]), E, np.arange(n), np.arange(n), np.full((steps, n), 0.04),
        np.array([[0, 1]]), np.tile([[[1.0, 0.5]]], (steps, 1, 1)), np.zeros((steps, 1)), np.full((steps, 1), 0.5),
        np.zeros(n), np.eye(n),
    )  # fmt: skip
    x, z = rng.standard_normal(n), np.empty((steps, 1))
    for k in range(steps):
        x = np.array([0.9 * x[0], x[1] + 0.1 * x[0]]) + 0.2 * rng.standard_normal(n)
        z[k] = x[0] + 0.5 * x[1] + np.sqrt(0.5) * rng.standard_normal()
    filtered = run_filter(replace(sparse, z=z), np.arange(n))
    nu = (filtered.innovation / np.sqrt(filtered.innovation_variance)).ravel()
    assert np.mean(nu**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / steps))
    for lag in (1, 2, 5):
        assert abs(np.mean(nu[lag:] * nu[:-lag])) < 4 / np.sqrt(steps)
