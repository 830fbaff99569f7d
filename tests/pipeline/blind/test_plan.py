"""A set is balanced, shuffled, and gives nothing away by its order."""

from collections import Counter

import numpy as np
import pytest

from pipeline.blind.plan import CHANNELS, Shares, Wish, plan
from pipeline.blind.reality.severity import FOREIGN, LISTED
from schemas.errors import DataError
from twin.effects import look_alikes


@pytest.fixture(scope="module")
def orders():
    return plan(400, Wish(), np.random.default_rng(1))


def test_the_shares_are_kept(orders):
    assert Counter(o.kind for o in orders) == {"null": 140, "pair": 48, "foreign": 40, "removed": 24, "single": 148}


def test_every_effect_and_severity_is_drawn_about_as_often(orders):
    names = Counter(o.effects[0] for o in orders if o.kind == "single")
    assert set(names) == set(LISTED)
    assert max(names.values()) - min(names.values()) <= 3
    severities = Counter(o.severity for o in orders if o.kind == "single")
    assert max(severities.values()) - min(severities.values()) < 0.35 * 148 / 3
    assert set(Counter(o.effects[0] for o in orders if o.kind == "foreign")) == set(FOREIGN)


def test_pairs_are_of_effects_that_can_be_told_apart(orders):
    for order in orders:
        if order.kind == "pair":
            first, second = order.effects
            assert second not in {alike.name for alike in look_alikes(first, CHANNELS)}


def test_what_the_library_is_denied_does_not_tell_what_is_there(orders):
    denied = [o for o in orders if o.without]
    really = [o for o in denied if set(o.without) & set(o.effects)]
    assert len(really) == 24
    assert len(denied) == 48


def test_the_order_tells_nothing(orders):
    places = [k for k, o in enumerate(orders) if o.kind == "null"]
    assert abs(np.mean(places) - 200) < 30
    assert plan(400, Wish(), np.random.default_rng(2)) != orders


def test_shares_that_make_no_sense_are_refused():
    with pytest.raises(DataError, match="add up"):
        Shares(null=0.9, pair=0.2)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_small_sets_have_their_number_of_logs(count):
    assert len(plan(count, Wish(), np.random.default_rng(1))) == count
