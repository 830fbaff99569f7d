"""What the next message of a channel looks like if it is like the last: which bytes must be the same, and where the
others go.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from schemas.wire.columns import GrowingColumn
from schemas.wire.fields import Block, Paths
from schemas.wire.layout import Layout, Leaf
from schemas.wire.records import FRAME_SIZE, MESSAGE_BODY, MESSAGE_HEAD

RAW, STAMP, TRUTH = 0, 1, 2  # bytes as they are; seconds and nanoseconds to int64 ns; bytes to booleans
PAYLOAD = FRAME_SIZE + MESSAGE_BODY
_BODY = PAYLOAD + 4
_KIND = range(PAYLOAD, PAYLOAD + 2)
_HEAD = {"/log_time": ("log", 8), "/publish_time": ("publish", 8), "/sequence": ("sequence", 4)}


@dataclass(frozen=True)
class Move:
    """width bytes of a record, from byte source on, that go into one row of a column."""

    kind: int
    source: int
    width: int
    column: GrowingColumn


@dataclass(frozen=True)
class Plan:
    """size: bytes of a record (0: any). fixed: where a message must have the bytes of record."""

    size: int
    record: NDArray[np.uint8]
    fixed: tuple[range, ...]
    moves: tuple[Move, ...]

    @cached_property
    def likeness(self) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
        """The record in words of 8 bytes, and a mask with ones where a message must have its bits."""
        words = -(-len(self.record) // 8)
        both = np.zeros((2, 8 * words), np.uint8)
        both[0, : len(self.record)] = self.record
        for one in self.fixed:
            both[1, one.start : one.stop] = 0xFF
        record, mask = both.view(np.uint64)
        return record, mask


def passing_over() -> Plan:
    """The plan for messages nobody asked for, which are only counted."""
    return Plan(0, np.zeros(0, np.uint8), (), ())


def plan_like(
    record: NDArray[np.uint8], layout: Layout, blocks: Sequence[Block], columns: Mapping[Paths, GrowingColumn]
) -> Plan | None:
    """The plan for messages like record, of that layout, whose blocks go into columns; None where there is none.

    Columns whose rows are all alike so far must stay so. Strings and sequences of varying length, and arrays of
    messages, have no plan unless they are alike.
    """
    same = [range(0, MESSAGE_HEAD.fields["channel"][1] + 2), _KIND]  # type: ignore[index]
    same += [range(_BODY + offset, _BODY + offset + 4) for offset, _ in layout.words]
    moves: list[Move] = []
    for source, width, kind, column in _fields(blocks, columns):
        if kind is None:
            return None
        if column.alike:
            same.append(range(source, source + width))
        else:
            moves.append(Move(kind, source, width, column))
    return Plan(len(record), record, _merged(same), tuple(moves))


def _fields(
    blocks: Sequence[Block], columns: Mapping[Paths, GrowingColumn]
) -> Iterator[tuple[int, int, int | None, GrowingColumn]]:
    """(byte in the record, bytes, kind of move or None, column) of the head's fields and of each block."""
    for path, (name, width) in _HEAD.items():
        yield MESSAGE_HEAD.fields[name][1], width, RAW, columns[path,]  # type: ignore[index]
    for block in blocks:
        node, column = block.node, columns[block.paths]
        if not isinstance(node, Leaf) or node.ragged:
            yield 0, 0, None, column  # its rows are objects
        elif node.kind == "string":
            yield _BODY + node.offset, node.count or 0, RAW if column.alike else None, column
        elif node.kind == "time":
            yield _BODY + node.offset, 8, STAMP, column
        else:
            width = node.dtype.itemsize * (1 if node.count is None else node.count)
            yield _BODY + node.offset, width, TRUTH if node.dtype == np.bool_ else RAW, column


def _merged(ranges: Sequence[range]) -> tuple[range, ...]:
    """Those that touch or overlap made one, in order."""
    merged: list[range] = []
    for one in sorted((one for one in ranges if one), key=lambda one: one.start):
        if merged and one.start <= merged[-1].stop:
            merged[-1] = range(merged[-1].start, max(merged[-1].stop, one.stop))
        else:
            merged.append(one)
    return tuple(merged)
