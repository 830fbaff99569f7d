"""What mean effects predict in a log is what they put into a simulated one: differences of two simulations of one seed.

Noise and sea are the same in both, so that the difference of their observations is the effect alone. It is compared
with the prediction after both went through the filter's gains, which weighs errors as the regression does. A
prediction holds no random flexure on purpose; where the deck is nearly rigid nothing else may be missing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from physics import quaternions
from physics.rotations import exp
from schemas.products import Alignment, Estimate, FlexureModel
from stages.diagnose import whitening
from stages.diagnose.columns import Response, lever_velocity
from stages.diagnose.shrinkage import augmented_twin
from stages.diagnose.view import believed, log_view
from stages.diagnose.whitening import AccelColour, Levels, PhinsMatch, Whitened
from stages.estimate import tuning
from stages.paired import Linearisation, Observations, observe, pair
from twin import Simulation, Twin, effects, load_twin, parse_twin, simulate, with_run
from twin.effects import Effect
from twin.effects._change import section
from twin.effects._prediction import Column, LogView

ARCMIN = np.pi / 10800.0
LIVELY = with_run(load_twin("random-sea"), duration=120.0)
RIGID = section(LIVELY, "flexure", std_arcmin=(0.4, 0.4, 0.4))
SEED = 11
LEAST = 1e-3  # whitened size of an effect that is there at all

# sizes in the declarations' units, small enough for first order
SIZES: dict[str, float] = {
    "accel_bias": 300.0,
    "accel_scale_factor": 100.0,
    "clock_drift": 1.0,
    "gyro_bias": 0.5,
    "gyro_g_sensitivity": 1.0,
    "gyro_nonorthogonality": 20.0,
    "gyro_scale_factor": 100.0,
    "gyro_temperature": 0.1,
    "heel_bending": 2.0,
    "lever_arm": 0.01,
    "misalignment_step": 0.5,
    "phins_attitude_error": 0.5,
    "static_misalignment": 1.0,
    "thermal_bending": 1.0,
    "time_delay": 1e-4,
    "wave_forced_bending": 0.05,
}
SHAPES: dict[str, dict[str, float]] = {
    "misalignment_step": {"time": 63.705},
    "phins_attitude_error": {"period": 70.0},
    "thermal_bending": {"period": 400.0},
}
MIXED = (1.0, -0.6, 0.8, 0.5, -0.9, 0.7)  # of the sizes, where all parameters of an effect are there at once
# what may be missing (whitened, relative) on a lively deck: of 5 % or more only what multiplies flexure
LIVELY_MOST = {
    "clock_drift": 0.2,  # the flexure's own rate and its derivatives are late as well
    "time_delay": 0.2,
    "gyro_bias": 0.1,
    "gyro_g_sensitivity": 0.2,
    "gyro_nonorthogonality": 0.1,
    "gyro_scale_factor": 0.1,
    "gyro_temperature": 0.1,
    "static_misalignment": 0.2,
    "heel_bending": 0.25,  # both are small beside the flexure: what is missing is second order
    "wave_forced_bending": 0.25,
}


@dataclass(frozen=True)
class Seen:
    """A log observed about its twin, noise and all. signal: (N, 9) as the filter takes it."""

    simulation: Simulation
    twin: Twin
    obs: Observations
    match: PhinsMatch
    signal: np.ndarray


@dataclass(frozen=True)
class Reference:
    """The log without effects, what effects predict from it, and the gains that whiten it."""

    seen: Seen
    view: LogView
    response: Response
    whitened: Whitened

    def relative(self, difference: np.ndarray, predicted: np.ndarray) -> float:
        """Whitened RMS of what the prediction misses over that of the difference, both (N, 9)."""
        pair_ = np.stack([np.nan_to_num(difference), np.nan_to_num(difference - predicted)], axis=2)
        there, missed = np.linalg.norm(whitening.whiten_columns(self.whitened, pair_), axis=(0, 1))
        assert there > LEAST
        return float(missed / there)


def seen(simulation: Simulation, twin: Twin) -> Seen:
    source = believed(simulation.trial, twin)
    at = linearised(twin)
    obs = observe(pair(source.trial, despike=False), at)
    match = whitening.phins_match(source.trial, obs)
    assert match is not None
    moved = lever_velocity(obs, at.coupling, obs.z)
    return Seen(simulation, twin, obs, match, np.hstack([obs.z, obs.u - moved, match.q]))


def alignment(twin: Twin) -> Alignment:
    static = np.array(twin.mount.static_arcmin) * ARCMIN
    delay = Estimate(np.asarray(0.0), np.asarray(1e-4))
    return Alignment(exp(static), Estimate(static, np.full(3, 1e-3)), 1e-6 * np.eye(3), delay)


def linearised(twin: Twin) -> Linearisation:
    return Linearisation.at(alignment(twin), np.array(twin.mount.lever_arm))


def flexure(twin: Twin) -> FlexureModel:
    mu, frequency = np.array(twin.flexure.damping), np.array(twin.flexure.frequency)
    std = np.array(twin.flexure.std_arcmin) * ARCMIN
    return FlexureModel("the twin's", mu, mu**2 + frequency**2, std, np.zeros((3, 3, 3)), np.full(3, 4e-7))


def levels(twin: Twin, trial: Any) -> Levels:
    """Of the twin itself."""
    noise = tuning.initial(alignment(twin), flexure(twin), trial.rig)
    noise = replace(noise, jitter=np.full(3, 2e-6), velocity=np.full(3, 1e-5))
    return Levels(noise, AccelColour(np.full(3, 1e-4), 3.0), whitening.phins_noise(twin.phins))


def reference(twin: Twin) -> Reference:
    bare = seen(simulate(twin, np.random.default_rng(SEED)), twin)
    source, at = believed(bare.simulation.trial, twin), linearised(twin)
    truth = bare.simulation.truth
    t = bare.simulation.trial.seconds(truth.stamp)
    theta = np.stack([np.interp(bare.obs.t, t, column) for column in truth.dynamic_part.T], axis=1)
    model = whitening.build(bare.obs, levels(twin, source.trial), at.coupling, bare.match)
    whitened = whitening.whiten(model, bare.obs)
    view = log_view(source, bare.obs, at.R_ref, theta, flexure(twin))
    return Reference(bare, view, Response(bare.obs, at.R_ref, at.coupling), whitened)


@pytest.fixture(scope="module")
def rigid() -> Reference:
    return reference(RIGID)


@pytest.fixture(scope="module")
def lively() -> Reference:
    return reference(LIVELY)


def columns_of(name: str, view: LogView) -> tuple[Column, ...]:
    return effects.get(name).predict(view, **SHAPES.get(name, {}))


def parameters(columns: tuple[Column, ...], sizes: np.ndarray) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for column, size in zip(columns, sizes):
        owner, _, axis = column.parameter.partition(".")
        if axis:
            out.setdefault(owner, {})[axis] = float(size)
        else:
            out[owner] = float(size)
        out |= column.shape
    return out


def missed(about: Reference, name: str, sizes: np.ndarray) -> float:
    """Relative error of the prediction of an effect with such parameters."""
    columns = columns_of(name, about.view)
    assert len(columns) == len(sizes)
    twin = parse_twin(augmented_twin(about.seen.twin, [effects.build(name, parameters(columns, sizes))]))
    other = seen(simulate(twin, np.random.default_rng(SEED)), about.seen.twin)
    predicted = sum(size * about.response(column.signals) for size, column in zip(sizes, columns))
    return about.relative(other.signal - about.seen.signal, np.asarray(predicted))


def predicting() -> set[str]:
    base = Effect.predict.__func__  # type: ignore[attr-defined]
    return {name for name in effects.names() if effects.get(name).predict.__func__ is not base}


def test_every_effect_that_predicts_is_tested() -> None:
    assert predicting() == {*SIZES, "amplitude_stiffening", "phins_latency"}


@pytest.mark.parametrize("name", SIZES)
def test_an_effect_adds_to_a_log_what_it_predicts(rigid: Reference, name: str) -> None:
    count = len(columns_of(name, rigid.view))
    error = missed(rigid, name, SIZES[name] * np.array(MIXED[:count]))
    assert error < (0.08 if name == "wave_forced_bending" else 0.02), error  # roll carries the noise of the PHINS


COUNTS = {"gyro_nonorthogonality": 6, "clock_drift": 1, "time_delay": 1}
NUMBERS = [(name, k) for name in SIZES for k in range(COUNTS.get(name, 3))]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "k"), NUMBERS)
def test_each_parameter_adds_what_it_predicts_on_a_lively_deck(lively: Reference, name: str, k: int) -> None:
    sizes = np.zeros(len(columns_of(name, lively.view)))
    sizes[k] = SIZES[name]
    error = missed(lively, name, sizes)
    assert error < LIVELY_MOST.get(name, 0.05), error


def test_phins_latency_moves_both_attitudes_as_it_predicts(lively: Reference) -> None:
    delay = 2e-3
    (column,) = columns_of("phins_latency", lively.view)
    assert missed(lively, "phins_latency", np.array([delay])) < 0.05
    twin = parse_twin(augmented_twin(LIVELY, [effects.build("phins_latency", {"delay": delay})]))
    late = simulate(twin, np.random.default_rng(SEED)).trial.phins_main
    prompt = lively.seen.simulation.trial.phins_main
    turned = quaternions.log(quaternions.multiply(quaternions.conjugate(prompt.attitude), late.attitude))
    np.testing.assert_allclose(turned, delay * column.signals.phins_main, atol=0.05 * np.abs(turned).max())


def test_stiffening_bends_less_as_it_predicts(lively: Reference) -> None:
    """About the true flexure; its prediction starts at rest, the deck does not."""
    assert missed(lively, "amplitude_stiffening", np.array([1e-4])) < 0.25
