"""Tables in the making: columns that grow while batches of messages come in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.cdr import Bad, Columns, Decoder, Indices, Part
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

    def empty(self) -> Columns:
        """The columns of no messages at all."""

    def decode(self, messages: Messages) -> list[Part | Bad]:
        """Parts that together cover every row once."""


class CdrDecoder:
    """A :class:`~schemas.wire.cdr.Decoder` for batches."""

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder

    def empty(self) -> Columns:
        """The columns of no messages at all."""
        return self._decoder.empty()

    def decode(self, messages: Messages) -> list[Part | Bad]:
        """Parts that together cover every row once."""
        return list(self._decoder.decode(messages.buffer, messages.offset, messages.length))


@dataclass
class TableBuilder:
    """Grows one table. expected: messages announced, by which memory is set aside."""

    topic: str
    schema: str
    decoder: MessageDecoder
    expected: int = 0
    count: int = 0
    capacity: int = 0
    columns: Columns = field(default_factory=dict)
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
                self._write(part.rows if place is None else place[_rows(part.rows, len(messages))], kept, part.columns)
        chosen: Any = slice(None) if good is None else good
        times = {name: getattr(messages, name)[chosen] for name in ("log_time", "publish_time", "sequence")}
        self._write(None, kept, {f"/{name}": values for name, values in times.items()})
        self.count += kept

    def table(self) -> Table:
        """The finished table."""
        columns = {name: values[: self.count] for name, values in self.columns.items()}
        log_time = columns.pop("/log_time", np.zeros(0, np.int64))
        publish_time = columns.pop("/publish_time", np.zeros(0, np.int64))
        sequence = columns.pop("/sequence", np.zeros(0, np.uint32))
        return Table(self.topic, self.schema, columns or self.decoder.empty(), log_time, publish_time, sequence)

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

    def _write(self, rows: Indices | None, count: int, columns: Columns) -> None:
        where: Any = slice(self.count, self.count + count) if rows is None else rows + self.count
        for name, values in columns.items():
            target = self.columns.get(name)
            if target is None:
                dtype = values.dtype.newbyteorder("=")
                target = self.columns[name] = np.empty((self.capacity, *values.shape[1:]), dtype)
            if target.shape[1:] != values.shape[1:]:
                raise DataError(f"{name} changes its shape within the log", channel=self.topic)
            target[where] = values

    def _reserve(self, count: int) -> None:
        if count <= self.capacity:
            return
        self.capacity = max(count, self.expected, 2 * self.capacity)
        for name, values in self.columns.items():
            larger = np.empty((self.capacity, *values.shape[1:]), values.dtype)
            larger[: self.count] = values[: self.count]
            self.columns[name] = larger


def _rows(rows: Indices | None, count: int) -> Indices:
    return np.arange(count) if rows is None else rows
