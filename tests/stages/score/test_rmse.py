"""Scores against truth and PHINS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics.units import ARCMIN
from schemas.products import Estimate, Status
from schemas.rig import Rig
from schemas.trial import ImuSeries
from stages.score import score, score_all
from stages.score.rmse import coverage
from tests.stages import synthetic_result as synthetic


@pytest.fixture(scope="module")
def case():
    return synthetic.case(duration=200.0, gap=(50.0, 62.0))


def biased(case, error):
    """The truth turned by a constant error in m-axes, at the estimate's stamps."""
    at = np.isin(case.truth.stamp, case.result.deformation.stamp)
    total = (Rotation.from_rotvec(error) * Rotation.from_rotvec(case.truth.total[at])).as_rotvec()
    return replace(case.result.deformation, total=total)


def by_name(scores):
    return {s.reference: s for s in scores}


def test_constant_error_is_the_rmse_in_m_axes(case):
    error = np.array([0.3, -0.2, 0.5]) * ARCMIN
    found = by_name(score(biased(case, error), case.trial, case.truth))["truth"]
    np.testing.assert_allclose(found.rmse, np.abs(error), rtol=1e-9)
    np.testing.assert_allclose(found.error, np.broadcast_to(error, found.error.shape), atol=1e-12)
    np.testing.assert_array_equal(found.reference_noise, 0.0)


def test_error_is_exact_at_a_large_misalignment():
    turned = np.array([0.4, 2.2, -1.5])
    error = np.array([1e-3, 2e-3, -3e-3])
    stamp = np.arange(5, dtype=np.int64) * 10**9
    c = synthetic.case(duration=5.0, rate=1.0, gap=None, with_phins=False, with_deck=False)
    truth = replace(c.truth, stamp=stamp, total=np.tile(turned, (5, 1)))
    total = (Rotation.from_rotvec(error) * Rotation.from_rotvec(turned)).as_rotvec()
    estimate = replace(c.result.deformation, stamp=stamp, total=np.tile(total, (5, 1)))
    np.testing.assert_allclose(score(estimate, c.trial, truth)[0].error[0], error, atol=1e-14)


def test_truth_between_its_stamps_is_interpolated(case):
    thinned = replace(case.truth, stamp=case.truth.stamp[::2], total=case.truth.total[::2])
    found = score(biased(case, np.zeros(3)), case.trial, thinned)[0]
    assert found.samples > 1.9 * np.isin(thinned.stamp, case.result.deformation.stamp).sum()
    assert found.rmse.max() < 0.02 * ARCMIN  # interpolation of the flexure over 0.1 s, not of nothing


def test_nothing_is_scored_inside_a_gap_of_the_reference(case):
    t = (case.truth.stamp - synthetic.EPOCH) * 1e-9
    kept = (t < 100.0) | (t >= 120.0)
    holed = replace(case.truth, stamp=case.truth.stamp[kept], total=case.truth.total[kept])
    found = score(biased(case, np.zeros(3)), case.trial, holed)[0]
    scored = (found.stamp - synthetic.EPOCH) * 1e-9
    assert not np.any((scored >= 100.0) & (scored < 120.0))
    assert found.rmse.max() < 1e-9
    assert found.duration == pytest.approx(200.0 - 20.0 - 12.0, abs=0.3)


def test_phins_with_known_installation_is_blamed_for_its_own_noise(case):
    found = by_name(score(biased(case, np.zeros(3)), case.trial, case.truth))["phins"]
    floor = np.hypot(0.3, 0.06) * np.sqrt(2) * ARCMIN
    assert np.all(found.rmse < 2.5 * floor)
    assert np.all(found.reference_noise > 0.3 * floor)
    assert np.all(found.reference_noise < 2.5 * floor)
    assert found.coverage[2] > 0.9


def test_wrong_installation_shows_as_error(case):
    rig = Rig(installation_main=synthetic.INSTALLATION_MAIN, installation_sub=np.eye(3))
    found = by_name(score(biased(case, np.zeros(3)), replace(case.trial, rig=rig), None))["phins"]
    expected = np.abs(Rotation.from_matrix(synthetic.INSTALLATION_SUB).as_rotvec())
    np.testing.assert_allclose(found.rmse, expected, atol=1.5 * ARCMIN)


def test_rig_installation_comes_before_the_estimate(case):
    rig = Rig(installation_main=synthetic.INSTALLATION_MAIN, installation_sub=synthetic.INSTALLATION_SUB)
    wrong = Estimate(np.array([0.1, 0.1, 0.1]), np.full(3, 1e-5))
    estimate = biased(case, np.zeros(3))
    estimate = replace(estimate, alignment=replace(estimate.alignment, installation_main=wrong))
    found = by_name(score(estimate, replace(case.trial, rig=rig), None))["phins"]
    assert found.rmse.max() < 2.0 * ARCMIN


def test_unknown_installation_gives_a_note_and_no_score(case):
    estimate = biased(case, np.zeros(3))
    blind = Estimate(np.zeros(3), np.full(3, np.inf), Status.NOT_OBSERVABLE, "calm sea")
    estimate = replace(estimate, alignment=replace(estimate.alignment, installation_sub=blind))
    scoring = score_all(estimate, case.trial, None)
    assert scoring.scores == ()
    assert "installation" in scoring.notes[0]


def test_reference_that_does_not_overlap_gives_a_note(case):
    later = replace(case.truth, stamp=case.truth.stamp + 10**13)
    scoring = score_all(biased(case, np.zeros(3)), replace(case.trial, phins_main=None), later)
    assert scoring.scores == ()
    assert "does not overlap" in scoring.notes[0]


def test_sub_delay_does_not_move_the_phins(case):
    estimate = biased(case, np.zeros(3))
    late = replace(estimate.alignment, time_delay=Estimate(np.array(0.5), np.array(1e-4)))
    a, b = (score(e, case.trial, None)[0].rmse for e in (estimate, replace(estimate, alignment=late)))
    np.testing.assert_array_equal(a, b)


def test_slower_phins_is_interpolated_and_still_blamed(case):
    slow = {
        name: ImuSeries(s.stamp[::4], s.gyro[::4], s.accel[::4], s.attitude[::4])
        for name, s in (("phins_main", case.trial.phins_main), ("phins_sub", case.trial.phins_sub))
    }
    found = score(biased(case, np.zeros(3)), replace(case.trial, **slow), None)[0]
    full = score(biased(case, np.zeros(3)), case.trial, None)[0]
    assert found.samples > 0.95 * full.samples
    np.testing.assert_allclose(found.rmse, full.rmse, rtol=0.2)


def test_coverage_counts_axes_apart_and_ignores_unknown_sigma():
    error = np.array([[0.5, 1.5, 2.5], [0.0, 0.0, 9.0]])
    std = np.array([[1.0, 1.0, 1.0], [1.0, np.nan, 1.0]])
    np.testing.assert_allclose(coverage(error, std), [2 / 5, 3 / 5, 4 / 5])
    assert np.isnan(coverage(error, np.full((2, 3), np.nan))).all()


def test_estimate_without_covariance_is_scored_all_the_same(case):
    estimate = biased(case, np.zeros(3))
    estimate = replace(estimate, covariance=np.full_like(estimate.covariance, np.nan))
    found = score(estimate, replace(case.trial, phins_sub=None), case.truth)[0]
    assert np.isnan(found.predicted).all()
    assert np.isfinite(found.rmse).all()
