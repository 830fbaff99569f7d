"""A deck that stiffens, told from one that does not, on paths that are seen without noise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from physics import flexure
from physics.flexure import driven, noise_covariance, transition
from physics.recursion import stiffening_excess
from physics.units import ARCMIN
from schemas.products import FlexureModel
from schemas.rig import FloatArray
from stages.diagnose import stiffening
from stages.diagnose.evidence import Gram, gram, solve
from stages.diagnose.view import foretold

T, WITHIN, SECONDS = 0.01, 10, 600.0  # s, samples in a step, s
MU, STIFFNESS = np.array([0.1, 0.2, 0.07]), np.array([0.3, 0.5, 0.1])
STD = 5.0 * ARCMIN
GAIN = 0.06  # 1/arcmin^2


def path(gain: float, seed: int) -> FloatArray:
    """(n, 3) rad."""
    t = T * np.arange(int(SECONDS / T))
    out = []
    for axis, (mu, b2) in enumerate(zip(MU, STIFFNESS)):
        plain = flexure.sample(mu, b2, STD, np.diff(t), np.random.default_rng([seed, axis]))[0]
        out.append(plain + stiffening_excess(t, plain, mu, b2, gain / ARCMIN**2, 0.0))
    return np.stack(out, axis=1)


def model(damping: FloatArray, stiffness: FloatArray) -> FlexureModel:
    return FlexureModel("", damping, stiffness, np.full(3, STD), np.zeros((3, 3, 3)), np.zeros(3))


def innovations(theta: FloatArray, mu: FloatArray, b2: FloatArray) -> FloatArray:
    """(N, 3, 2) of angle and rate over steps, whitened by a linear deck's."""
    state = np.stack([theta, np.gradient(theta, T, axis=0)], axis=2)[::WITHIN]
    h, out = np.array(WITHIN * T), []
    for axis in range(3):
        left = state[1:, axis] - state[:-1, axis] @ transition(mu[axis], b2[axis], h).T
        root = np.linalg.cholesky(noise_covariance(mu[axis], b2[axis], STD, h))
        out.append(np.linalg.solve(root, left.T).T)
    return np.stack(out, axis=1)


def log_of(theta: FloatArray, believed: FloatArray, seen: FloatArray) -> tuple[Gram, stiffening.Deck]:
    """The Gram of a log's innovations under a model ``seen`` (2, 3); believed: of the twin."""
    mu, b2 = seen
    view = SimpleNamespace(
        theta=theta, interval=T, answering=seen, damping=believed[0], stiffness=believed[1],
        foretold=np.stack(foretold(theta, model(mu, b2), T, WITHIN)),
    )  # fmt: skip
    bending = [signals.bending for signals in stiffening.columns(view)]  # type: ignore[arg-type]
    columns = np.stack([innovations(one, mu, b2).reshape(-1, 6) for one in bending], axis=2)
    y = innovations(theta, mu, b2).reshape(len(columns), 6)
    scale = y.std(axis=0)
    precision = np.ones(len(stiffening.NAMES))
    t = WITHIN * T * np.arange(1, len(y) + 1)
    found = gram(stiffening.NAMES, columns / scale[:, None], y / scale, t, precision)
    return found, stiffening.deck_of(view)  # type: ignore[arg-type]


def test_what_was_foretold_holds_nothing_of_the_noise_to_come():
    """The rate at the instants themselves looks like damping that lacks altogether, on a deck that lacks none."""
    theta = path(0.0, 1)
    columns = {
        "as it is": np.gradient(theta, T, axis=0),
        "foretold": foretold(theta, model(MU, STIFFNESS), T, WITHIN)[1],
    }
    lacking = {}
    for name, rate in columns.items():
        bending = [driven(mu, b2, T, -2.0 * mu * one) for mu, b2, one in zip(MU, STIFFNESS, rate.T)]
        X, y = innovations(np.stack(bending, axis=1), MU, STIFFNESS), innovations(theta, MU, STIFFNESS)
        lacking[name] = np.sum(X * y, axis=(0, 2)) / np.sum(X * X, axis=(0, 2))
    assert np.all(np.abs(lacking["foretold"]) < 0.4)
    assert np.all(lacking["as it is"] < -0.6)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_gain_is_that_of_the_deck_and_not_of_its_twin(seed):
    """The twin takes the deck for a half softer on one axis and stiffer on another; the model follows the log."""
    believed = np.stack([MU * [1.1, 0.9, 1.0], STIFFNESS * [0.7, 1.4, 1.0]])
    found, deck = log_of(path(GAIN, seed), believed, np.stack([MU, 2.5 * STIFFNESS]))
    fitted = stiffening.fit(found, (), deck)
    assert abs(fitted.gain - GAIN) < 3.0 * np.sqrt(fitted.variance)
    assert np.sqrt(fitted.variance) < 0.2 * GAIN
    assert stiffening.evidence(found, (), deck) > 50.0
    np.testing.assert_allclose(fitted.deck.found[1], STIFFNESS, rtol=0.35)


@pytest.mark.parametrize("seed", range(5))
def test_a_deck_that_is_what_its_twin_says_does_not_stiffen(seed):
    found, deck = log_of(path(0.0, seed), np.stack([1.2 * MU, 0.8 * STIFFNESS]), np.stack([MU, STIFFNESS]))
    assert stiffening.evidence(found, (), deck) < 7.0


def test_what_the_twin_knows_of_its_stiffness_tells_a_slow_deck_that_stiffens():
    """A linear deck would have to be twice as stiff as the twin says: without the prior that is as good."""
    slow = np.stack([np.full(3, 0.08), np.full(3, 0.0064)])
    t = T * np.arange(int(SECONDS / T))
    plain = [flexure.sample(0.08, 0.0064, STD, np.diff(t), np.random.default_rng([5, axis]))[0] for axis in range(3)]
    theta = np.stack([one + stiffening_excess(t, one, 0.08, 0.0064, GAIN / ARCMIN**2, 0.0) for one in plain], axis=1)
    found, deck = log_of(theta, slow, slow * [[1.0], [2.5]])
    linear, cubic = found.index(stiffening.LINEAR), found.index(stiffening.NAMES)
    free = solve(found.total, found.precision, cubic).gain - solve(found.total, found.precision, linear).gain
    assert stiffening.evidence(found, (), deck) > free + 5.0
