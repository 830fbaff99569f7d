"""The baseline leaves white noise of a log without a gap; slow processes and latencies are found on top of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from physics.units import DEG_PER_HOUR
from schemas.rig import FloatArray
from stages.align import align
from stages.diagnose import columns, instability
from stages.diagnose.baseline import Baseline, extended
from stages.diagnose.candidate import FLOOR_NATS
from stages.diagnose.ceiling import CONSTANTS, FAMILIES, MAIN_PHINS, SWINGING, SWINGING_PHINS, families
from stages.diagnose.evidence import held_out, solve
from stages.diagnose.judgement import LEFT_NATS
from stages.diagnose.latency import main_column, main_match
from stages.diagnose.levels import _highest
from stages.diagnose.regressors import error_periods, regressors, view_of
from stages.diagnose.selection import MEAN, select
from stages.diagnose.view import believed
from tests.stages.diagnose.simulated import TWIN, baseline_of, log, without_aids
from twin.effects._prediction import Signals


@pytest.fixture(scope="module")
def bare() -> Baseline:
    return baseline_of(log())


def lag_one(x: np.ndarray) -> float:
    both = np.isfinite(x[1:]) & np.isfinite(x[:-1])
    return float(np.mean(x[1:][both] * x[:-1][both]) / np.nanmean(x**2))


def test_innovations_of_a_log_without_a_gap_are_white(bare: Baseline) -> None:
    left = bare.residual()
    assert left.shape == (len(bare.t), 9)
    assert np.isfinite(left).mean() > 0.9
    assert ((np.nanstd(left, axis=0) > 0.95) & (np.nanstd(left, axis=0) < 1.05)).all()
    correlation = np.abs([lag_one(column) for column in left.T])
    # The velocity across a long lever keeps some colour: how flexure moves it above its corner is fitted, not known.
    assert (correlation < [0.1, 0.1, 0.1, 0.3, 0.1, 0.3, 0.1, 0.1, 0.1]).all(), correlation


def test_the_fitted_levels_say_how_large_the_innovations_are(bare: Baseline) -> None:
    assert ((bare.whitened.scale > 0.8) & (bare.whitened.scale < 1.2)).all(), bare.whitened.scale
    assert bare.jumps == ()


def test_the_baseline_is_linearised_about_the_mean_angle(bare: Baseline) -> None:
    lasting = np.nanmean(np.einsum("kij,kj->ki", bare.obs.A_end, bare.obs.z), axis=0)
    assert np.abs(lasting).max() < 1e-6


def test_no_effect_and_no_generic_family_gains_on_a_log_without_a_gap(bare: Baseline) -> None:
    view = view_of(bare)
    found = regressors(bare, view, MEAN)
    kept = list(range(len(found.nuisances)))
    gained = {g.names: held_out(found.gram, kept, found.gram.index(g.names)).sum() for g in found.groups}
    assert max(gained.values()) < FLOOR_NATS
    assert {group.effect for group in found.groups} == set(MEAN) - {"misalignment_step"}  # nothing has stepped
    told = families(bare, view, found.gram, found.columns, kept, bare.whitened.values)
    # And clock and PHINS that swing, whose periods are sought in the log.
    assert len(told) == len(FAMILIES) + len(CONSTANTS) + 2
    assert sum(family.gain.sum() for family in told[:1]) < LEFT_NATS


def test_a_clock_that_swings_is_seen_by_the_family_of_its_period() -> None:
    trial = log()
    t = trial.seconds(trial.sub.stamp)
    late = np.rint(4e5 * np.sin(2.0 * np.pi * t / 70.0)).astype(np.int64)  # ns; no harmonic of the record has 70 s
    swung = baseline_of(replace(trial, sub=replace(trial.sub, stamp=trial.sub.stamp + late)))
    found = regressors(swung, view_of(swung), ["time_delay"])
    kept = list(range(len(found.nuisances)))
    told = families(swung, view_of(swung), found.gram, found.columns, kept, swung.whitened.values)
    assert told[0].name == SWINGING
    assert told[0].gain.sum() > 4.0 * LEFT_NATS
    assert told[0].gain.sum() > 4.0 * told[1].gain.sum()


@pytest.mark.parametrize(
    ("effect", "parameters", "family", "channel"),
    [
        ("phins_attitude_error", {"y": 0.6, "period": 90.0}, SWINGING_PHINS, "phins_sub.attitude"),
        ("phins_latency", {"delay": 2e-3}, MAIN_PHINS, "phins_main.attitude"),
    ],
)
def test_an_error_of_a_phins_without_its_name_is_seen_by_a_family(effect, parameters, family, channel) -> None:
    base = baseline_of(log((effect, parameters)))
    found = regressors(base, view_of(base), ["time_delay"])
    kept = list(range(len(found.nuisances)))
    told = families(base, view_of(base), found.gram, found.columns, kept, found.values)
    assert (told[0].name, told[0].channel) == (family, channel)
    assert told[0].gain.sum() > LEFT_NATS


def test_the_best_factor_is_the_top_of_a_parabola_or_else_the_best_that_was_tried() -> None:
    x = np.log([0.5, 1.0, 2.0])
    y = np.stack([-((x - 0.2) ** 2), 3.0 * x, -3.0 * x, np.zeros(3)], axis=1)
    np.testing.assert_allclose(_highest(x, y), [0.2, x[2], x[0], x[0]], atol=1e-12)
    wide = np.log([0.05, 1.0, 20.0])  # too far apart for a parabola
    np.testing.assert_array_equal(_highest(wide, -((wide - 1.0) ** 2)[:, None]), [0.0])


def test_what_the_log_lacks_is_untestable_and_said_so() -> None:
    alone = baseline_of(without_aids(log()))
    assert alone.match is None
    assert alone.whitened.values.shape[1] == 6
    found = regressors(alone, view_of(alone), MEAN)
    assert {"phins_latency", "phins_attitude_error", "gyro_temperature", "wave_forced_bending"} <= set(found.untestable)
    assert all(found.untestable.values())
    assert not {group.effect for group in found.groups} & set(found.untestable)


def test_extended_adds_regressors_with_priors_and_leaves_the_rest(bare: Baseline) -> None:
    more = instability.as_nuisances(bare, 1.0, 100.0)
    wider = extended(bare, more)
    assert wider.columns.shape[2] == bare.columns.shape[2] + len(more)
    np.testing.assert_array_equal(wider.columns[:, :, : bare.columns.shape[2]], bare.columns)
    assert extended(bare, ()) is bare


def test_response_is_linear_and_a_static_angle_shifts_z_alone_on_a_still_deck(bare: Baseline) -> None:
    rng = np.random.default_rng(2)
    gyro, accel = rng.standard_normal((2, len(bare.obs.t), 3))
    both = bare.response(Signals(gyro=2.0 * gyro, accel=accel))
    apart = 2.0 * bare.response(Signals(gyro=gyro)) + bare.response(Signals(accel=accel))
    np.testing.assert_allclose(both, apart, atol=1e-9 * np.abs(apart).max())
    angle = np.tile([1e-4, 0.0, -2e-4], (len(bare.obs.t), 1))
    turned = bare.response(Signals(mount=angle))
    expected = columns.left_jacobian(bare.source.static) @ angle[0]
    np.testing.assert_allclose(turned[:, :3], np.tile(expected, (len(bare.t), 1)), atol=1e-12)
    np.testing.assert_array_equal(turned[:, 6:], 0.0)


@pytest.mark.parametrize("sensor", ["gyro", "accel", "bending", "mount", "phins"])
def test_many_signals_about_single_axes_add_up_to_the_answer_to_their_sum(bare: Baseline, sensor: str) -> None:
    values = np.random.default_rng(3).standard_normal((3 * columns.TOGETHER // 2 + 1, len(bare.obs.t)))
    signals = [columns.OnAxis(k % 3, one) for k, one in enumerate(values)]
    apart = bare.response.many(Signals(**{sensor: one}) for one in signals)
    whole = bare.response(Signals(**{sensor: np.sum([np.asarray(one) for one in signals], axis=0)}))
    np.testing.assert_allclose(apart.sum(axis=2), whole, atol=1e-9 * np.abs(whole).max())


def test_slow_signals_are_answered_as_well_at_fewer_instants(bare: Baseline) -> None:
    thin = bare.response.of_slow(0.05)
    assert len(thin.t) < 0.3 * len(bare.obs.t)

    def wave(t: FloatArray) -> Signals:
        return Signals(gyro=1e-5 * np.stack([np.cos(0.1 * t), np.sin(0.07 * t), np.ones(len(t))], axis=1))

    whole, few = bare.response(wave(bare.obs.t)), thin(wave(thin.t))
    for rows in (slice(0, 3), slice(3, 6), slice(6, 9)):
        assert np.sqrt(np.mean((few - whole)[:, rows] ** 2)) < 3e-3 * np.sqrt(np.mean(whole[:, rows] ** 2))


@pytest.mark.parametrize("vector", [[0.0, 0.0, 0.0], [0.01, -0.02, 0.03], [0.7, -1.2, 0.4]])
def test_left_jacobian_is_the_derivative_of_the_exponential(vector: list[float]) -> None:
    v, h = np.array(vector), 1e-6
    J = columns.left_jacobian(v)
    for axis in range(3):
        moved = Rotation.from_rotvec(v + h * np.eye(3)[axis]) * Rotation.from_rotvec(v - h * np.eye(3)[axis]).inv()
        np.testing.assert_allclose(J[:, axis], moved.as_rotvec() / (2.0 * h), atol=1e-8)


def test_trapezoid_means_are_those_of_numpy() -> None:
    values = np.random.default_rng(1).standard_normal((41, 2))
    index = np.array([0, 10, 20, 40])
    found = columns.trapezoid_means(values, index)
    for k in range(1, 4):
        part = values[index[k - 1] : index[k] + 1]
        np.testing.assert_allclose(found[k], np.trapezoid(part, axis=0) / (len(part) - 1))


def test_the_evidence_of_a_wandering_bias_is_the_marginal_likelihood() -> None:
    rng = np.random.default_rng(4)
    X, y = rng.standard_normal((60, 7)), 2.0 * rng.standard_normal(60)
    variance = rng.uniform(0.1, 3.0, 7)
    expected = multivariate_normal(cov=np.eye(60) + X @ np.diag(variance) @ X.T).logpdf(y)
    expected -= multivariate_normal(cov=np.eye(60)).logpdf(y)
    assert instability._marginal(X.T @ X, X.T @ y, variance) == pytest.approx(expected, rel=1e-9)


def test_the_cosines_have_the_covariance_of_the_process() -> None:
    length, std, tau = 4000.0, 2.0, 40.0
    frequency = np.arange(4000) / (2.0 * length)
    v = instability.variances(frequency, std, tau)[:4000]
    t = np.array([1500.0, 1500.0 + tau, 1500.0 + 3.0 * tau])
    waves = np.array([np.cos(2.0 * np.pi * f * t) * np.sqrt((2.0 if f else 1.0) / length) for f in frequency])
    found = waves.T @ (v[:, None] * waves) / DEG_PER_HOUR**2
    np.testing.assert_allclose(found[0], std**2 * np.exp(-(t - t[0]) / tau), rtol=0.05)


def test_a_wandering_bias_is_found_with_its_size_and_time_constant() -> None:
    base = baseline_of(log(("gyro_bias_instability", {"std": 2.0, "tau": 40.0})))
    found = instability.wander(base, instability.basis(base), base.columns, base.precision)
    assert found.evidence > 100.0
    assert abs(found.std - 2.0) < 3.0 * found.std_error
    assert abs(found.tau - 40.0) < 3.0 * found.tau_error
    # Eight correlation times, the mean free: size and time constant trade, what is left of them apart is a factor.
    assert found.std_error < 0.6 * found.std


def test_no_bias_wanders_where_none_does(bare: Baseline) -> None:
    assert instability.wander(bare, instability.basis(bare), bare.columns, bare.precision).evidence < 0.0


def test_the_path_of_a_wandering_bias_is_what_its_regressors_times_their_values_are(bare: Baseline) -> None:
    own = [*instability.as_nuisances(bare, 2.0, 60.0), *instability.mean_nuisances(bare, 2.0, 60.0)]
    value = np.array([n.sigma for n in own]) * np.random.default_rng(8).standard_normal(len(own))
    path = instability.path_of(bare, value)
    expected = bare.response(Signals(gyro=path.at(bare.obs.t)))
    found = sum(n.column * v for n, v in zip(own, value))
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    trial = log()
    taken = trial.sub.gyro - path.taken_from(trial).sub.gyro
    np.testing.assert_allclose(taken, path.at(trial.seconds(trial.sub.stamp)), atol=1e-15)
    angle = np.cumsum(path.at(bare.obs.t), axis=0) * np.median(np.diff(bare.obs.t))
    still = instability.path_of(bare, np.zeros(len(own)))
    assert path.turns_from(still) == pytest.approx(np.abs(angle).max(), rel=0.02)


def test_a_wandering_bias_that_was_taken_out_is_put_back_to_first_order(bare: Baseline) -> None:
    found = instability.wander(bare, instability.basis(bare), bare.columns, bare.precision)
    wide = instability.with_wander(bare, found)
    value = np.random.default_rng(8).standard_normal(wide.columns.shape[2] - bare.columns.shape[2]) * DEG_PER_HOUR
    restored = instability.with_wander(bare, replace(found, path=instability.path_of(bare, value)))
    expected = wide.columns[:, :, bare.columns.shape[2] :] @ value
    ok = np.isfinite(bare.whitened.values)
    np.testing.assert_allclose((restored.whitened.values - bare.whitened.values)[ok], expected[ok], atol=1e-9)
    np.testing.assert_array_equal(np.isfinite(restored.whitened.values), ok)


def test_a_bias_that_wanders_far_hides_nothing_beside_it() -> None:
    """It turns the units by many arcminutes: without being taken out it would leave noise of second order."""
    trial = log(("gyro_bias_instability", {"std": 40.0, "tau": 60.0}), ("accel_scale_factor", {"y": 2000.0}))
    library = ("accel_scale_factor", instability.NAME)
    found = select(trial, TWIN, align(believed(trial, TWIN).trial), np.random.default_rng(0), library)
    assert [pick.group.effect for pick in found.picks] == ["accel_scale_factor"]
    assert found.wandering is not None
    y = found.picks[0].group.parameters.index("y")
    assert abs(found.picks[0].value[y] - 2000.0) < 3.0 * np.sqrt(found.picks[0].covariance[y, y])
    assert ((found.base.whitened.scale[:6] > 0.8) & (found.base.whitened.scale[:6] < 1.2)).all()


def test_more_white_noise_about_one_axis_is_no_wandering_bias(bare: Baseline, monkeypatch) -> None:
    basis = instability.basis(bare)
    third = basis.columns.shape[2] // 3
    drawn = np.random.default_rng(5).standard_normal(third) * 6.0 * bare.levels.noise.gyro[1]
    shaken = bare.whitened.values + basis.columns[:, :, third : 2 * third] @ drawn
    base = replace(bare, whitened=replace(bare.whitened, values=shaken))
    monkeypatch.setattr(instability, "WHITE_SHARES", (3.0, 6.0))
    assert instability.wander(base, basis, bare.columns, bare.precision).evidence < 0.0
    monkeypatch.setattr(instability, "WHITE_SHARES", (1e-9,))
    assert instability.wander(base, basis, bare.columns, bare.precision).evidence > 10.0  # a process would explain it


def test_the_latency_of_both_phins_is_found() -> None:
    base = baseline_of(log(("phins_latency", {"delay": 0.002})))
    found = regressors(base, view_of(base), ["phins_latency"])
    fit = solve(found.gram.total, found.gram.precision, range(len(found.gram.names)))
    error = float(np.sqrt(fit.covariance[-1, -1]))
    assert abs(fit.value[-1] - 0.002) < 3.0 * error
    assert error < 1e-4


def test_increments_of_the_main_phins_are_white_and_a_column_is_masked_with_them(bare: Baseline) -> None:
    match = main_match(bare)
    assert match is not None
    assert all(abs(lag_one(column)) < 0.1 for column in match.y.T)
    np.testing.assert_allclose(np.nanstd(match.y, axis=0), 1.0, atol=0.05)
    column = main_column(bare, match, Signals(phins_main=-view_of(bare).omega_m))
    assert (column[~np.isfinite(match.y)] == 0.0).all()
    assert np.abs(column).max() > 0.0
    assert not main_column(bare, match, Signals(phins=view_of(bare).omega_m)).any()


def test_periods_tried_are_those_at_which_the_phins_ring() -> None:
    base = baseline_of(log(("phins_attitude_error", {"x": 1.0, "period": 60.0})))
    assert min(abs(period / 60.0 - 1.0) for period in error_periods(base)) < 0.1
