"""The short way for long logs: messages that look like the last of their channel go straight from the chunk into the
columns, in compiled code. Whatever looks different, and all there is to say about it, is left to the long way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from mcap import records as mcap
from numpy.typing import NDArray

from schemas.wire import kernel
from schemas.wire.builder import TableBuilder
from schemas.wire.plan import Move, Plan
from schemas.wire.records import FRAME_SIZE, MESSAGE_BODY

Ints = NDArray[np.int64]
Ask = Callable[[mcap.Channel, NDArray[np.uint8]], tuple[Plan | None, TableBuilder | None]]
_IDS = 1 << 16
_MOST_OTHERS = 256  # records of a chunk that are not messages
_AHEAD = 1 << 13  # rows that are made ready at a time
_NONE = -1


@dataclass
class Lane:
    """One channel that goes the short way; builder: None for one that is only counted."""

    channel: int
    plan: Plan
    builder: TableBuilder | None
    ready: int = 0

    def prepare(self, count: int) -> bool:
        """Make room for count more rows; whether the columns have moved."""
        if self.builder is None or self.builder.count + count <= self.ready:
            return False
        moved = self.builder.reserve(self.builder.count + count)
        self.ready = min(self.builder.count + count + _AHEAD, self.builder.capacity)
        for one in self.plan.moves:
            one.column.ready(self.ready)
        return moved


@dataclass(frozen=True)
class Taken:
    """What the short way did with a chunk: messages taken by channel, their first and last time, what it left."""

    counts: dict[int, int]
    span: tuple[int, int]
    rest: Ints


@dataclass(frozen=True)
class Found:
    """Where the n messages of a chunk begin, which lane each is for, how many each lane has; where others begin."""

    place: Ints
    lane: NDArray[np.int32]
    counts: Ints
    others: Ints


@dataclass
class Shortcut:
    """The lanes of a log and the tables that the compiled code reads.

    ask: the plan for messages of a channel like a record, the last one it added, and the builder they go to.
    """

    ask: Ask
    lanes: list[Lane] = field(default_factory=list)
    _lane_of: NDArray[np.int32] = field(default_factory=lambda: np.full(_IDS, _NONE, np.int32))
    _stale: bool = True

    def open(self, channel: int, plan: Plan | None, builder: TableBuilder | None) -> None:
        """Let a channel go the short way from now on; without a plan, neither it nor what shares its builder."""
        self.lanes = [one for one in self.lanes if one.channel != channel and not (builder and one.builder is builder)]
        if plan is not None:
            self.lanes.append(Lane(channel, plan, builder))
        self._lane_of[:] = _NONE
        self._lane_of[[lane.channel for lane in self.lanes]] = np.arange(len(self.lanes), dtype=np.int32)
        self._stale = True

    def close(self, channels: Iterable[int]) -> None:
        """Let channels go the long way until they are opened again."""
        self._lane_of[list(channels)] = _NONE

    def scan(self, buffer: NDArray[np.uint8], start: int, size: int) -> Found | None:
        """Find the records in buffer[start:start + size]; None when they are not as they should be."""
        if self._stale:
            self._tabulate()
        room = size // (FRAME_SIZE + MESSAGE_BODY) + 1
        place, lane, others = np.empty(room, np.int64), np.empty(room, np.int32), np.empty(_MOST_OTHERS, np.int64)
        self._misfit[:] = False
        counts = np.zeros(len(self.lanes), np.int64)
        n, m = kernel.scan(
            buffer, buffer.ctypes.data, start, start + size, self._lane_of, self._size, self._fixed_from,
            self._fixed, self._misfit, counts, place, lane, others,
        )  # fmt: skip
        return None if n < 0 else Found(place[:n], lane[:n], counts, others[:m])

    def take(self, buffer: NDArray[np.uint8], found: Found) -> Taken:
        """Move the messages found into the columns of their lanes, except of lanes that one of them does not fit."""
        counts = np.where(self._misfit, 0, found.counts)
        moved = [lane.prepare(int(count)) for lane, count in zip(self.lanes, counts, strict=True) if count]
        if any(moved):
            self._locate()
        rows = np.array([lane.builder.count if lane.builder else 0 for lane in self.lanes], np.int64)
        rest, span = np.empty(len(found.place), np.int64), np.array([2**63 - 1, -1])
        left = kernel.move(
            buffer.ctypes.data, found.place, found.lane, self._misfit, rows, span, self._moves_from,
            self._kind, self._source, self._width, self._address, rest,
        )  # fmt: skip
        for lane, count in zip(self.lanes, counts.tolist(), strict=True):
            if lane.builder is not None:
                lane.builder.count += count
        by_channel = {lane.channel: count for lane, count in zip(self.lanes, counts.tolist(), strict=True) if count}
        return Taken(by_channel, (int(span[0]), int(span[1])), rest[:left])

    def _tabulate(self) -> None:
        plans, moves = [lane.plan for lane in self.lanes], self._moves()
        self._size = np.array([plan.size for plan in plans], np.int64)
        self._fixed_from = _starts([len(plan.fixed) for plan in plans])
        fixed = [(one.start, plan.record.ctypes.data + one.start, len(one)) for plan in plans for one in plan.fixed]
        self._fixed = np.array(fixed, np.int64).reshape(-1, 3)
        self._misfit = np.zeros(len(plans), np.bool_)
        self._moves_from = _starts([len(plan.moves) for plan in plans])
        self._kind = np.array([move.kind for move in moves], np.int64)
        self._source = np.array([move.source for move in moves], np.int64)
        self._width = np.array([move.width for move in moves], np.int64)
        self._locate()
        self._stale = False

    def _locate(self) -> None:
        self._address = np.array([move.column.address for move in self._moves()], np.int64)

    def _moves(self) -> list[Move]:
        return [move for lane in self.lanes for move in lane.plan.moves]


def _starts(lengths: list[int]) -> Ints:
    return np.cumsum([0, *lengths], dtype=np.int64)
