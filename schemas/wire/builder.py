"""Tables in the making: columns that grow while batches of messages come in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.cdr import Bad, Columns, Decoder, Indices, Part
from schemas.wire.fields import Blocks, Paths, split
from schemas.wire.layout import items, rows_alike
from schemas.wire.memory import Room, Supply
from schemas.wire.table import Table


@dataclass(frozen=True)
class Messages:
    """A batch of messages of one channel: payloads at offset (n,), length (n,) in buffer, and their times, ns."""

    buffer: NDArray[np.uint8]
    offset: Indices
    length: Indices
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    sequence: NDArray[np.uint32]

    def __len__(self) -> int:
        return len(self.offset)

    def payload(self, row: int) -> bytes:
        """The bytes of one message."""
        return self.buffer[self.offset[row] : self.offset[row] + self.length[row]].tobytes()


class MessageDecoder(Protocol):
    """Turns a batch of payloads into parts of columns."""

    def fields(self) -> tuple[str, ...]:
        """Paths of all columns the messages have, where some may not be wanted; else nothing."""

    def finish(self, columns: Columns) -> Columns:
        """The columns of the finished table from those that decoding yielded."""

    def decode(self, messages: Messages) -> list[Part | Bad]:
        """Parts that together cover every row once."""


class CdrDecoder:
    """A :class:`~schemas.wire.cdr.Decoder` for batches."""

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder

    def fields(self) -> tuple[str, ...]:
        """Paths of all columns the messages have."""
        return self._decoder.fields()

    def finish(self, columns: Columns) -> Columns:
        """The columns as they are; those of the definition where there was no message."""
        return columns or self._decoder.empty()

    def decode(self, messages: Messages) -> list[Part | Bad]:
        """Parts that together cover every row once."""
        return list(self._decoder.decode(messages.buffer, messages.offset, messages.length))


class GrowingColumn:
    """A column that grows by rows, in any order. As long as all rows are alike, one of them is all that is kept."""

    def __init__(self, first: NDArray[Any], supply: Supply) -> None:
        self.shape, self.dtype = first.shape[1:], first.dtype.newbyteorder("=")
        self._supply = supply
        self._same: NDArray[Any] | None = np.array(first[:1], self.dtype)
        self._room = self._larger(0)

    def write(self, where: Any, values: NDArray[Any], filled: int, capacity: int) -> None:
        """Put values at the rows where; the first filled rows may have been written, those of this batch included."""
        if self._same is not None:
            if _alike(values, self._same):
                return
            self._room = self._larger(capacity)
            self._room.ready(filled)
            self._room.values[:filled] = self._same  # rows of this batch that came before included
            self._same = None
        self._room.ready(filled)
        if len(self.shape) == 1 and _is_plain(values, self.dtype):
            items(self._room.values)[where] = items(values)
        else:
            self._room.values[where] = values

    def reserve(self, filled: int, capacity: int) -> None:
        """Make room for capacity rows."""
        if self._same is None and capacity > len(self._room.values):
            larger = self._larger(capacity)
            larger.ready(filled)
            larger.values[:filled] = self._room.values[:filled]
            self._room = larger

    def finished(self, count: int) -> NDArray[Any]:
        """(count, ...) values; a read-only broadcast where all rows are alike."""
        if self._same is not None:
            return np.broadcast_to(self._same, (count, *self.shape))
        return self._room.values[:count]

    def _larger(self, capacity: int) -> Room:
        return Room(self._supply, (capacity, *self.shape), self.dtype)


def _alike(values: NDArray[Any], same: NDArray[Any]) -> bool:
    """Every row has the bits (the value, of objects) of the one in same."""
    if len(values) == 0:
        return True
    if values.dtype == object:
        if values.strides[0] == 0:
            values = values[:1]
        return values.ndim == 1 and isinstance(same[0], str) and bool((values == same).all())
    if not _is_one(values[-1], same[0]) or not _is_one(values[0], same[0]):
        return False
    if values.ndim == 2 and _is_plain(values, same.dtype):
        return rows_alike(values)
    if values.dtype.kind == "f":
        bits = np.dtype(f"u{values.dtype.itemsize}").newbyteorder(values.dtype.byteorder)
        values = values.view(bits)
    return bool((values == values[0]).all())


def _is_one(row: NDArray[Any], same: NDArray[Any]) -> bool:
    """Whether a row has the bits of another."""
    return np.asarray(row, same.dtype).tobytes() == same.tobytes()


def _is_plain(values: NDArray[Any], dtype: np.dtype[Any]) -> bool:
    """Whether values (n, k) are rows of adjacent elements of the dtype, which may be moved as bytes."""
    adjacent = values.shape[1] > 0 and values.strides[1] == dtype.itemsize
    return adjacent and values.dtype == dtype and not dtype.hasobject


@dataclass
class TableBuilder:
    """Grows one table. expected: messages announced, by which memory is set aside. supply: where it comes from."""

    topic: str
    schema: str
    decoder: MessageDecoder
    expected: int = 0
    supply: Supply = field(default_factory=Supply)
    count: int = 0
    capacity: int = 0
    columns: dict[Paths, GrowingColumn] = field(default_factory=dict)
    lost: dict[str, list[int]] = field(default_factory=dict)

    def add(self, messages: Messages) -> None:
        """Decode a batch and append its rows."""
        parts = self.decoder.decode(messages)
        good = self._note_bad(parts, messages)
        kept = len(messages) if good is None else int(good.sum())
        self._reserve(self.count + kept)
        place = None if good is None else np.cumsum(good) - 1
        for part in parts:
            if isinstance(part, Part):
                self._write(part.rows if place is None else place[_rows(part.rows, len(messages))], kept, part.blocks)
        chosen: Any = slice(None) if good is None else good
        times = {name: getattr(messages, name)[chosen] for name in ("log_time", "publish_time", "sequence")}
        self._write(None, kept, {(f"/{name}",): values for name, values in times.items()})
        self.count += kept

    def table(self) -> Table:
        """The finished table."""
        columns = split({paths: column.finished(self.count) for paths, column in self.columns.items()})
        log_time = columns.pop("/log_time", np.zeros(0, np.int64))
        publish_time = columns.pop("/publish_time", np.zeros(0, np.int64))
        sequence = columns.pop("/sequence", np.zeros(0, np.uint32))
        done, fields = self.decoder.finish(columns), self.decoder.fields()
        return Table(self.topic, self.schema, done, log_time, publish_time, sequence, fields or tuple(done))

    def problems(self) -> list[str]:
        """What could not be decoded, a sentence for each reason."""
        return [
            f"{self.topic}: {len(times)} messages could not be decoded ({reason}), the first at {times[0] * 1e-9:.3f} s"
            for reason, times in self.lost.items()
        ]

    def _note_bad(self, parts: list[Part | Bad], messages: Messages) -> NDArray[np.bool_] | None:
        bad = [part for part in parts if isinstance(part, Bad)]
        if not bad:
            return None
        good = np.ones(len(messages), np.bool_)
        for part in bad:
            good[part.rows] = False
            self.lost.setdefault(part.reason, []).extend(messages.log_time[part.rows].tolist())
        return good

    def _write(self, rows: Indices | None, count: int, blocks: Blocks) -> None:
        where: Any = slice(self.count, self.count + count) if rows is None else rows + self.count
        for paths, values in blocks.items():
            if paths not in self.columns:
                self.columns[paths] = GrowingColumn(values, self.supply)
            target = self.columns[paths]
            if target.shape != values.shape[1:]:
                raise DataError(f"{paths[0]} changes its shape within the log", channel=self.topic)
            target.write(where, values, self.count + count, self.capacity)

    def _reserve(self, count: int) -> None:
        if count <= self.capacity:
            return
        self.capacity = max(count, self.expected, 2 * self.capacity)
        for column in self.columns.values():
            column.reserve(self.count, self.capacity)


def _rows(rows: Indices | None, count: int) -> Indices:
    return np.arange(count) if rows is None else rows
