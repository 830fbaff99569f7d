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
from schemas.wire.plan import RAW, Move, Plan
from schemas.wire.records import FRAME_SIZE, MESSAGE_BODY

Ints = NDArray[np.int64]
Ask = Callable[[mcap.Channel, NDArray[np.uint8]], tuple[Plan | None, TableBuilder | None]]
_IDS = 1 << 16
_MOST_OTHERS = 256  # records of a chunk that are not messages
_AHEAD = 1 << 14  # rows that are made ready at a time
_NONE = -1
_WORD = 8
_NOWHERE = np.zeros(0, np.int64)


@dataclass
class Lane:
    """One channel that goes the short way; builder: None for one that is only counted."""

    channel: int
    plan: Plan
    builder: TableBuilder | None
    ready: int = 0

    def prepare(self, more: int, *, grow: bool = False) -> bool:
        """Make so many more rows ready, as far as there is room or that may grow; whether the columns have moved."""
        if self.builder is None:
            self.ready = kernel.LATEST
            return False
        moved = grow and self.ready == self.builder.capacity and self.builder.reserve(self.builder.count + more)
        rows = min(self.builder.count + more + _AHEAD, self.builder.capacity)
        self.ready = min([one.column.ready(rows) for one in self.plan.moves], default=self.builder.capacity)
        return moved


@dataclass(frozen=True)
class Left:
    """What the short way left of a chunk: where messages that did not fit, and records that are none, begin."""

    rest: Ints
    others: Ints


@dataclass
class Shortcut:
    """The lanes of a log and the tables that the compiled code reads.

    ask: the plan for messages of a channel like a record, the last one it added, and the builder they go to.
    """

    ask: Ask
    lanes: list[Lane] = field(default_factory=list)
    _lane_of: NDArray[np.int32] = field(default_factory=lambda: np.full(_IDS, _NONE, np.int32))
    _others: Ints = field(default_factory=lambda: np.empty(_MOST_OTHERS, np.int64))
    _lanes: Ints = field(init=False)
    _row: Ints = field(init=False)
    _now: Ints = field(init=False)
    _span: Ints = field(default_factory=lambda: np.empty(2, np.int64))
    _buffer: NDArray[np.uint8] | None = None
    _base: int = 0
    _stale: bool = True
    _near: bool = False

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

    def take(self, buffer: NDArray[np.uint8], start: int, size: int) -> Left | None:
        """Move the messages in buffer[start:start + size] into the columns of their lanes, but for lanes that one of
        them does not fit; None when the records are not as they should be.
        """
        if self._stale:
            self._tabulate()
        if buffer is not self._buffer:
            self._buffer, self._base = buffer, buffer.ctypes.data
        stop, full = start + size, 0
        while full >= 0:
            left, found, full, near = kernel.take(
                self._base, start, stop, self._lane_of, self._lanes, self._whole, self._other, self._row, self._now,
                self._misfit, self._span, self._others,
            )  # fmt: skip
            if full >= 0:
                self._make_room(full)
        self._near = near
        if left < 0:
            return None
        rest = _NOWHERE
        if left:
            self._now[self._misfit] = self._row[self._misfit]
            rest = np.empty(size // (FRAME_SIZE + MESSAGE_BODY), np.int64)
            rest = rest[: kernel.left_over(self._base, start, stop, self._lane_of, self._misfit, rest)]
        return Left(rest, self._others[:found])

    def keep(self, counts: dict[int, int]) -> tuple[int, int] | None:
        """Keep the rows just taken and count their messages by channel; their first and last time, if any."""
        some = False
        for lane, row, before in zip(self.lanes, self._now.tolist(), self._row.tolist(), strict=True):
            if row > before:
                some = True
                counts[lane.channel] = counts.get(lane.channel, 0) + row - before
                if lane.builder is not None:
                    lane.builder.count = row
        self._row, self._now = self._now, self._row
        if self._near:
            for lane, more in zip(self.lanes, (self._row - self._now).tolist(), strict=True):
                lane.prepare(2 * more)
            self._lanes[:-1, kernel.ROOM] = [lane.ready for lane in self.lanes]
        first, last = self._span.tolist()
        return (first, last) if some else None

    def _make_room(self, full: int) -> None:
        """More room for a lane that has none left."""
        moved = self.lanes[full].prepare(2 * int(self._now[full] - self._row[full]) + 1, grow=True)
        self._lanes[full, kernel.ROOM] = self.lanes[full].ready
        if moved:
            self._locate()

    def _tabulate(self) -> None:
        self._row = np.array([lane.builder.count if lane.builder else 0 for lane in self.lanes], np.int64)
        self._now, self._misfit = self._row.copy(), np.zeros(len(self.lanes), np.bool_)
        self._lanes = np.zeros((len(self.lanes) + 1, 7), np.int64)
        self._locate()
        self._stale = False

    def _locate(self) -> None:
        moves = [[(one, one.column.address) for one in lane.plan.moves] for lane in self.lanes]
        whole = [[word for one, at in own if _is_whole(one) for word in _words(one, at)] for own in moves]
        other = [[_field(one, at) for one, at in own if not _is_whole(one)] for own in moves]
        self._whole, self._other = _table(whole, 3), _table(other, 4)
        self._lanes[:, kernel.WHOLE], self._lanes[:, kernel.OTHER] = _starts(whole), _starts(other)
        for row, lane in zip(self._lanes, self.lanes, strict=False):
            likeness = lane.plan.likeness
            row[: kernel.WHOLE] = lane.plan.size, len(likeness[0]), *(words.ctypes.data for words in likeness)
            row[kernel.ROOM] = lane.ready


def _is_whole(move: Move) -> bool:
    return move.kind == RAW and move.width % _WORD == 0


def _words(move: Move, address: int) -> list[tuple[int, ...]]:
    return [(move.source + k, address + k, move.width) for k in range(0, move.width, _WORD)]


def _field(move: Move, address: int) -> tuple[int, ...]:
    return move.source, address, move.width, move.kind


def _table(rows: list[list[tuple[int, ...]]], width: int) -> Ints:
    return np.array([row for own in rows for row in own], np.int64).reshape(-1, width)


def _starts(rows: list[list[tuple[int, ...]]]) -> Ints:
    return np.cumsum([0, *map(len, rows)], dtype=np.int64)
