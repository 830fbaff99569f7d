"""CDR to columns and back, against annotated bytes, a slow codec and two other implementations."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from schemas.errors import DataError
from schemas.wire.cdr import Bad, Decoder, Part, encode
from schemas.wire.definitions import parse
from schemas.wire.layout import empty_layout
from tests.oracles.cdr import Encoder
from tests.schemas.random_messages import Sample, samples

BOUNDED = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)


def decode(text: str, payloads: list[bytes]) -> tuple[dict[str, Any], list[Bad]]:
    """Columns of the good messages in order, and the bad parts."""
    pieces, offset, position = [b"\xaa" * 40], [], 40
    for payload in payloads:
        offset.append(position)
        pieces.append(payload + b"\xbb" * 3)
        position += len(payload) + 3
    buffer = np.frombuffer(b"".join([*pieces, b"\xcc" * 8]), np.uint8)
    length = np.array([len(payload) for payload in payloads])
    parts = list(Decoder(parse("pkg/Outer", text)).decode(buffer, np.array(offset), length))
    rows: dict[str, dict[int, Any]] = {}
    for part in parts:
        if isinstance(part, Part):
            which = np.arange(len(payloads)) if part.rows is None else part.rows
            for path, values in part.columns.items():
                rows.setdefault(path, {}).update(zip(which.tolist(), values, strict=True))
    columns = {path: [values[k] for k in sorted(values)] for path, values in rows.items()}
    return columns, [part for part in parts if isinstance(part, Bad)]


def flat(kind: Any, value: Any, path: str = "") -> dict[str, Any]:
    """The columns' view of a nested value: arrays of messages become arrays of each of their fields."""
    if isinstance(kind, list):
        leaves: dict[str, Any] = {}
        for name, inner in kind:
            leaves |= flat(inner, value[name], f"{path}.{name}" if path else name)
        return leaves
    if isinstance(kind, tuple) and isinstance(kind[1], list):
        each = [flat(kind[1], item, path) for item in value]
        names = flat(kind[1], _blank(kind[1]), path)
        return {name: [one[name] for one in each] for name in names}
    return {path: value}


def _blank(kind: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: _blank(inner) if isinstance(inner, list) else [] for name, inner in kind}


def plain(value: Any) -> Any:
    """Nested lists of Python values."""
    if isinstance(value, (list, tuple, np.ndarray, bytes)):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def test_every_byte_of_an_annotated_message_is_where_alignment_puts_it():
    text = "uint8 a\nfloat64 b\nstring c\nint16[] d\nfloat64[] e\nbool f\n"
    payload = bytes.fromhex(
        "00010000"  # plain CDR, little-endian
        "07" "00000000000000"  # a, 7 bytes of padding up to the 8-byte boundary of b
        "000000000000f83f"  # b = 1.5
        "03000000" "686900"  # c: 3 bytes, "hi" and its NUL
        "00" "02000000" "0100" "feff"  # d: padding, 2 elements, 1 and -2
        "00000000"  # e: no elements, hence no padding to 8 either
        "01"  # f
    )  # fmt: skip
    columns, bad = decode(text, [payload])
    assert bad == []
    assert plain([columns[name][0] for name in "abcdef"]) == [7, 1.5, "hi", [1, -2], [], True]


def test_both_endiannesses_in_one_channel_give_the_same_values():
    little, big = Encoder("<"), Encoder(">")
    for encoder in (little, big):
        encoder.value([("t", "int32"), ("n", "uint32"), ("x", "float64")], {"t": 3, "n": 5, "x": -2.5})
    columns, _ = decode("builtin_interfaces/Time t\nfloat64 x\n", [little.bytes(), big.bytes(), little.bytes()])
    assert columns["t"] == [3_000_000_005] * 3
    assert columns["x"] == [-2.5] * 3


def test_equal_total_length_with_different_strings_is_told_apart():
    text = "string a\nstring b\nfloat64 x\n"
    kinds = [("a", "string"), ("b", "string"), ("x", "float64")]
    values = [{"a": "abc", "b": "", "x": 1.0}, {"a": "", "b": "abc", "x": 2.0}, {"a": "ab", "b": "d", "x": 3.0}] * 5
    payloads = []
    for value in values:
        encoder = Encoder()
        encoder.value(kinds, value)
        payloads.append(encoder.bytes())
    assert len(set(map(len, payloads))) == 1
    columns, _ = decode(text, payloads)
    assert [dict(zip("abx", row, strict=True)) for row in zip(*(columns[n] for n in "abx"), strict=True)] == values


