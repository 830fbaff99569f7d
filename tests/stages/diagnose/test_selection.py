"""What a name has to be worth beside those that are there already."""

import numpy as np
import pytest

from stages.diagnose.pick import Pick
from stages.diagnose.regressors import Group
from stages.diagnose.selection import _worth


def pick(effect: str, shape: dict[str, float]) -> Pick:
    return Pick(Group(effect, (f"{effect}|x|",), ("x",), shape), np.ones(1), np.eye(1), np.ones(1))


@pytest.mark.parametrize(
    ("first", "shape", "told"),
    [
        ("gyro_scale_factor", {}, False),  # what linearisation leaves of it may be that large
        ("misalignment_step", {"time": 100.0}, True),  # it is told by one instant, and leaves nothing beside it
    ],
)
def test_a_strong_name_sets_the_bar_for_the_next_one_unless_it_is_an_event(first, shape, told) -> None:
    assert _worth(479.0, 14.0, {first: 1e6}, [pick(first, shape)]) is told
    assert not _worth(13.0, 14.0, {first: 1e6}, [pick(first, shape)])
