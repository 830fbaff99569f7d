"""The experiments themselves: figures as the papers print them, trials as the papers describe them."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline import experiments
from pipeline.experiments import idam_simulation, sliding, td_ma_sweep
from pipeline.experiments.bench import Bench, changed, flexure_error, late, rms
from schemas.experiment import Experiment
from schemas.products import Score
from stages import estimate, shape
from twin import built_in, simulate

ALL = [experiments.get(name) for name in experiments.names()]
SEEDS = Path(__file__).parents[3].parent / "shared" / "seeds"
PAPER = {"idam-simulation": "000", "idam-ship": "000", "td-ma": "001", "model-free": "003"}
every = pytest.mark.parametrize("experiment", ALL, ids=experiments.names())
NOISELESS = {
    unit: {
        "gyro_bias_dph": [0.0] * 3, "gyro_arw": 0.0, "gyro_scale_ppm": [0.0] * 3,
        "gyro_nonorthogonality_arcsec": [0.0] * 6, "accel_bias_ug": [0.0] * 3, "accel_vrw_ug": 0.0,
    }
    for unit in ("main", "sub")
}  # fmt: skip


@every
def test_names_twins_and_methods_are_there(experiment: Experiment):
    assert experiment.name in experiments.names()
    assert set(experiment.twins) <= set(built_in())
    assert set(experiment.methods) <= {*estimate.names(), *shape.names()}
    assert {"smoother", "spline"} & set(experiment.methods)
    assert experiment.seeds >= 5
    assert experiment.chosen
    assert experiment.checks
    assert len({part.title for part in experiment.parts}) == len(experiment.parts)


@pytest.mark.skipif(not SEEDS.is_dir(), reason="the papers are not here")
@pytest.mark.parametrize("name", PAPER)
def test_printed_figures_stand_in_the_paper(name):
    text = next(SEEDS.glob(f"{PAPER[name]}_*")).read_text()
    numbers = {float(word) for word in re.findall(r"-?\d+\.\d+", text.replace("−", "-"))}
    printed = [value for one in experiments.get(name).printed for value in one.value if np.isfinite(value)]
    assert printed
    assert set(printed) <= numbers


def test_the_displaced_trial_is_the_one_a_displaced_ship_would_give():
    """Turned and stamped late, against a simulation with that misalignment and that delay, without noise."""
    run, angle, samples = {"duration": 20.0}, 3.0, 12
    plain = changed("td-ma", run=run, imu=NOISELESS, mount={"static_arcmin": [0.0] * 3, "time_delay": 0.0})
    there = changed("td-ma", run=run, imu=NOISELESS, mount={"static_arcmin": [60 * angle] * 3, "time_delay": 0.06})
    made, wanted = (simulate(twin, np.random.default_rng(1)) for twin in (plain, there))
    trial, truth = td_ma_sweep.displaced(made.trial, made.truth, angle, samples)
    late_by = slice(samples, None)
    assert np.array_equal(trial.sub.stamp, wanted.trial.sub.stamp[late_by])
    assert trial.sub.gyro == pytest.approx(wanted.trial.sub.gyro[late_by], abs=2e-7)
    assert trial.sub.accel == pytest.approx(wanted.trial.sub.accel[late_by], abs=2e-4)
    apart = Rotation.from_rotvec(truth.total) * Rotation.from_rotvec(wanted.truth.total).inv()
    assert np.max(apart.magnitude()) < 1e-9


def test_the_printed_recursion_diverges_and_the_corrected_one_does_not():
    assert idam_simulation._root(0.0) > 1.9
    assert idam_simulation._root(1.0) < 1.0


def test_errors_are_taken_from_the_time_that_is_stated():
    stamp = np.arange(10) * 1_000_000_000
    error = np.arange(10.0)[:, None] * np.ones(3)
    score = Score("a", "truth", np.zeros(3), 9.0, 10, stamp, error, np.zeros(3), np.zeros(3), np.zeros(3))
    assert late(score, 8.0)[:, 0].tolist() == [8.0, 9.0]
    assert rms(late(score, 9.0), 1.0) == (9.0, 9.0, 9.0)


def test_a_constant_in_the_flexure_does_not_count():
    bench = Bench.simulated(changed("idam", run={"duration": 60.0}), 1)
    found = bench.answer("filter")
    assert bench.truth is not None
    moved = type(found)(**{**found.__dict__, "dynamic_part": found.dynamic_part + 1.0})
    assert flexure_error(moved, bench.truth) == pytest.approx(flexure_error(found, bench.truth), rel=1e-6)


def test_a_changed_twin_keeps_what_is_not_named():
    twin = changed("idam", imu={"sub": {"gyro_arw": 0.5}})
    assert twin.imu.sub.gyro_arw == 0.5
    assert twin.imu.main == changed("idam").imu.main
    assert twin.imu.sub.gyro_bias_dph == changed("idam").imu.sub.gyro_bias_dph


def test_the_design_of_the_deck_is_the_twins_without_its_edge():
    s = np.array([95.0])
    assert sliding._design(s) == pytest.approx(sliding._true(s), abs=1e-7)
    assert np.abs(sliding._design(np.zeros(1)) - sliding._true(np.zeros(1))).max() > sliding.LIMIT


def test_how_much_the_sliding_filter_denoises_hangs_on_the_noise():
    """Next to none it makes things worse; the published factors lie in between."""
    gain = {row.case: np.array(row.value) for row in sliding.own_conditions(1)}
    little, much = gain[sliding._own(0.43)], gain[sliding._own(100.0)]
    assert np.all(little < 1.0)
    assert np.all(much > sliding.PUBLISHED_GAIN)
    assert np.all(gain[f"{sliding._own(12.0)}, (20) as printed"] > 2.0 * gain[sliding._own(12.0)])


@every
def test_the_page_in_the_docs_holds_the_experiment_with_all_its_claims(experiment: Experiment):
    page = (Path(__file__).parents[3] / "docs" / "reproduction.md").read_text()
    assert f"`deckflex reproduce {experiment.name}`" in page
    assert all(check.claim in page for check in experiment.checks)
    assert all(sentence in page for sentence in experiment.chosen)