@given(samples(), st.sampled_from("<>"))
@BOUNDED
def test_random_messages_decode_to_the_values_of_the_slow_codec(sample: Sample, order: str):
    columns, bad = decode(sample.text, sample.payloads(order))
    assert bad == []
    expected = [flat(sample.kinds, value) for value in sample.values]
    for path in expected[0]:
        assert plain(columns[path]) == [plain(row[path]) for row in expected], path


@given(samples())
@BOUNDED
def test_random_messages_encode_to_the_bytes_of_the_slow_codec(sample: Sample):
    columns, _ = decode(sample.text, sample.payloads("<"))
    nodes = empty_layout(parse("pkg/Outer", sample.text)).leaves
    arrays = {path: _column(values, nodes[path].ragged) for path, values in columns.items()}
    encoded: dict[int, bytes] = {}
    for group in encode(parse("pkg/Outer", sample.text), arrays, len(sample.values), 2):
        encoded.update(zip(group.rows.tolist(), (row[2:].tobytes() for row in group.data), strict=True))
    assert [encoded[k] for k in range(len(sample.values))] == sample.payloads("<")


def _column(values: list[Any], ragged: bool) -> Any:
    if not ragged:
        return np.array(values, dtype=object if isinstance(values[0], str) else None)
    out = np.empty(len(values), dtype=object)
    for k, value in enumerate(values):
        out[k] = value
    return out


@given(samples(nested=False))
@BOUNDED
def test_random_messages_decode_as_rosbags_and_mcap_ros2_decode_them(sample: Sample):
    payloads = sample.payloads("<")
    columns, _ = decode(sample.text, payloads)
    store = get_typestore(Stores.EMPTY)
    own = sample.text.split("=" * 80)[0]
    store.register(get_types_from_msg(own, "pkg/msg/Outer"))
    read = generate_dynamic("pkg/Outer", own)["pkg/Outer"]
    for row, payload in enumerate(payloads):
        theirs: SimpleNamespace = store.deserialize_cdr(payload, "pkg/msg/Outer")
        others = read(payload)
        for path, values in columns.items():
            assert plain(values[row]) == plain(getattr(theirs, path)), path
            assert plain(values[row]) == plain(getattr(others, path)), path


def test_messages_too_short_too_long_or_of_another_encapsulation_are_reported_and_the_rest_kept():
    good = Encoder()
    good.value("float64", 1.0)
    payload = good.bytes()
    others = [payload[:-1], payload + bytes(9), b"\x00\x03" + payload[2:], b"", payload[:3]]
    columns, bad = decode("float64 x\n", [payload, *others, payload])
    assert columns["x"] == [1.0, 1.0]
    assert sorted(row for part in bad for row in part.rows.tolist()) == [1, 2, 3, 4, 5]
    assert {part.reason for part in bad} >= {"encapsulation 0x0003 is not plain CDR"}


def test_a_sequence_that_claims_more_than_the_message_holds_is_refused():
    encoder = Encoder()
    encoder.primitive("uint32", 4_000_000_000)
    for text in (
        "float64[] x\n",
        "string[] x\n",
        "Inner[] x\n" + "=" * 80 + "\nMSG: pkg/Inner\nuint8 a\n",
        "string x\n",
    ):
        columns, bad = decode(text, [encoder.bytes()])
        assert columns == {}
        assert len(bad) == 1


def test_a_column_that_the_type_does_not_have_or_that_does_not_fit_is_refused():
    mtype = parse("pkg/Outer", "uint8[3] x\n")
    with pytest.raises(DataError, match="no field y"):
        encode(mtype, {"y": np.zeros(2)}, 2, 0)
    with pytest.raises(DataError, match="x does not fit"):
        encode(mtype, {"x": np.zeros((2, 4))}, 2, 0)


def test_an_array_of_stamps_is_nanoseconds():
    encoder = Encoder()
    for part in (1, 2, 3, 4):
        encoder.primitive("uint32", part)
    columns, _ = decode("builtin_interfaces/Time[2] t\n", [encoder.bytes()])
    assert columns["t"][0].tolist() == [1_000_000_002, 3_000_000_004]


def test_byte_and_char_are_unsigned():
    columns, _ = decode("byte a\nchar b\n", [b"\0\1\0\0\xc8\xff"])
    assert plain([columns["a"][0], columns["b"][0]]) == [200, 255]
