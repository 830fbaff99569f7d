"""Blocks of messages into memory: decompressed, checked, and every message found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from schemas.wire.container import Block, File
from schemas.wire.records import (
    FRAME,
    FRAME_SIZE,
    MAX_CHUNK,
    MESSAGE_BODY,
    RecordError,
    check_crc,
    chunk_head,
    decompress_available,
    decompress_into,
    frames,
    message_heads,
    parse_record,
)

Bytes = NDArray[np.uint8]
Starts = NDArray[np.int64]
Offsets = NDArray[np.uint64]
Heads = NDArray[Any]


@dataclass(frozen=True)
class Contents:
    """What a block held: size bytes in the buffer, starts (n,) and heads (n,) of its messages, its other records."""

    size: int
    starts: Starts
    heads: Heads
    others: list[mcap.Schema | mcap.Channel]
    problem: str = ""


class Space(list[Bytes]):
    """One reusable buffer that grows when asked; holds a single array."""

    def at(self, start: int, size: int) -> Bytes:
        """The buffer's bytes start..start + size, with what was before start kept."""
        if not self or len(self[0]) < start + size:
            larger = np.empty(max(start + size, 2 * (len(self[0]) if self else 0)), np.uint8)
            if self:
                larger[:start] = self[0][:start]
            self[:] = [larger]
        return self[0][start : start + size]


def load(file: File, block: Block, space: Space, start: int, room: int) -> int:
    """Put a block's records into the buffer at start, with room bytes to spare; how many bytes they are.

    Raises RecordError when nothing of it can be used.
    """
    view = memoryview(file.read(block.start, block.stop))
    if not block.chunk:
        return _put(view, space, start, room)
    head = chunk_head(view, partial=block.partial)
    if head.size > MAX_CHUNK:
        raise RecordError(f"it claims {head.size} uncompressed bytes, more than the {MAX_CHUNK} allowed")
    data = view[head.data_start :]
    if block.partial:
        return _put(decompress_available(data, head.compression, head.size), space, start, room)
    out = space.at(start, head.size + room)[: head.size]
    decompress_into(data, head.compression, out.data)
    check_crc(out.data, head.crc)
    return head.size


def _put(data: bytes | memoryview, space: Space, start: int, room: int) -> int:
    space.at(start, len(data) + room)[: len(data)] = np.frombuffer(data, np.uint8)
    return len(data)


def find(file: File, block: Block, buffer: Bytes, start: int, size: int) -> Contents:
    """The messages of a block whose records are in buffer[start:start + size]. Raises RecordError."""
    if block.partial:
        return replace(_walk(buffer, start, size), problem="the end of it is missing")
    if block.chunk and block.index[1]:
        index = _index_offsets(file.read(*block.index))
        if (found := _from_index(buffer, start, size, index)) is not None:
            return found
    return _walk(buffer, start, size)


def _index_offsets(index: bytes) -> Offsets:
    """Offsets of all messages named by message index records, sorted."""
    parts = [np.frombuffer(index, "<u8", (length - 6) // 16 * 2, start + 6)[1::2] for _, start, length in frames(index)]
    offsets = np.concatenate(parts) if parts else np.zeros(0, np.uint64)
    offsets.sort(kind="stable")  # a few sorted runs, one a channel: merged
    return offsets


def _from_index(buffer: Bytes, start: int, size: int, offsets: Offsets) -> Contents | None:
    """Contents by the message index; None when it does not account for every byte of the chunk."""
    end = start + size
    if len(offsets) == 0 or int(offsets[-1]) > size - FRAME_SIZE - MESSAGE_BODY:
        return None
    starts = offsets.astype(np.int64) + start
    heads = message_heads(buffer, starts)
    length = heads["size"]
    # unsigned: what is shorter than a message's fixed part becomes huge
    if (heads["opcode"] != Opcode.MESSAGE).any() or (length - np.uint64(MESSAGE_BODY)).max() > size:
        return None
    before = np.concatenate([[start], length.astype(np.int64) + (starts + FRAME_SIZE)])
    after = np.concatenate([starts, [end]])
    gaps = after - before
    if gaps.min() < 0:
        return None
    others: list[Any] = []
    for gap in np.flatnonzero(gaps):
        if not _take_gap(buffer[before[gap] : after[gap]], others):
            return None
    return Contents(size, starts, heads, others)


def _take_gap(data: Bytes, others: list[Any]) -> bool:
    """Schemas and channels between messages; False when there is anything else."""
    try:
        for opcode, start, length in frames(data.data):
            if opcode == Opcode.MESSAGE:
                return False
            _take_other(opcode, data[start : start + length].tobytes(), others)
    except RecordError:
        return False
    return True


def _take_other(opcode: int, body: bytes, others: list[Any]) -> None:
    if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        others.append(parse_record(opcode, body))


def _walk(buffer: Bytes, start: int, size: int) -> Contents:
    """Contents found record by record; stops with a problem at a record that does not fit."""
    view = buffer.data
    starts: list[int] = []
    others: list[Any] = []
    problem = ""
    position, end, unpack, note = start, start + size, FRAME.unpack_from, starts.append
    while position < end:
        opcode, length = unpack(view, position) if position + FRAME_SIZE <= end else (0, 0)
        if opcode == 0 or length > end - position - FRAME_SIZE:
            problem = f"{end - position} of its {size} bytes at the end hold no whole record"
            break
        if opcode == Opcode.MESSAGE and length >= MESSAGE_BODY:
            note(position)
        elif opcode == Opcode.MESSAGE:
            problem = "a message record in it is too short to be one and is left out"
        else:
            problem = _try_other(view, opcode, position + FRAME_SIZE, length, others) or problem
        position += FRAME_SIZE + length
    found = np.array(starts, np.int64)
    return Contents(size, found, message_heads(buffer, found), others, problem)


def _try_other(view: memoryview, opcode: int, start: int, length: int, others: list[Any]) -> str:
    try:
        _take_other(opcode, bytes(view[start : start + length]), others)
    except RecordError as error:
        return str(error)
    return ""


Progress = Callable[[int, int], None]
