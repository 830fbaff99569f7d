"""Constants beyond what a twin tolerates are seen without a name, and those within it are not."""

from __future__ import annotations

import numpy as np
import pytest

from stages.diagnose.ceiling import _constant
from stages.diagnose.evidence import gram

SIGMA, ROWS = 0.1, 2000
NAMES = tuple(f"accel bias {axis}" for axis in "xyz")


@pytest.mark.parametrize("sigmas", [0.5, 8.0])
def test_a_constant_is_told_by_what_its_prior_costs(sigmas: float) -> None:
    rng = np.random.default_rng(4)
    columns = np.zeros((ROWS, 3, 3))
    columns[:, range(3), range(3)] = 1.0
    y = rng.standard_normal((ROWS, 3)) + sigmas * SIGMA * np.array([0.0, -1.0, 0.0])
    found = gram(NAMES, columns, y, np.arange(float(ROWS)), np.full(3, SIGMA**-2))
    family = _constant(found, [0, 1, 2], "accel bias", "sub.accel")
    mean = y.mean(axis=0)
    cost = 0.5 * float(np.sum(mean**2)) / (SIGMA**2 + 1.0 / ROWS)  # of each mean under its prior, noise and all
    assert family.gain.sum() == pytest.approx(cost - 3.0, abs=0.1)
    assert (family.channel, family.axis) == ("sub.accel", "y") or sigmas < 1.0
    assert (family.gain.sum() > 20.0) == (sigmas > 1.0)
