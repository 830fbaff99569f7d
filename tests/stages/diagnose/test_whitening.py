"""The lean filter against one dense normal distribution and closed forms; regressors through its gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physics.kalman import SparseModel, run_filter
from physics.rotations import exp
from schemas.products import Alignment, Estimate, FlexureModel
from stages.diagnose import whitening
from stages.diagnose.view import believed
from stages.diagnose.whitening import AccelColour, Levels, PhinsMatch
from stages.estimate import model as full_model
from stages.estimate import tuning
from stages.paired import Linearisation, Observations, observe, pair
from tests.oracles.dense_gaussian import DenseModel, condition, path_prior
from twin import load_twin, simulate, with_run

ARCMIN = np.pi / 10800.0
TWIN = with_run(load_twin("random-sea"), duration=40.0)
PER_STEP = full_model.PER_STEP
STEPS = 18


def dense(model: SparseModel) -> DenseModel:
    """The same model with full matrices."""
    N, n, m = len(model.z), len(model.x0), model.z.shape[1]
    F, Q, H = np.tile(np.eye(n), (N, 1, 1)), np.zeros((N, n, n)), np.zeros((N, m, n))
    for a, (row, col) in enumerate(zip(model.transition_row, model.transition_col)):
        F[:, row, col] += model.transition[:, a]
    for a, (row, col) in enumerate(zip(model.noise_row, model.noise_col)):
        Q[:, row, col] += model.noise[:, a]
        if row != col:
            Q[:, col, row] += model.noise[:, a]
    for i in range(m):
        for a, col in enumerate(model.measurement_col[i]):
            H[:, i, col] += model.measurement[:, i, a]
    return DenseModel(F, Q, H, model.z, model.variance, model.x0, model.P0)


class Case:
    """A few steps of a simulated log, and all noise of the model."""

    def __init__(self) -> None:
        source = believed(simulate(TWIN, np.random.default_rng(4)).trial, TWIN)
        self.trial = source.trial
        rotation = exp(source.static)
        alignment = Alignment(
            rotation, Estimate(source.static, np.full(3, 1e-3)), 1e-6 * np.eye(3),
            Estimate(np.asarray(0.0), np.asarray(1e-4)),
        )  # fmt: skip
        self.at = Linearisation.at(alignment, source.lever_arm)
        self.whole = observe(pair(source.trial, despike=False), self.at)
        self.matched = whitening.phins_match(source.trial, self.whole)
        mu, frequency = np.array(TWIN.flexure.damping), np.array(TWIN.flexure.frequency)
        std = np.array(TWIN.flexure.std_arcmin) * ARCMIN
        flexure = FlexureModel("known", mu, mu**2 + frequency**2, std, np.zeros((3, 3, 3)), np.full(3, 4e-7))
        noise = replace(
            tuning.initial(alignment, flexure, source.trial.rig), jitter=np.full(3, 1e-5), velocity=np.full(3, 1e-4)
        )
        phins = whitening.phins_noise(TWIN.phins)
        self.levels = Levels(noise, AccelColour(np.array([1e-3, 2e-3, 5e-4]), 2.0), phins)
        cut = slice(40, 40 + STEPS)
        self.obs = replace(self.whole, **{name: getattr(self.whole, name)[cut] for name in PER_STEP})
        self.match = PhinsMatch(*(value[cut] for value in vars(self.matched).values()))

    def still(self) -> Observations:
        """The same steps on a ship that neither turns nor accelerates."""
        eye, zero = np.tile(np.eye(3), (STEPS, 1, 1)), np.zeros((STEPS, 3))
        return replace(self.obs, A_start=eye, A_end=eye, A_mid=eye, omega=zero, rate_m=zero, force_i=zero, force_m=zero)


@pytest.fixture(scope="module")
def case() -> Case:
    return Case()


def test_the_phins_see_an_error_of_the_gyros_start_at_the_instants_of_their_samples(case: Case) -> None:
    d = np.array([0.004, -0.003, 0.01])
    moved = observe(pair(case.trial, despike=False), replace(case.at, R_0=exp(d) @ case.at.R_0))
    change = whitening.phins_match(case.trial, moved).q - case.matched.q
    expected = -np.einsum("kij,j->ki", case.matched.A_T, d)
    # Half a sample amiss would be 5 ms times the ship's rate times d; what may be left is d times the angle itself.
    skewed = np.linalg.lstsq(case.whole.omega[1:, :2], (change - expected)[1:], rcond=None)[0]
    assert np.abs(skewed).max() < 0.5 * 0.005 * 0.01


@pytest.mark.parametrize("with_phins", [True, False])
def test_the_likelihood_is_that_of_the_joint_distribution(case: Case, with_phins: bool) -> None:
    # z is measured free of noise for all purposes, which no dense factorisation stands: a little noise for both
    model = whitening.build(case.obs, case.levels, case.at.coupling, case.match if with_phins else None)
    model = replace(model, variance=np.maximum(model.variance, 1e-11))
    assert model.z.shape[1] == (9 if with_phins else 6)
    assert run_filter(model, np.zeros(0, dtype=np.int64)).log_likelihood == pytest.approx(
        condition(dense(model))[2], rel=1e-5
    )


def test_a_core_serves_other_levels_as_a_model_built_for_them(case: Case) -> None:
    made = whitening.core(case.obs, case.levels.noise, case.at.coupling)
    noise = replace(
        case.levels.noise, jitter=np.array([3e-5, 1e-6, 2e-4]), velocity=np.array([2e-4, 1e-5, 7e-4]), accel=3e-4
    )
    levels = Levels(noise, AccelColour(np.array([2e-3, 1e-3, 4e-4]), 5.0), case.levels.phins)
    afresh = whitening.build(case.obs, levels, case.at.coupling, case.match)
    served = whitening.build(case.obs, levels, case.at.coupling, case.match, made)
    before = whitening.build(case.obs, case.levels, case.at.coupling, case.match, made)
    for one, other in zip(dense(afresh).__dict__.values(), dense(served).__dict__.values()):
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-300)
    assert not np.allclose(dense(before).Q, dense(afresh).Q, rtol=1e-3, atol=0.0)


def test_a_reduced_model_is_the_full_one_with_the_other_states_at_zero(case: Case) -> None:
    noise = replace(case.levels.noise, gyro_walk=1e-9)
    x0 = np.zeros(full_model.SIZE)
    full = full_model.build(case.obs, noise, case.at.coupling, x0)
    full = replace(full, variance=np.maximum(full.variance, 1e-11))
    kept = whitening.KEPT
    big, some = dense(full), np.ix_(kept, kept)
    expected = DenseModel(
        np.array([F[some] for F in big.F]), np.array([Q[some] for Q in big.Q]), big.H[:, :, kept], big.z, big.R,
        x0[kept], big.P0[some],
    )  # fmt: skip
    found = run_filter(whitening.reduced(full, kept), np.zeros(0, dtype=np.int64))
    assert found.log_likelihood == pytest.approx(condition(expected)[2], rel=1e-5)


def prior_of_rows(model: SparseModel, rows: list[int]) -> np.ndarray:
    """(N k, N k) covariance of what rows of H would measure, without their own noise, states known at the start."""
    whole = dense(replace(model, P0=np.zeros_like(model.P0)))
    _, covariance = path_prior(whole)
    H = np.zeros((STEPS * len(rows), STEPS * len(model.x0)))
    for k in range(STEPS):
        H[k * len(rows) : (k + 1) * len(rows), k * len(model.x0) : (k + 1) * len(model.x0)] = whole.H[k, rows]
    return H @ covariance @ H.T


def quiet(levels: Levels) -> Levels:
    """Of all noise that of the accelerometers alone."""
    noise = replace(levels.noise, jitter=np.full(3, 1e-12), gyro=np.full(3, 1e-15), std=np.full(3, 1e-12))
    return replace(levels, noise=noise, colour=replace(levels.colour, std=np.full(3, 1e-12)))


def test_the_velocity_match_is_the_mean_of_a_random_walk_over_each_step(case: Case) -> None:
    model = whitening.build(case.still(), quiet(case.levels), case.at.coupling, None)
    found = prior_of_rows(model, [4])
    t, h = np.cumsum(case.obs.dt), case.obs.dt
    q = case.levels.noise.accel**2
    i, j = np.indices((STEPS, STEPS))
    early = np.minimum(i, j)
    expected = q * np.where(i == j, t[i] - h[i] + h[i] / 3.0, t[early] - h[early] / 2.0)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * expected.max())


def test_coloured_force_fades_as_a_first_order_process(case: Case) -> None:
    colour = case.levels.colour
    model = whitening.build(case.still(), case.levels, case.at.coupling, None)
    assert np.allclose(np.diag(model.P0)[whitening.COLOUR : whitening.COLOUR + 3], colour.std**2)
    P0 = np.zeros_like(model.P0)
    P0[whitening.COLOUR + 1, whitening.COLOUR + 1] = colour.std[1] ** 2
    whole = dense(replace(model, P0=P0))
    _, covariance = path_prior(whole)
    n = len(model.x0)
    own = np.arange(STEPS) * n + whitening.COLOUR + 1
    t = np.cumsum(case.obs.dt)
    expected = colour.std[1] ** 2 * np.exp(-np.abs(t[:, None] - t) / colour.tau)
    np.testing.assert_allclose(covariance[np.ix_(own, own)], expected, rtol=1e-9)


def test_the_phins_difference_is_a_fading_error_in_earth_axes(case: Case) -> None:
    levels = quiet(case.levels)
    model = whitening.build(case.still(), levels, case.at.coupling, case.match)
    n, own = len(model.x0), slice(len(model.x0) - 3, len(model.x0))
    P0 = np.zeros((n, n))
    P0[own, own] = np.diag(levels.phins.drift**2)
    _, covariance = path_prior(dense(replace(model, P0=P0)))
    H = dense(model).H[:, 6:9]
    a, b = 3, 11
    block = covariance[a * n : (a + 1) * n, b * n : (b + 1) * n]
    lag = case.obs.dt[a + 1 : b + 1].sum()
    expected = case.match.C[a] @ np.diag(levels.phins.drift**2) @ case.match.C[b].T * np.exp(-lag / levels.phins.tau)
    np.testing.assert_allclose(H[a] @ block @ H[b].T, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(
        model.variance[:, 6:], np.repeat((levels.phins.white**2 / case.match.count)[:, None], 3, axis=1)
    )


@pytest.fixture(scope="module")
def whitened(case: Case):
    model = whitening.build(case.whole, case.levels, case.at.coupling, case.matched)
    return whitening.whiten(model, case.whole)


def test_whitened_columns_are_what_they_add_to_the_innovations(case: Case, whitened) -> None:
    rng = np.random.default_rng(5)
    columns = np.cumsum(rng.standard_normal((len(case.whole.index), 9, 2)), axis=0) * 1e-6
    model = replace(whitened.model, z=whitened.model.z + columns[:, :, 0] - 2.0 * columns[:, :, 1])
    with_both = whitening.whiten(model, case.whole)
    answer = whitening.whiten_columns(whitened, columns)
    ok = np.isfinite(whitened.values)
    difference = (with_both.values - whitened.values)[ok]
    expected = (answer[:, :, 0] - 2.0 * answer[:, :, 1])[ok]
    np.testing.assert_allclose(difference, expected, atol=1e-7 * np.abs(difference).max())
    assert (answer[~ok] == 0.0).all()


def test_whitening_columns_is_linear_and_leaves_them_as_they_were(case: Case, whitened) -> None:
    rng = np.random.default_rng(6)
    a, b = rng.standard_normal((2, len(case.whole.index), 9, 1))
    before = a.copy()
    joint = whitening.whiten_columns(whitened, 3.0 * a - b)
    apart = 3.0 * whitening.whiten_columns(whitened, a) - whitening.whiten_columns(whitened, b)
    np.testing.assert_allclose(joint, apart, atol=1e-9 * np.abs(apart).max())
    np.testing.assert_array_equal(a, before)


def test_ends_and_what_follows_a_gap_are_masked(case: Case) -> None:
    jump = np.zeros(len(case.whole.index))
    jump[100] = 3.0
    t = case.whole.t[case.whole.index]
    masked = whitening.masked(replace(case.whole, jump_s=jump), 9)
    assert masked.shape == (len(t), 9)
    assert masked[(t < t[0] + 4.9) | (t > t[-1] - 4.9)].all()
    assert masked[(t >= t[100]) & (t < t[100] + 4.9)].all()
    assert not masked[(t > t[100] + 5.1) & (t < t[-1] - 5.1)].any()
    assert not masked[(t > t[0] + 5.1) & (t < t[100] - 1.1)].any()


def test_spread_is_the_standard_deviation_whatever_wild_samples_there_are() -> None:
    x = 3.0 * np.random.default_rng(1).standard_normal(20_000)
    assert whitening.spread(x) == pytest.approx(3.0, rel=0.02)
    x[::500] = 1e4
    assert whitening.spread(x) == pytest.approx(3.0, rel=0.03)
    assert whitening.spread(np.full(5, np.nan)) == 1.0


def test_step_means_leave_out_what_is_not_measured() -> None:
    values = np.arange(12.0).reshape(6, 2)
    values[2] = np.nan
    mean, count = whitening.step_means(values, np.array([0, 3, 5]))
    np.testing.assert_array_equal(count, [1.0, 2.0, 2.0])
    np.testing.assert_allclose(mean, [[0.0, 1.0], [4.0, 5.0], [9.0, 10.0]])
    assert np.isnan(whitening.step_means(np.full((6, 1), np.nan), np.array([0, 5]))[0]).all()
