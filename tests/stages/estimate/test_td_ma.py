"""The TD-MA family against closed forms, an independent Wahba solver, filterpy, and its own published figures."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.spatial.transform import Rotation

from physics import quaternions
from schemas.errors import DataError
from schemas.products import Status
from stages.estimate import get
from stages.estimate.quaternion_matching import gaps, linear
from stages.estimate.quaternion_matching.deforming import markov
from stages.estimate.spatiotemporal.coarse import Vectors, coarse_alignment, quaternion_optimisation
from stages.estimate.spatiotemporal.measurement import printed_elements
from stages.paired import Linearisation, observe
from tests.stages.estimate.published import (
    ARCMIN,
    error,
    no_alignment,
    rms,
    rough_alignment,
    seconds,
    simulation,
    true_flexure,
    until,
    without,
)

PUBLISHED = np.array([0.87, 0.29, 0.38])  # arcmin, Table 1 of the paper


@pytest.fixture(scope="module")
def run():
    return simulation("td-ma", 600.0, 40.0, 3)


@pytest.fixture(scope="module")
def found(run):
    methods = ("td-ma", "td-noma", "notd-ma", "notd-noma")
    return {name: get(name)().estimate(run.trial, no_alignment(), true_flexure(run)) for name in methods}


@pytest.mark.parametrize("angle", [0.0, 0.1, 1.5, 3.1])
def test_quaternion_optimisation_finds_any_rotation_exactly(angle):
    rng = np.random.default_rng(1)
    turn = Rotation.from_rotvec(angle * np.array([0.6, -0.48, 0.64]))
    alpha = rng.standard_normal((200, 3))
    assert np.allclose(quaternion_optimisation(turn.apply(alpha), alpha), turn.as_matrix(), atol=1e-7)


def test_quaternion_optimisation_solves_wahbas_problem():
    rng = np.random.default_rng(2)
    alpha = rng.standard_normal((300, 3))
    beta = Rotation.from_rotvec([0.5, -1.0, 0.7]).apply(alpha) + 0.1 * rng.standard_normal((300, 3))
    reference, _ = Rotation.align_vectors(beta, alpha)
    assert np.allclose(quaternion_optimisation(beta, alpha), reference.as_matrix(), atol=1e-7)


def test_quaternion_optimisation_turns_nothing_where_the_motion_shows_nothing():
    about_x = np.outer(np.sin(np.arange(100.0)), [1.0, 0.0, 0.0])
    assert np.allclose(quaternion_optimisation(about_x, about_x), np.eye(3), atol=1e-6)


def test_coarse_alignment_on_rates_beats_integrals_and_states_its_error(run):
    paired = gaps.integrated(run.trial)
    true = Rotation.from_matrix(rough_alignment(run).rotation)
    off = {}
    for vectors in Vectors:
        coarse = coarse_alignment(paired, 0.075, vectors, 300.0)
        off[vectors] = (Rotation.from_matrix(coarse.rotation) * true.inv()).as_rotvec() / ARCMIN
        assert np.all(np.abs(off[vectors]) < 3.0 * coarse.std / ARCMIN + 1.5)  # 1.5: the quasi-static angle is in it
    assert np.abs(off[Vectors.RATES]).max() < 2.0
    assert np.linalg.norm(off[Vectors.INTEGRALS]) > 3.0 * np.linalg.norm(off[Vectors.RATES])


def test_coarse_alignment_of_units_that_never_meet_is_a_data_error(run):
    with pytest.raises(DataError, match="no coarse alignment"):
        coarse_alignment(gaps.integrated(run.trial), 0.0, Vectors.RATES, 2.0)


def test_the_printed_third_element_is_the_first_and_not_the_angle():
    z = ARCMIN * np.array([[3.0, -2.0, 5.0]])
    M = Rotation.from_rotvec(z).as_matrix()
    printed = printed_elements(M)[0]
    assert np.allclose(printed[:2], z[0, :2], rtol=2e-3)
    assert abs(printed[2] - z[0, 2]) > ARCMIN
    assert np.isclose(-M[0, 0, 1], z[0, 2], rtol=2e-3)  # M_12, as corrected


def test_the_filter_is_filterpys(run):
    """The whole model in dense matrices through filterpy, delay and gaps included."""
    trial, flexure = without(until(run.trial, 30.0), "main", 12.0, 12.6), true_flexure(run)
    at = Linearisation.at(rough_alignment(run, 2.0))
    obs = observe(gaps.integrated(trial), at)
    deforming = markov(flexure.damping, flexure.stiffness, flexure.std, obs.dt, np.full(3, 2 * ARCMIN), 0.01 * ARCMIN)
    noise = linear.noise_of(trial.rig, flexure, np.full(3, 3 * ARCMIN), 0.01)
    filtered = linear.run(obs, obs.z, deforming, noise)
    reference, last = dense_reference(obs, deforming, noise)
    scale = np.sqrt(np.diag(last)) + 1e-12
    assert np.isnan(obs.z).any()
    assert np.abs((filtered.x - reference) / scale).max() < 1e-4
    assert np.allclose(filtered.P_last / np.outer(scale, scale), last / np.outer(scale, scale), atol=1e-4)


def dense_reference(obs, deforming, noise):
    """Means (N, 16) and the last covariance, by filterpy."""
    kalman = KalmanFilter(dim_x=16, dim_z=3)
    kalman.x = np.zeros(16)
    rate = deforming.prior[:, 1]
    sigma = np.concatenate(
        [deforming.prior[:, 0], rate, deforming.static_prior, noise.d_prior, np.full(3, noise.bias_prior)]
    )
    kalman.P = np.diag(np.append(sigma, noise.delay_prior) ** 2)
    kalman.R = linear.Z_NOISE**2 * np.eye(3)
    means = []
    for k in range(len(obs.dt)):
        F, Q, H = np.eye(16), np.zeros((16, 16)), np.zeros((3, 16))
        for axis in range(3):
            pair = np.ix_([axis, 3 + axis], [axis, 3 + axis])
            F[pair], Q[pair] = deforming.F[axis, k], deforming.Q[axis, k]
        F[9:12, 12:15] = obs.A_mid[k] * obs.dt[k]
        Q[6:9, 6:9] = deforming.static_walk**2 * obs.dt[k] * np.eye(3)
        Q[9:12, 9:12] = noise.gyro**2 * obs.dt[k] * np.eye(3) + np.diag(
            gaps.drift_variance(obs.jump_s[k : k + 1], noise.d_prior)[0]
        )
        Q[12:15, 12:15] = (linear.BIAS_WALK * noise.bias_prior) ** 2 * obs.dt[k] * np.eye(3)
        H[:, :3] = H[:, 6:9] = np.eye(3)
        H[:, 9:12], H[:, 15] = obs.A_end[k].T, -obs.rate_m[k]
        kalman.predict(F=F, Q=Q)
        if np.isfinite(obs.z[k]).all():
            kalman.update(obs.z[k], H=H)
        means.append(kalman.x.copy())
    return np.array(means), kalman.P


def test_td_ma_reaches_the_published_accuracy(run, found):
    late = seconds(run.trial, found["td-ma"]) > 200.0
    assert np.all(rms(error(found["td-ma"], run.truth)[late]) <= PUBLISHED)


def test_td_ma_finds_the_delay(found):
    delay = found["td-ma"].parameters["time_delay"]
    assert abs(float(delay.value) - 0.075) < min(3e-4, 4.0 * float(delay.std))
    assert delay.status is Status.ESTIMATED
    assert abs(float(found["td-ma"].parameters["first_loop_delay"].value) - 0.075) < 0.0125  # half a sample


def test_td_ma_knows_its_error(run, found):
    deformation = found["td-ma"]
    std = np.sqrt(np.diagonal(deformation.covariance, axis1=1, axis2=2)) / ARCMIN
    normal = error(deformation, run.truth) / std
    assert 0.2 < np.sqrt(np.mean(normal**2)) < 2.0
    assert np.sqrt(np.nanmean(deformation.innovations.values[100:] ** 2)) == pytest.approx(0.9, abs=0.25)


def test_ablations_are_worse_in_the_published_order(run, found):
    size = {name: np.linalg.norm(rms(error(deformation, run.truth))) for name, deformation in found.items()}
    assert size["td-ma"] < 0.2 * size["td-noma"]
    assert size["td-noma"] < size["notd-ma"] < size["notd-noma"]


def test_a_delay_left_alone_shows_at_its_full_size(run, found):
    """omega delay: 5 deg in 8 s, 2 deg in 6 s, 4 deg in 10 s, read 75 ms late."""
    expected = np.array([5.0 / 8.0, 2.0 / 6.0, 4.0 / 10.0]) * 60.0 * 2.0 * np.pi * 0.075 / np.sqrt(2.0)
    late = seconds(run.trial, found["notd-ma"]) > 200.0
    assert np.allclose(rms(error(found["notd-ma"], run.truth)[late]), expected, rtol=0.12)
    assert found["notd-ma"].parameters["time_delay"].status is Status.NOT_OBSERVABLE


def test_parts_make_up_the_total(found):
    deformation = found["td-ma"]
    theta, Phi = (Rotation.from_rotvec(part) for part in (deformation.dynamic_part, deformation.static_part))
    assert np.allclose((theta * Phi).as_rotvec(), deformation.total, atol=1e-12)


def test_what_comes_later_changes_nothing(run, found):
    cut = get("td-ma")().estimate(until(run.trial, 450.0), no_alignment(), true_flexure(run))
    count = int(np.sum(seconds(run.trial, cut) < 440.0))
    assert np.allclose(cut.total[:count], found["td-ma"].total[:count], atol=1e-9)
    assert np.allclose(cut.covariance[:count], found["td-ma"].covariance[:count], rtol=1e-4)


@pytest.mark.parametrize("unit", ["main", "sub"])
def test_a_long_gap_is_survived_and_left_out(run, unit):
    trial = without(run.trial, unit, 300.0, 320.0)
    deformation = get("td-ma")().estimate(trial, no_alignment(), true_flexure(run))
    t = seconds(trial, deformation)
    assert not np.any((t > 300.1) & (t < 319.9))
    wrong = error(deformation, run.truth)
    assert rms(wrong[t > 330.0]).max() < 1.5
    std = np.sqrt(np.diagonal(deformation.covariance, axis1=1, axis2=2)) / ARCMIN
    assert std[np.searchsorted(t, 320.5)].min() > 1.5 * std[np.searchsorted(t, 299.0)].max()
    assert np.sqrt(np.mean((wrong / std)[t > 320.0] ** 2)) < 2.5


def test_rejoining_continues_the_match_across_a_gap(run):
    at = Linearisation.at(rough_alignment(run))
    obs = observe(gaps.integrated(without(run.trial, "main", 100.0, 110.0)), at)
    whole = gaps.rejoined(obs, at.R_ref, np.full(3, ARCMIN))
    seen = np.flatnonzero(np.isfinite(whole.z[:, 0]))
    assert np.abs(np.diff(whole.z[seen], axis=0)).max() < 5.0 * ARCMIN
    assert np.abs(obs.z[seen]).max() > 100.0 * ARCMIN
    assert gaps.rejoined(obs, at.R_ref, np.full(3, 10.0)) is obs


def test_rejoining_goes_on_across_one_gap_after_another(run):
    at = Linearisation.at(rough_alignment(run))
    trial = without(without(run.trial, "main", 100.0, 110.0), "sub", 200.0, 215.0)
    whole = gaps.rejoined(observe(gaps.integrated(trial), at), at.R_ref, np.full(3, ARCMIN))
    z = whole.z[np.isfinite(whole.z[:, 0])]
    assert np.abs(np.diff(z, axis=0)).max() < 5.0 * ARCMIN
    total = quaternions.log(whole.total(np.zeros((len(whole.dt), 3)), np.zeros(len(whole.dt))))
    expected = (Rotation.from_rotvec(whole.z[-1]) * Rotation.from_matrix(at.R_ref)).as_rotvec()
    assert np.allclose(total[whole.index[-1]], expected, atol=1e-9)


def test_as_printed_it_cannot_work(run, found):
    printed = get("td-ma")(as_printed=True).estimate(run.trial, no_alignment(), true_flexure(run))
    assert np.linalg.norm(rms(error(printed, run.truth))) > 10.0 * np.linalg.norm(rms(error(found["td-ma"], run.truth)))


def test_unequal_rates_are_no_obstacle(run):
    from dataclasses import replace

    main = run.trial.main
    mean = lambda values: values.reshape(-1, 4, 3).mean(axis=1)  # noqa: E731
    count = len(main) // 4 * 4
    slow = replace(main, stamp=main.stamp[3:count:4], gyro=mean(main.gyro[:count]), accel=mean(main.accel[:count]))
    deformation = get("td-ma")().estimate(replace(run.trial, main=slow), no_alignment(), true_flexure(run))
    late = seconds(run.trial, deformation) > 200.0
    assert np.all(rms(error(deformation, run.truth)[late]) < 1.5 * PUBLISHED)


def test_a_record_too_short_is_a_data_error(run):
    with pytest.raises(DataError):
        get("td-ma")().estimate(until(run.trial, 6.0), no_alignment(), true_flexure(run))


@pytest.mark.parametrize("option", [{"coarse": "guess"}, {"network": "deep"}])
def test_unknown_options_are_refused(option):
    with pytest.raises(ValueError, match="is not a valid"):
        get("td-ma")(**option)


@pytest.mark.slow
def test_the_network_in_the_last_loop_does_as_well_as_the_filter(run):
    deformation = get("td-ma")(network="constant").estimate(run.trial, no_alignment(), true_flexure(run))
    late = seconds(run.trial, deformation) > 200.0
    assert np.linalg.norm(rms(error(deformation, run.truth)[late])) < 1.2
