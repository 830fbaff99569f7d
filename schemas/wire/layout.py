"""Where each field of a CDR message sits: one layout serves all messages with the same length words.

Plain CDR (XCDR1): a primitive is aligned to its own size, counted from the end of the four-byte encapsulation header;
a string is a uint32 length (terminating NUL included) and its bytes; a sequence is a uint32 count and its elements.
Equal total length does not make two messages share a layout, because padding hides different string lengths; equal
length words do (all other sizes follow from the definition).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.definitions import EMPTY_MEMBER, PRIMITIVES, TIMES, Field, MessageType

Rows = NDArray[np.uint8]
Counter = Callable[[int], int]
MAX_NODES = 1_000_000
_TIME_SIZE = 8
_UNLIMITED = 1 << 62


class MisfitError(Exception):
    """The bytes of a message do not fit its definition."""


@dataclass(frozen=True)
class Leaf:
    """One primitive, string or stamp (kind) at a byte offset of the body, or an array of primitives (count)."""

    kind: str
    dtype: np.dtype[Any]
    offset: int
    count: int | None = None
    ragged: bool = False


@dataclass(frozen=True)
class Items:
    """The same field of each element in an array of messages or strings; empty tells what an empty array holds."""

    elements: tuple[Leaf | Items, ...]
    ragged: bool
    empty: Leaf | Items


Node = Leaf | Items


@dataclass(frozen=True)
class Layout:
    """leaves: by dotted path. words: (offset, value) of every length word. size: bytes of the body."""

    leaves: dict[str, Node]
    words: tuple[tuple[int, int], ...]
    size: int
    order: str


def layout_of_bytes(mtype: MessageType, body: bytes, order: str) -> Layout:
    """The layout of one message body. Raises MisfitError when its bytes do not fit the definition."""
    unpack = struct.Struct(f"{order}I").unpack_from
    return _Walk(mtype, order, len(body), lambda offset: int(unpack(body, offset)[0])).layout()


def layout_of_counts(mtype: MessageType, counts: list[int], order: str = "<") -> Layout:
    """The layout of a message whose length words, in the order of the wire, are counts."""
    remaining = iter(counts)
    return _Walk(mtype, order, _UNLIMITED, lambda _: next(remaining)).layout()


def empty_layout(mtype: MessageType) -> Layout:
    """The layout of a message whose strings and sequences are all empty."""
    return _Walk(mtype, "<", _UNLIMITED, lambda _: 0).layout()


class _Walk:
    """Walks a definition and the length words side by side."""

    def __init__(self, mtype: MessageType, order: str, limit: int, counter: Counter) -> None:
        self.mtype, self.order, self.limit, self.counter = mtype, order, limit, counter
        self.position = 0
        self.nodes = 0
        self.words: list[tuple[int, int]] = []

    def layout(self) -> Layout:
        leaves = self._message(self.mtype.name, "")
        return Layout(leaves, tuple(self.words), self.position, self.order)

    def _message(self, name: str, prefix: str) -> dict[str, Node]:
        leaves: dict[str, Node] = {}
        for field in self.mtype.fields[name]:
            found = self._field(field, prefix + field.name)
            if field.name != EMPTY_MEMBER:
                leaves.update(found)
        return leaves

    def _field(self, field: Field, path: str) -> dict[str, Node]:
        if field.size is None and not field.sequence:
            return self._single(field.base, path)
        count = self._word() if field.size is None else field.size
        if field.base in PRIMITIVES:
            return {path: self._primitive(field.base, count, field.sequence)}
        return self._items(field.base, path, count, field.sequence)

    def _single(self, base: str, path: str) -> dict[str, Node]:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            raise DataError(f"a message of type {self.mtype.name} has more than {MAX_NODES} fields")
        if base in PRIMITIVES:
            return {path: self._primitive(base, None, False)}
        if base == "string":
            length = self._word()
            return {path: Leaf("string", np.dtype(object), self._take(length, 1), length)}
        if base in TIMES:
            return {path: Leaf("time", np.dtype(self.order + "i8"), self._take(_TIME_SIZE, 4))}
        return self._message(base, f"{path}.")

    def _items(self, base: str, path: str, count: int, ragged: bool) -> dict[str, Node]:
        if count > max(self.limit - self.position, 0):
            raise MisfitError("an array is longer than the message")
        blank = _Walk(self.mtype, self.order, _UNLIMITED, lambda _: 0)._single(base, path)
        elements = [self._single(base, path) for _ in range(count)]
        return {leaf: Items(tuple(one[leaf] for one in elements), ragged, blank[leaf]) for leaf in blank}

    def _primitive(self, base: str, count: int | None, ragged: bool) -> Leaf:
        dtype = np.dtype(self.order + PRIMITIVES[base])
        size = dtype.itemsize * (1 if count is None else count)
        offset = self._take(size, dtype.itemsize) if size else self.position
        return Leaf("primitive", dtype, offset, count, ragged)

    def _take(self, size: int, alignment: int) -> int:
        """Offset of the next aligned size bytes, which are passed over."""
        offset = -(-self.position // alignment) * alignment
        self.position = offset + size
        if self.position > self.limit:
            raise MisfitError("the message is shorter than its definition says")
        return offset

    def _word(self) -> int:
        offset = self._take(4, 4)
        self.words.append((offset, self.counter(offset)))
        return self.words[-1][1]


def field_view(rows: Rows, offset: int, dtype: np.dtype[Any], count: int | None = None) -> NDArray[Any]:
    """View (n,) or (n, count) of a field that sits at one offset of every row; writing to it writes the rows."""
    stride = rows.strides[0]
    if count is None:
        return np.ndarray((len(rows),), dtype, rows, offset, (stride,))
    return np.ndarray((len(rows), count), dtype, rows, offset, (stride, dtype.itemsize))


def read_node(node: Node, rows: Rows, base: int) -> NDArray[Any]:
    """(n, ...) values of a field in rows of one layout, whose bodies start at byte base. May be a view of rows."""
    values = _read_leaf(node, rows, base) if isinstance(node, Leaf) else _read_items(node, rows, base)
    return as_objects(values) if node.ragged else values


def _read_leaf(leaf: Leaf, rows: Rows, base: int) -> NDArray[Any]:
    offset = base + leaf.offset
    if len(rows) == 0:
        shape = (0,) if leaf.count is None or leaf.kind == "string" else (0, leaf.count)
        return np.empty(shape, leaf.dtype.newbyteorder("="))
    if leaf.kind == "string":
        return _read_string(rows[:, offset : offset + (leaf.count or 0)])
    if leaf.kind == "time":
        return _read_time(rows, offset, ">" if leaf.dtype.byteorder == ">" else "<")
    values = field_view(rows, offset, leaf.dtype, leaf.count)
    return field_view(rows, offset, np.dtype(np.uint8), leaf.count) != 0 if leaf.dtype == np.bool_ else values


def _read_time(rows: Rows, offset: int, order: str) -> NDArray[np.int64]:
    seconds = field_view(rows, offset, np.dtype(f"{order}i4")).astype(np.int64)
    seconds *= 1_000_000_000
    seconds += field_view(rows, offset + 4, np.dtype(f"{order}u4"))
    return seconds


def _read_items(items: Items, rows: Rows, base: int) -> NDArray[Any]:
    if not items.elements:
        blank = read_node(items.empty, rows[:0], base)
        return np.empty((len(rows), 0, *blank.shape[1:]), blank.dtype)
    return np.stack([read_node(element, rows, base) for element in items.elements], axis=1)


def _read_string(text: Rows) -> NDArray[Any]:
    """(n,) str of (n, length) bytes; equal strings share one object."""
    if text.shape[1] == 0 or rows_alike(text):
        same = np.empty(1, dtype=object)
        same[0] = _decode(text[0].tobytes())
        return np.broadcast_to(same, (len(text),))
    whole = np.ascontiguousarray(text).view(f"V{text.shape[1]}")[:, 0]
    unique, inverse = np.unique(whole, return_inverse=True)
    return np.array([_decode(one.tobytes()) for one in unique], dtype=object)[inverse]


def items(values: NDArray[Any]) -> NDArray[np.void]:
    """(n,) opaque items of the rows of values (n, k), whose elements lie side by side.

    numpy moves these at once; rows of few elements it would move element by element.
    """
    return values.view(np.dtype((np.void, values.shape[1] * values.itemsize)))[:, 0]


def rows_alike(values: NDArray[Any]) -> bool:
    """Whether all rows of values (n, k) have the same bits."""
    width = values.shape[1] * values.itemsize
    unit = next(size for size in (8, 4, 2, 1) if width % size == 0)
    flat = np.ascontiguousarray(items(values)).view(f"u{unit}")
    return bool((flat[width // unit :] == flat[: -(width // unit)]).all())


def texts_alike(values: Any) -> bool:
    """Whether texts (n,), at least one, are all the same."""
    return values.strides[0] == 0 or bool((values == values[0]).all())


def _decode(text: bytes) -> str:
    return text.removesuffix(b"\0").decode("utf-8", errors="replace")


def as_objects(values: NDArray[Any]) -> NDArray[Any]:
    """(n,) objects, each a row of values."""
    out = np.empty(len(values), dtype=object)
    for k in range(len(values)):
        out[k] = np.array(values[k]) if values.dtype == object else np.array(values[k], values.dtype.newbyteorder("="))
    return out


def write_node(node: Node, rows: Rows, base: int, values: Any) -> None:
    """Write values (n, ...) of a field into rows of one layout; the inverse of :func:`read_node`."""
    if node.ragged:
        values = np.stack([np.asarray(value) for value in values]) if len(values) else values
    if isinstance(node, Items):
        for k, element in enumerate(node.elements):
            write_node(element, rows, base, values[:, k])
        return
    _write_leaf(node, rows, base + node.offset, values)


def _write_leaf(leaf: Leaf, rows: Rows, offset: int, values: Any) -> None:
    if leaf.kind == "string":
        few = values[:1] if texts_alike(values) else values
        text = np.frombuffer(b"".join([str(value).encode() + b"\0" for value in few]), np.uint8)
        field_view(rows, offset, np.dtype(np.uint8), leaf.count)[:] = text.reshape(len(few), -1)
    elif leaf.kind == "time":
        seconds, nanoseconds = np.divmod(np.asarray(values, np.int64), 1_000_000_000)
        if len(seconds) and (seconds.max() >= 2**31 or seconds.min() < -(2**31)):
            raise DataError("a time does not fit the 32-bit seconds of a ROS 2 stamp")
        field_view(rows, offset, np.dtype("<i4"))[:] = seconds
        field_view(rows, offset + 4, np.dtype("<u4"))[:] = nanoseconds
    elif leaf.count != 0:
        field_view(rows, offset, leaf.dtype, leaf.count)[:] = values
