"""The Whittle identifier on twins: flexure found through misalignment, delay and drift, weak cases told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physics import flexure
from schemas.errors import DataError
from schemas.products import Status
from schemas.rig import ImuGrade, Rig
from stages import align, identify
from stages.flexure_fit import fit_flexure, gyro_noise_prior
from tests.stages.estimate.runs import MEMS, cut, simulated, twin_of

ARCMIN = np.pi / 10800.0


def identified(trial):
    return identify.get("whittle")().identify(trial, align.align(trial))


def standardised(model, twin) -> np.ndarray:
    """(3, 3) errors of ln mu, ln b^2, ln sigma per axis over their stated standard errors."""
    mu = np.array(twin.flexure.damping)
    b2 = mu**2 + np.array(twin.flexure.frequency) ** 2
    sigma = np.array(twin.flexure.std_arcmin) * ARCMIN
    error = np.log(np.stack([model.damping / mu, model.stiffness / b2, model.std / sigma], axis=1))
    return error / np.sqrt(np.einsum("aii->ai", model.log_covariance))


@pytest.mark.parametrize("name", ["idam", "td-ma"])
def test_flexure_of_the_papers_is_found_within_standard_errors(name: str) -> None:
    twin = twin_of(name, 900.0, rate=25.0)
    model = identified(simulated(twin, 4)[0])
    score = standardised(model, twin)
    assert np.sqrt(np.mean(score**2)) < 1.8
    assert np.abs(score).max() < 4.0
    assert model.method == "whittle"


def path(seed: int, t: np.ndarray, noise: float = 4e-7) -> np.ndarray:
    """Flexure (n, 3) of 4 arcmin, mu 0.15, lambda 0.3, and the random walk of a gyro."""
    rng = np.random.default_rng(seed)
    step = np.diff(t)
    axes = [flexure.sample(0.15, 0.15**2 + 0.3**2, 4 * ARCMIN, step, rng)[0] for _ in range(3)]
    walk = np.cumsum(noise * np.sqrt(step.mean()) * rng.standard_normal((len(t), 3)), axis=0)
    return np.stack(axes, axis=1) + walk


def test_single_samples_left_out_do_not_cut_the_record_to_pieces() -> None:
    """A spike every three seconds; the flexure turns over in seven."""
    t = np.arange(0.0, 600.0, 0.05)
    total = Rotation.from_rotvec(path(1, t)).as_quat()
    good = np.ones(len(t), bool)
    whole = fit_flexure(t, total, good, Rig())
    good[30::60] = False
    holed = fit_flexure(t, total, good, Rig())
    np.testing.assert_allclose(np.log(holed.std / whole.std), 0.0, atol=0.1)
    np.testing.assert_allclose(np.log(holed.damping / whole.damping), 0.0, atol=0.2)


def test_gaps_are_left_out() -> None:
    t = np.arange(0.0, 900.0, 0.05)
    vectors = path(2, t)
    vectors[9000:] += 0.3  # what the bridging of a long gap made of it
    good = np.ones(len(t), bool)
    good[8000:9001] = False
    model = fit_flexure(t, Rotation.from_rotvec(vectors).as_quat(), good, Rig())
    np.testing.assert_allclose(model.std / (4 * ARCMIN), 1.0, atol=0.3)


def test_gaps_of_a_unit_leave_the_flexure_as_it_was() -> None:
    """What the bridging of each gap misses goes into a drift of its own, not into the flexure."""
    trial = simulated(twin_of("td-ma", 900.0, rate=25.0), 3)[0]
    t = trial.seconds(trial.sub.stamp)
    lost = ((t > 150) & (t < 155)) | ((t > 300) & (t < 310)) | ((t > 450) & (t < 450.13)) | ((t > 600) & (t < 620))
    whole, gapped = identified(trial), identified(replace(trial, sub=cut(trial.sub, ~lost)))
    np.testing.assert_allclose(gapped.std / whole.std, 1.0, atol=0.25)
    np.testing.assert_allclose(gapped.stiffness / whole.stiffness, 1.0, atol=0.3)


def test_gyro_noise_is_kept_from_round_to_round() -> None:
    """A second fit that starts from the first must not fall back to the prior of a fibre gyro."""
    noise = 0.42 * np.pi / 10800.0
    t = np.arange(0.0, 300.0, 0.01)
    total = Rotation.from_rotvec(path(3, t, noise)).as_quat()
    good = np.ones(len(t), bool)
    first = fit_flexure(t, total, good, Rig())
    second = fit_flexure(t, total, good, Rig(), first)
    np.testing.assert_allclose(first.gyro_noise, noise, rtol=0.05)
    np.testing.assert_allclose(second.gyro_noise, noise, rtol=0.05)
    np.testing.assert_allclose(np.log(second.std / first.std), 0.0, atol=0.1)


def test_coarse_units_are_told_by_their_noise() -> None:
    model = identified(simulated(twin_of("idam", 200.0, imu=MEMS), 2)[0])
    np.testing.assert_allclose(model.gyro_noise, 0.3 * np.sqrt(2) * np.pi / 10800.0, rtol=0.1)


def test_short_record_is_called_weak() -> None:
    model = identified(simulated(twin_of("idam", 100.0), 5)[0])
    assert model.status[2] is Status.WEAK
    assert "correlation times" in model.reason[2]
    assert np.isfinite(model.std).all()


def test_rigid_deck_is_told() -> None:
    still = twin_of("idam", 200.0, flexure={"std_arcmin": [0.0, 0.0, 0.0]})
    model = identified(simulated(still, 6)[0])
    assert all(status is Status.WEAK for status in model.status)
    assert model.std.max() < 1.0 * ARCMIN


def test_hardly_any_data_are_refused() -> None:
    trial = simulated(twin_of("idam", 60.0), 7)[0]
    short = replace(trial, sub=cut(trial.sub, trial.seconds(trial.sub.stamp) > 57.0))
    alignment = align.align(trial)
    with pytest.raises(DataError):
        identify.get("whittle")().identify(short, alignment)
    t = np.arange(0.0, 60.0, 0.1)
    with pytest.raises(DataError, match="gap"):
        fit_flexure(t, Rotation.from_rotvec(path(8, t)).as_quat(), np.arange(len(t)) % 90 < 60, Rig())


def test_rig_states_the_gyro_noise() -> None:
    grade = ImuGrade(gyro_arw=3e-6)
    centre, spread = gyro_noise_prior(Rig(main=grade, sub=grade))
    assert centre == pytest.approx(np.sqrt(2) * 3e-6)
    assert spread < gyro_noise_prior(Rig())[1]


def test_registry_of_identifiers_answers_to_its_names() -> None:
    assert identify.names()[0] == "whittle"
    assert identify.get("whittle").name == "whittle"
    with pytest.raises(ValueError, match="whittle"):
        identify.get("no such")
