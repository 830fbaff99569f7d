"""Tables in the making: columns that grow while batches of messages come in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.cdr import Bad, Columns, Decoder, Indices, Part
from schemas.wire.columns import GrowingColumn
from schemas.wire.fields import Blocks, Paths, split
from schemas.wire.memory import Supply
from schemas.wire.plan import PAYLOAD, Plan, plan_like
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

    def plan(self, record: NDArray[np.uint8], columns: Mapping[Paths, GrowingColumn]) -> Plan | None:
        """How to take messages like record, the last one decoded; None where these need a closer look each."""
        known = self._decoder.layout(record[PAYLOAD:])
        return None if known is None else plan_like(record, *known, columns)


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
        if kept == 0:
            return
        self.reserve(self.count + kept)
        place = None if good is None else np.cumsum(good) - 1
        for part in parts:
            if isinstance(part, Part):
                self._write(part.rows if place is None else place[_rows(part.rows, len(messages))], kept, part.blocks)
        chosen: Any = slice(None) if good is None else good
        times = {name: getattr(messages, name)[chosen] for name in ("log_time", "publish_time", "sequence")}
        self._write(None, kept, {(f"/{name}",): values for name, values in times.items()})
        self.count += kept

    def plan(self, record: NDArray[np.uint8]) -> Plan | None:
        """How to take messages like record, the last one added; None where these need a closer look each."""
        return self.decoder.plan(record, self.columns) if isinstance(self.decoder, CdrDecoder) else None

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

    def reserve(self, count: int) -> bool:
        """Make room for count rows in all; whether the columns have moved to get it."""
        if count <= self.capacity:
            return False
        self.capacity = max(count, self.expected, 2 * self.capacity)
        for column in self.columns.values():
            column.reserve(self.count, self.capacity)
        return True


def _rows(rows: Indices | None, count: int) -> Indices:
    return np.arange(count) if rows is None else rows
