"""CDR messages <-> columns, in batches: rows that share a layout are gathered and split with one numpy call a field."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.definitions import PRIMITIVES, TIMES, MessageType
from schemas.wire.fields import Block, Blocks, blocks_of, read_block, split
from schemas.wire.layout import (
    Items,
    Layout,
    Leaf,
    MisfitError,
    Node,
    Rows,
    empty_layout,
    field_view,
    layout_of_bytes,
    layout_of_counts,
    texts_alike,
    write_node,
)

Indices = NDArray[np.int64]
Columns = dict[str, NDArray[Any]]
_Group = tuple[Indices, list[int]]

HEADER = 4  # bytes of the encapsulation header
_LEAD = 4  # bytes before the encapsulation header that a gathered row takes along, so that its body is 8-aligned
BODY = _LEAD + HEADER
ROOM = 8  # bytes that must be readable after the last message
_SLACK = 7  # bytes by which senders may pad a message
_BIG_ENDIAN, _LITTLE_ENDIAN = 0, 1
_KIND = np.dtype(">u2")


@dataclass(frozen=True)
class Part:
    """Decoded rows: which of the messages asked for (None: all, in order) and their columns, in blocks."""

    rows: Indices | None
    blocks: Blocks

    @property
    def columns(self) -> Columns:
        """The columns one by one."""
        return split(self.blocks)


@dataclass(frozen=True)
class Bad:
    """Messages that could not be decoded, and why."""

    rows: Indices
    reason: str


class Decoder:
    """Decodes messages of one type; remembers the last layout of each message length.

    wanted: the columns to hand out, by path or by the path of a message that holds them; None: all. The messages are
    checked as a whole all the same.
    """

    def __init__(self, mtype: MessageType, wanted: Collection[str] | None = None) -> None:
        self.mtype = mtype
        self.wanted = wanted
        self._known: dict[tuple[int, str], tuple[Layout, list[Block]]] = {}

    def fields(self) -> tuple[str, ...]:
        """Paths of all columns that the messages have."""
        return tuple(empty_layout(self.mtype).leaves)

    def empty(self) -> Columns:
        """The columns of no messages at all."""
        rows = np.empty((0, BODY), np.uint8)
        blocks = blocks_of(empty_layout(self.mtype), self.wanted)
        return split({block.paths: read_block(block, rows, BODY) for block in blocks})

    def layout(self, message: Rows) -> tuple[Layout, list[Block]] | None:
        """Layout and blocks of a little-endian message (n,) by the last one of its length; None where it differs."""
        known = self._known.get((len(message), "<"))
        if known is None or message[:2].tobytes() != bytes((0, _LITTLE_ENDIAN)):
            return None
        rows = np.concatenate([np.zeros(_LEAD, np.uint8), message])[None]
        fits = len(message) - HEADER - known[0].size <= _SLACK and bool(_matches(known[0], rows)[0])
        return known if fits else None

    def decode(self, buffer: Rows, offset: Indices, length: Indices) -> Iterator[Part | Bad]:
        """Parts of the messages at offset in buffer (n,), each with the rows it covers.

        buffer must go on for 4 bytes before and 8 bytes after every message.
        """
        if len(offset) and (length == length[0]).all():
            yield from self._equal_length(buffer, offset, int(length[0]), None)
            return
        for one in np.unique(length):
            rows = np.flatnonzero(length == one)
            yield from self._equal_length(buffer, offset[rows], int(one), rows)

    def _equal_length(self, buffer: Rows, offset: Indices, length: int, rows: Indices | None) -> Iterator[Part | Bad]:
        if length < HEADER:
            yield Bad(_all(rows, len(offset)), "shorter than the encapsulation header")
            return
        data = gather(buffer, offset - _LEAD, -(-(length + _LEAD) // 8) * 8)
        kind = field_view(data, _LEAD, _KIND)
        if (kind == _LITTLE_ENDIAN).all():
            yield from self._one_order(data, length, "<", rows)
            return
        for value in np.unique(kind):
            some = np.flatnonzero(kind == value)
            chosen = some if rows is None else rows[some]
            if value in (_BIG_ENDIAN, _LITTLE_ENDIAN):
                yield from self._one_order(data[some], length, "<" if value == _LITTLE_ENDIAN else ">", chosen)
            else:
                yield Bad(chosen, f"encapsulation 0x{value:04x} is not plain CDR")

    def _one_order(self, data: Rows, length: int, order: str, rows: Indices | None) -> Iterator[Part | Bad]:
        """Split rows of equal length into those with equal length words."""
        while len(data):
            try:
                layout, blocks = self._layout(data, length, order)
            except MisfitError as error:
                yield Bad(_all(rows, len(data))[:1], str(error))
                same = np.zeros(len(data), np.bool_)
                same[0] = True
            else:
                same = _matches(layout, data)
                everything = bool(same.all())
                mine = data if everything else data[same]
                which = rows if everything else _all(rows, len(data))[same]
                yield self._part(layout, blocks, mine, which, length)
            if same.all():
                return
            data, rows = data[~same], _all(rows, len(data))[~same]

    def _layout(self, data: Rows, length: int, order: str) -> tuple[Layout, list[Block]]:
        known = self._known.get((length, order))
        if known is not None and bool(_matches(known[0], data[:1])[0]):
            return known
        layout = layout_of_bytes(self.mtype, data[0, BODY : _LEAD + length].tobytes(), order)
        self._known[length, order] = layout, blocks_of(layout, self.wanted)
        return self._known[length, order]

    def _part(self, layout: Layout, blocks: list[Block], data: Rows, rows: Indices | None, length: int) -> Part | Bad:
        if length - HEADER - layout.size > _SLACK:
            return Bad(_all(rows, len(data)), f"{length - HEADER - layout.size} bytes longer than the definition says")
        return Part(rows, {block.paths: read_block(block, data, BODY) for block in blocks})


def gather(buffer: Rows, offset: Indices, size: int) -> Rows:
    """(n, size) copies of the bytes at each offset."""
    windows = np.ndarray((len(buffer) - size + 1,), np.dtype((np.void, size)), buffer, 0, (1,))
    return windows[offset].view(np.uint8).reshape(len(offset), size)


def scatter(buffer: Rows, offset: Indices, rows: Rows) -> None:
    """Write each row of rows at its offset in buffer; the inverse of :func:`gather`."""
    size = rows.shape[1]
    windows = np.ndarray((len(buffer) - size + 1,), np.dtype((np.void, size)), buffer, 0, (1,))
    windows[offset] = np.ascontiguousarray(rows).view(np.dtype((np.void, size)))[:, 0]


def _matches(layout: Layout, data: Rows) -> NDArray[np.bool_]:
    same = np.ones(len(data), np.bool_)
    word = np.dtype(f"{layout.order}u4")
    for offset, value in layout.words:
        same &= field_view(data, BODY + offset, word) == value
    return same


def _all(rows: Indices | None, count: int) -> Indices:
    return np.arange(count) if rows is None else rows


@dataclass(frozen=True)
class Encoded:
    """Rows of one length: which rows of the table, and their bytes, encapsulation header at byte lead."""

    rows: Indices
    data: Rows


def encode(mtype: MessageType, columns: Mapping[str, Any], count: int, lead: int) -> list[Encoded]:
    """Little-endian CDR of count rows, lead free bytes before each. A field without column is zero or empty.

    Raises DataError for a column that the type does not have or that does not fit.
    """
    blank = empty_layout(mtype)
    unknown = [path for path in columns if path not in blank.leaves]
    if unknown:
        raise DataError(f"{mtype.name} has no field {unknown[0]}")
    return [
        Encoded(rows, _encode_group(mtype, columns, rows, counts, lead))
        for rows, counts in _groups(blank, columns, mtype, count)
    ]


def _encode_group(mtype: MessageType, columns: Mapping[str, Any], rows: Indices, counts: list[int], lead: int) -> Rows:
    layout = layout_of_counts(mtype, counts)
    base = lead + HEADER
    data = np.zeros((len(rows), base + layout.size), np.uint8)
    data[:, lead + 1] = _LITTLE_ENDIAN
    for offset, value in layout.words:
        field_view(data, base + offset, np.dtype("<u4"))[:] = value
    everything = len(rows) == 0 or (len(rows) - 1 == rows[-1] and rows[0] == 0)
    for path, values in columns.items():
        try:
            write_node(layout.leaves[path], data, base, values[: len(rows)] if everything else values[rows])
        except (ValueError, TypeError, OverflowError) as error:
            raise DataError(f"{path} does not fit {mtype.name}: {error}") from error
    return data


def _groups(blank: Layout, columns: Mapping[str, Any], mtype: MessageType, count: int) -> Iterator[_Group]:
    """Rows with the same length words, and these words in the order of the wire."""
    varying = {path: node for path, node in blank.leaves.items() if _varies(node)}
    if count == 0 or not varying:
        yield np.arange(count), []
    elif any(isinstance(node, Items) for node in varying.values()):
        yield from _nested_groups(mtype, columns, count)
    else:
        yield from _flat_groups([_lengths(columns.get(path), node, count) for path, node in varying.items()], count)


def _varies(node: Node) -> bool:
    return isinstance(node, Items) or node.kind == "string" or node.ragged


def _lengths(values: Any, node: Node, count: int) -> Indices:
    """(n,) length words of a string or of a sequence of primitives."""
    text = isinstance(node, Leaf) and node.kind == "string"
    if values is None:
        return np.full(count, int(text))
    if not text:
        return np.fromiter((len(value) for value in values), np.int64, count)
    if texts_alike(values):
        return np.full(count, len(str(values[0]).encode()) + 1)
    return np.fromiter((len(str(value).encode()) + 1 for value in values), np.int64, count)


def _flat_groups(lengths: list[Indices], count: int) -> Iterator[_Group]:
    table = np.stack(lengths, axis=1)
    if (table == table[0]).all():
        yield np.arange(count), table[0].tolist()
        return
    unique, inverse = np.unique(table, axis=0, return_inverse=True)
    for k, counts in enumerate(unique):
        yield np.flatnonzero(inverse.ravel() == k), counts.tolist()


def _nested_groups(mtype: MessageType, columns: Mapping[str, Any], count: int) -> Iterator[_Group]:
    groups: dict[tuple[int, ...], list[int]] = {}
    for row in range(count):
        key = tuple(_counts(mtype, mtype.name, "", {path: values[row] for path, values in columns.items()}))
        groups.setdefault(key, []).append(row)
    for counts, rows in groups.items():
        yield np.array(rows), list(counts)


def _counts(mtype: MessageType, name: str, prefix: str, values: Mapping[str, Any]) -> Iterator[int]:
    """Length words of one message (values: its fields by path), in the order of the wire."""
    for field in mtype.fields[name]:
        path = prefix + field.name
        if field.size is None and not field.sequence:
            yield from _single_counts(mtype, field.base, path, values)
            continue
        inside = {key: value for key, value in values.items() if key == path or key.startswith(f"{path}.")}
        size = field.size if field.size is not None else len(next(iter(inside.values()), ()))
        if field.sequence:
            yield size
        if field.base not in PRIMITIVES:
            for k in range(size):
                yield from _single_counts(mtype, field.base, path, {key: value[k] for key, value in inside.items()})


def _single_counts(mtype: MessageType, base: str, path: str, values: Mapping[str, Any]) -> Iterator[int]:
    if base == "string":
        yield len(str(values.get(path, "")).encode()) + 1
    elif base not in PRIMITIVES and base not in TIMES:
        yield from _counts(mtype, base, f"{path}.", values)
