"""Every deck-shape method is found by name and says what it is."""

import dataclasses

import pytest

from stages import shape


@pytest.mark.parametrize("name", shape.names())
def test_every_entry_states_itself(name: str) -> None:
    method = shape.get(name)
    assert method.name == name
    assert method.source
    assert set(method.options) == {f.name for f in dataclasses.fields(method)}
    method()


def test_default_is_there() -> None:
    assert shape.DEFAULT in shape.names()


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match="spline, wavelet-kalman"):
        shape.get("splines")
