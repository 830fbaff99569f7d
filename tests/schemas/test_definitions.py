"""Message definitions: the ones we ship and the ones that logs bring."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from schemas.errors import DataError
from schemas.wire.definitions import Field, defined, definition, message_type, parse

STANDARD = [name for name in defined() if not name.startswith("deckflex")]


@pytest.mark.parametrize("name", STANDARD)
def test_standard_definitions_have_the_layout_hash_of_ros(name: str):
    store = get_typestore(Stores.ROS2_HUMBLE)
    expected = store.generate_ros2_hash(name) if hasattr(store, "generate_ros2_hash") else store.hash_rihs01(name)
    fresh = get_typestore(Stores.EMPTY)
    fresh.register(get_types_from_msg(definition(name), name))
    assert (fresh.hash_rihs01(name) if hasattr(fresh, "hash_rihs01") else fresh.generate_ros2_hash(name)) == expected


def test_every_definition_carries_its_dependencies_once():
    text = definition("deckflex_msgs/msg/Deformation")
    assert [line for line in text.splitlines() if line.startswith("MSG:")] == [
        "MSG: std_msgs/Header", "MSG: builtin_interfaces/Time", "MSG: geometry_msgs/Vector3",
    ]  # fmt: skip
    assert text.count("=" * 80) == 3


def test_constants_defaults_bounds_and_comments_are_read_past():
    text = """
# a comment
int8 A=-1
string NAME = "x # y"
float64 w 1   # default
string<=10 s "a = b"
int32[<=5] few [1, 2]
string<=3[2] pair
"""
    assert parse("p/T", text).root == (
        Field("w", "float64"),
        Field("s", "string"),
        Field("few", "int32", sequence=True),
        Field("pair", "string", 2),
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("wstring a\n", "wstring"),
        ("Other a\n", "p/msg/Other is not defined"),
        ("float64\n", "cannot read the line"),
        ("float64 a\nint8 a\n", "named twice"),
        ("p/T a\n", "contains itself"),
        ("float64 ../../x\n", "no field name"),
        ("int8 a\n====\nnonsense\n", "MSG:"),
    ],
)
def test_a_definition_that_cannot_be_used_says_why(text: str, words: str):
    with pytest.raises(DataError, match=words):
        parse("p/T", text)


def test_an_unknown_definition_is_named():
    with pytest.raises(KeyError, match="no definition of a/msg/B"):
        definition("a/B")


def test_the_definition_of_a_sequence_of_messages_is_parsed_from_a_log_with_windows_line_ends():
    mtype = parse("p/T", "Inner[] a\r\n" + "=" * 80 + "\r\nMSG: p/Inner\r\nfloat64 x\r\n")
    assert mtype.fields["p/msg/Inner"] == (Field("x", "float64"),)


def test_parsed_types_are_cached():
    assert message_type("sensor_msgs/msg/Imu") is message_type("sensor_msgs/msg/Imu")
