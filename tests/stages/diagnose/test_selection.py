"""What a name has to be worth beside those that are there already: on Gram matrices made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from schemas.rig import FloatArray
from stages.diagnose import selection
from stages.diagnose.evidence import gram, held_out_sum
from stages.diagnose.pick import Pick
from stages.diagnose.regressors import Group, Regressors

N, STEP = 1800, 0.5  # rows, and s between them
T = STEP * np.arange(N)
FLAT, TIED = 1e-12, 1.0  # precision of an effect's columns and of a nuisance's


def group(effect: str, parameter: str, **shape: float) -> Group:
    return Group(effect, (f"{effect}|{parameter}",), (parameter,), shape)


SCALE, BENT, BIAS = group("gyro_scale_factor", "x"), group("thermal_bending", "amplitude.x"), group("gyro_bias", "x")
EVENT = group("misalignment_step", "x", time=100.0)


def regressors(y: FloatArray, *columns: tuple[Group, FloatArray]) -> Regressors:
    """A nuisance and one column a group, three channels of which the first is of use."""
    X = np.stack([np.ones(N), *(column for _, column in columns)], axis=1)
    wide = np.concatenate([X[:, None], np.zeros((N, 2, X.shape[1]))], axis=1)
    values = np.concatenate([y[:, None], np.zeros((N, 2))], axis=1)
    names = ["nuisance", *(g.names[0] for g, _ in columns)]
    precision = np.array([TIED, *(FLAT for _ in columns)])
    groups = tuple(g for g, _ in columns)
    return Regressors(groups, gram(names, wide, values, T, precision), ("nuisance",), values, wide, {})


def test_a_step_that_is_named_gains_nothing_for_others_in_the_half_that_does_not_hold_it() -> None:
    """Its column is one instant and next to nothing elsewhere: a half without the instant would make it anything."""
    rng = np.random.default_rng(2)
    jump = 1e-4 * rng.standard_normal(N)
    jump[200] = 30.0
    scale = rng.standard_normal(N)
    y = rng.standard_normal(N) + 0.3 * jump + 0.2 * scale
    found = regressors(y, (SCALE, scale), (EVENT, jump))
    picks = (Pick(EVENT, np.array([0.3]), np.eye(1), np.zeros(1)),)
    calm = selection._frozen(found, selection._fitted(found, picks), picks)
    told, _ = selection._scored(found, calm, picks)["gyro_scale_factor"]
    bare = regressors(y - 0.3 * jump, (SCALE, scale))
    expected = held_out_sum(bare.gram, [0], bare.gram.index(SCALE.names))
    assert 20.0 < expected < 60.0
    assert told == pytest.approx(expected, abs=2.0)
    spoiled = held_out_sum(found.gram, [0, 2], found.gram.index(SCALE.names))
    assert abs(spoiled - expected) > 100.0


def test_beside_slow_bending_a_constant_counts_for_what_it_adds_and_anything_else_for_what_it_is() -> None:
    rng = np.random.default_rng(3)
    hump, scale = np.sin(np.pi * T / T[-1]), rng.standard_normal(N)
    trend = hump + 0.05 * rng.standard_normal(N)
    found = regressors(rng.standard_normal(N) + hump + 0.2 * scale, (BENT, hump), (BIAS, trend), (SCALE, scale))
    scored = {g.effect: (held_out_sum(found.gram, [0], found.gram.index(g.names)), g) for g in (BENT, BIAS, SCALE)}
    assert scored["thermal_bending"][0] > scored["gyro_bias"][0] > 30.0
    told = selection._beside(found, found.gram, (), scored, ["thermal_bending"])
    assert told["thermal_bending"] == scored["thermal_bending"]
    assert told["gyro_bias"][0] < 5.0
    assert told["gyro_scale_factor"][0] == pytest.approx(scored["gyro_scale_factor"][0], abs=3.0)


@pytest.mark.parametrize(
    ("first", "shape", "told"),
    [
        ("gyro_scale_factor", {}, False),  # what linearisation leaves of it may be that large
        ("misalignment_step", {"time": 100.0}, True),  # it is told by one instant, and leaves nothing beside it
    ],
)
def test_a_strong_name_sets_the_bar_for_the_next_one_unless_it_is_an_event(first, shape, told) -> None:
    picks = [Pick(group(first, "x", **shape), np.ones(1), np.eye(1), np.ones(1))]
    assert selection._worth(479.0, 14.0, {first: 1e6}, picks) is told
    assert not selection._worth(13.0, 14.0, {first: 1e6}, picks)
