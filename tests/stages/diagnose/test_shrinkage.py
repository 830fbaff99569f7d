"""Shrinkage: the augmented twin in TOML, pieces of a log, and the four errors of an estimate."""

from dataclasses import replace

import numpy as np
import pytest

from physics import quaternions
from stages import identify
from stages.align import align
from stages.diagnose.shrinkage import AGAINST_PHINS, AGAINST_TRUTH, augmented_twin, between, errors
from stages.estimate.smoother import Smoother
from tests.twin.effects.worlds import STRONG
from twin import effects, load_twin, make_twin, parse_twin, simulate, with_run
from twin.replay import replay

ROUGH = with_run(load_twin("random-sea"), duration=120.0)


@pytest.mark.parametrize("name", STRONG)
def test_the_augmented_twin_is_read_back_with_its_effect_and_runs(name: str) -> None:
    twin = make_twin({"run": {"duration": 8.0, "rate": 50.0}})
    effect = effects.build(name, STRONG[name])
    again = parse_twin(augmented_twin(twin, [effect]))
    assert effects.build(again.effect[0].name, again.effect[0].parameters) == effect
    assert again.model_copy(update={"effect": ()}) == twin
    assert len(simulate(again).trial.main) == 400


def test_effects_come_after_those_that_the_twin_has() -> None:
    twin = make_twin({"effect": [{"name": "time_delay", "delay": 0.001}]})
    found = [effects.build("gyro_bias", {"x": 1.0}), effects.build("outliers", {"rate": 2.0, "size": 0.1})]
    again = parse_twin(augmented_twin(twin, found))
    assert [effect.name for effect in again.effect] == ["time_delay", "gyro_bias", "outliers"]


def test_infinite_and_partial_parameters_survive() -> None:
    for name, given in (("gyro_bandwidth", {"cutoff": np.inf}), ("flexure_parameters", {"damping": {"y": 0.3}})):
        effect = effects.build(name, given)
        again = parse_twin(augmented_twin(make_twin({}), [effect])).effect[0]
        assert effects.build(again.name, again.parameters) == effect


def test_a_piece_keeps_its_epoch_and_all_channels() -> None:
    trial = simulate(ROUGH).trial
    piece = between(trial, 30.0, 90.0)
    assert piece.epoch == trial.epoch
    for unit in ("main", "sub", "phins_main", "phins_sub"):
        series = getattr(piece, unit)
        np.testing.assert_allclose(piece.seconds(series.stamp[[0, -1]]), [30.0, 89.99])
        assert len(series.gyro) == len(series.accel) == len(series)
    assert len(piece.gnss.latitude) == len(piece.temperature_sub.value) == 60
    np.testing.assert_array_equal(piece.main.gyro, trial.main.gyro[3000:9000])


@pytest.fixture(scope="module")
def lagging():
    """A log whose gyros lag, the effect, and its four errors."""
    effect = effects.build("gyro_bandwidth", {"cutoff": 3.0})
    log = simulate(parse_twin(augmented_twin(ROUGH, [effect])), np.random.default_rng(3))
    return log, effect, errors(log.trial, ROUGH, [effect], rng=np.random.default_rng(1), realisations=2)


@pytest.mark.slow
def test_the_effect_explains_the_error_and_compensation_takes_it_away(lagging) -> None:
    _, _, found = lagging
    assert found.reference == AGAINST_PHINS
    assert found.moved.max() > 0.3
    assert (found.twin_with_effects_truth > 2.0 * found.twin_truth).any()
    assert np.linalg.norm(found.log_compensated) < np.linalg.norm(found.log)
    for row in (found.log, found.twin, found.twin_with_effects, found.log_compensated):
        assert row.shape == (3,)
        assert (row > 0.0).all()


@pytest.mark.slow
def test_without_phins_the_log_has_no_error_and_the_twin_one_against_truth(lagging) -> None:
    log, effect, _ = lagging
    blind = replace(log.trial, phins_main=None, phins_sub=None)
    found = errors(blind, ROUGH, [effect], rng=np.random.default_rng(1), realisations=1, window_s=60.0)
    assert found.reference == AGAINST_TRUTH
    assert np.isnan(found.log).all()
    assert np.isnan(found.log_compensated).all()
    np.testing.assert_array_equal(found.twin, found.twin_truth)
    assert np.isfinite([found.twin, found.twin_with_effects, found.moved]).all()


@pytest.mark.slow
def test_the_smoother_is_as_consistent_on_replays_as_its_covariance_says() -> None:
    """Normalised error squared over its three degrees of freedom; the error is one slowly drifting vector a run."""
    twin = with_run(load_twin("random-sea"), duration=300.0)
    nees = []
    for seed in range(3):
        drawn = replay(twin, simulate(twin, np.random.default_rng(seed)).trial, np.random.default_rng(50 + seed))
        alignment = align(drawn.trial)
        found = Smoother().estimate(drawn.trial, alignment, identify.get("whittle")().identify(drawn.trial, alignment))
        true = quaternions.exp(drawn.truth.total[np.isin(drawn.truth.stamp, found.stamp)])
        error = quaternions.log(quaternions.multiply(quaternions.exp(found.total), quaternions.conjugate(true)))
        weight = np.linalg.inv(found.covariance)
        nees.append(np.einsum("ni,nij,nj->n", error, weight, error).mean() / 3.0)
    assert 0.05 < np.mean(nees) < 2.0
    assert max(nees) < 4.0
