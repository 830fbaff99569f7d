"""The default deck-shape method on trials with known shape."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from schemas.errors import DataError
from schemas.products import Alignment, DeckShape, Deformation, Estimate, FlexureModel
from schemas.trial import ImuSeries, OdometrySeries, Trial
from stages.shape.spline import SplineShape
from stages.shape.wavelet_kalman import WaveletKalmanShape
from tests.stages.shape.generator import Case, curvature, rms, trial, without

SHORT = Case(passes=4, length=40.0)


def deformation(data: Trial, theta: np.ndarray) -> Deformation:
    """An error-free deformation, as the estimators hand it on."""
    none = Estimate(np.zeros(3), np.zeros(3))
    alignment = Alignment(np.eye(3), none, np.zeros((3, 3)), Estimate(np.zeros(()), np.zeros(())))
    ones = np.ones(3)
    flexure = FlexureModel("known", ones, ones, ones, np.zeros((3, 3, 3)), np.zeros(3))
    zero = np.zeros_like(theta)
    return Deformation("known", data.main.stamp, theta, zero, theta, np.zeros((len(theta), 3, 3)), alignment, flexure)


def no_sub(data: Trial) -> Trial:
    return replace(data, sub=without(data.sub, np.zeros(len(data.sub), dtype=bool)))


def error(shape: DeckShape, truth: Callable[[np.ndarray], np.ndarray] = curvature) -> np.ndarray:
    return shape.curvature - truth(shape.arc_length)


@pytest.fixture(scope="module")
def known() -> tuple[Trial, Deformation]:
    data, theta = trial(SHORT)
    return data, deformation(data, theta)


@pytest.fixture(scope="module")
def answer(known: tuple[Trial, Deformation]) -> DeckShape:
    return SplineShape(limit=(1e-4, 1e-4, 1e-4)).shape(*known)


def test_curves_are_better_than_the_published_recipe_on_every_axis(
    known: tuple[Trial, Deformation], answer: DeckShape
) -> None:
    published = WaveletKalmanShape().shape(known[0])
    assert np.all(rms(error(answer)) < 0.5 * rms(error(published)))
    for ours, theirs in zip(answer.passes, published.passes, strict=True):
        mine = rms(ours.curvature - curvature(ours.arc_length))
        assert np.all(mine < 0.5 * rms(theirs.curvature - curvature(theirs.arc_length)))


def test_errors_stay_within_an_absolute_budget(answer: DeckShape) -> None:
    assert np.all(rms(error(answer)) < 8e-7)
    assert np.all(np.abs(error(answer)) < 4.0 * answer.std)


def test_products_have_the_agreed_shapes_and_order(answer: DeckShape) -> None:
    assert answer.method == "spline"
    assert [p.index for p in answer.passes] == [0, 1, 2, 3]
    assert [p.forward for p in answer.passes] == [True, False, True, False]
    for p in answer.passes:
        n = len(p.stamp)
        assert p.curvature.shape == p.std.shape == p.exceeds.shape == p.position.shape == (n, 3)
        assert np.all(np.diff(p.stamp) > 0)
        assert np.all(np.diff(p.arc_length) * (1 if p.forward else -1) > 0)
    k = len(answer.arc_length)
    assert answer.curvature.shape == answer.line.shape == (k, 3)


def test_exceedance_needs_limit_and_significance(answer: DeckShape) -> None:
    beyond = np.abs(curvature(answer.arc_length)) > 1e-4
    clear = np.abs(np.abs(curvature(answer.arc_length)) - 1e-4) > 3e-6
    np.testing.assert_array_equal(answer.exceeds[clear], beyond[clear])
    assert answer.exceeds[:, 0].any()
    assert not answer.exceeds[:, 2].any()


def test_a_deck_as_designed_exceeds_nothing(known: tuple[Trial, Deformation]) -> None:
    shape = SplineShape(limit=(0.0, 0.0, 0.0), design=curvature).shape(*known)
    assert shape.exceeds.mean() < 0.02
    assert shape.design is not None


def test_line_is_the_integral_of_the_curvature_between_the_measured_ends(answer: DeckShape) -> None:
    s = answer.arc_length
    chord = answer.line[0] + (s - s[0])[:, None] / (s[-1] - s[0]) * (answer.line[-1] - answer.line[0])
    fine = np.linspace(0.0, s[-1] - s[0], 4001)
    slope = np.concatenate([[0.0], np.cumsum(curvature(s[0] + fine[:-1])[:, 0]) * fine[1]])
    sag = np.concatenate([[0.0], np.cumsum(slope[:-1]) * fine[1]])
    sag -= fine / fine[-1] * sag[-1]
    cosine = np.cos(np.radians(7.0))  # the path is 7 degrees off the bow, pitch acts about starboard
    np.testing.assert_allclose((answer.line - chord)[:, 2], np.interp(s - s[0], fine, sag) * cosine, atol=2e-3)


def test_outliers_cost_little(known: tuple[Trial, Deformation]) -> None:
    data, theta = trial(replace(SHORT, outliers=0.02))
    clean = SplineShape().shape(*known)
    spoilt = SplineShape().shape(data, deformation(data, theta))
    assert np.all(rms(error(spoilt)) < 2.0 * rms(error(clean)) + 1e-7)


def test_without_sub_imu_the_std_grows_to_cover_flexure(answer: DeckShape) -> None:
    shape = SplineShape().shape(no_sub(trial(SHORT)[0]))
    assert np.all(np.median(shape.std, axis=0)[:2] > 1.5 * np.median(answer.std, axis=0)[:2])
    assert np.mean((error(shape) / shape.std) ** 2) < 4.0
    assert any("no sub-IMU" in note for note in shape.notes)


def test_rates_of_the_sub_imu_serve_where_no_deformation_is_given() -> None:
    with_sub, _ = trial(SHORT)
    found = rms(error(SplineShape().shape(with_sub)))
    assert np.all(found < rms(error(SplineShape().shape(no_sub(with_sub)))) + 2e-7)
    assert np.all(found < 3e-6)


def test_one_run_is_enough() -> None:
    data, theta = trial(Case(passes=1, seed=4))
    shape = SplineShape().shape(data, deformation(data, theta))
    assert len(shape.passes) == 1
    assert np.all(rms(error(shape)) < 5e-6)


def test_a_first_run_from_the_other_end_counts_from_there() -> None:
    data, theta = trial(replace(SHORT, first_forward=False))
    shape = SplineShape().shape(data, deformation(data, theta))
    assert [p.forward for p in shape.passes] == [True, False, True, False]

    def reversed_truth(s: np.ndarray) -> np.ndarray:
        return -curvature(SHORT.length - s)  # the same turns met in the other order, per metre travelled the other way

    assert np.all(rms(error(shape, reversed_truth)) < 1.5e-6)


def test_delay_between_sled_and_main_is_found() -> None:
    data, theta = trial(replace(SHORT, sled_delay=0.3))
    shape = SplineShape().shape(data, deformation(data, theta))
    assert np.all(rms(error(shape)) < 1.5e-6)


def test_gap_in_the_sled_is_survived() -> None:
    data, theta = trial(SHORT)
    assert data.sliding is not None
    t = data.seconds(data.sliding.stamp)
    whole = SplineShape().shape(data, deformation(data, theta))
    keep = (t < 8.0) | (t > 10.5)
    shape = SplineShape().shape(replace(data, sliding=without(data.sliding, keep)), deformation(data, theta))
    assert np.all(rms(error(shape)) < 3.0 * rms(error(whole)) + 2e-7)
    used = data.seconds(shape.passes[0].stamp)
    assert not np.any((used > 8.0) & (used < 10.5))


def test_missing_channels_are_named() -> None:
    data, _ = trial(replace(SHORT, passes=1))
    with pytest.raises(DataError, match="no sliding inertial unit"):
        SplineShape().shape(replace(data, sliding=None))
    with pytest.raises(DataError, match="no odometry"):
        SplineShape().shape(replace(data, sled=None))


def test_a_sled_that_never_ran_is_said_so() -> None:
    data, _ = trial(replace(SHORT, passes=1))
    sled = data.sled
    assert sled is not None
    still = OdometrySeries(sled.stamp, np.ones_like(sled.position), np.zeros_like(sled.velocity))
    with pytest.raises(DataError, match="no run of the sled") as caught:
        SplineShape().shape(replace(data, sled=still))
    assert caught.value.file == "synthetic"


def test_a_main_imu_that_missed_the_runs_is_said_so() -> None:
    data, _ = trial(SHORT)
    main = without(data.main, data.seconds(data.main.stamp) < 3.0)
    with pytest.raises(DataError, match="main IMU does not cover"):
        SplineShape().shape(replace(data, main=main))


def test_a_sled_that_recorded_nothing_usable_is_said_so() -> None:
    data, _ = trial(SHORT)
    assert data.sliding is not None
    dead: ImuSeries = replace(data.sliding, gyro=np.full_like(data.sliding.gyro, np.nan))
    with pytest.raises(DataError, match="usable gyro samples"):
        SplineShape().shape(replace(data, sliding=dead))


@pytest.mark.slow
@pytest.mark.parametrize("own", [0.0, 0.3])
def test_errors_match_their_predicted_spread(own: float) -> None:
    nees, alone = [], []
    for seed in range(2):  # eight passes, each with an error of its own at every knot
        data, theta = trial(replace(SHORT, seed=100 + seed, own_flexure=own))
        shape = SplineShape().shape(data, deformation(data, theta))
        nees.append(np.mean((error(shape) / shape.std) ** 2))
        alone += [np.mean(((p.curvature - curvature(p.arc_length)) / p.std) ** 2) for p in shape.passes]
    assert 0.05 < np.mean(nees) < 2.0
    assert 0.1 < np.mean(alone) < 2.0
