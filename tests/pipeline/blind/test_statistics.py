"""Intervals against published figures and against brute force."""

import numpy as np
import pytest

from pipeline.blind.statistics import Share, median, share


def test_wilsons_interval():
    # Newcombe (1998), Stat. Med. 17, 857, table I, method 3: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    for k, n, low, high in (
        (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)
    ):  # fmt: skip
        assert Share(k, n).interval == pytest.approx((low, high), abs=6e-5)


def test_a_share_of_nothing_is_none():
    nothing = share([])
    assert nothing.document() == {"k": 0, "n": 0, "share": None, "ci95": [0.0, 1.0]}


def test_the_interval_of_a_median_holds_it_about_as_often_as_it_says():
    rng = np.random.default_rng(3)
    held = [m.low <= 0.0 <= m.high for m in (median(rng.standard_normal(40)) for _ in range(200))]
    assert 0.88 < np.mean(held) <= 1.0


def test_a_median_is_repeatable():
    values = list(np.random.default_rng(1).standard_normal(30))
    assert median(values) == median(values)
    assert median([]).value is None
