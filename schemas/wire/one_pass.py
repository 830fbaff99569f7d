"""One pass over a log: every batch of messages of the channels asked for, and what was lost on the way."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from schemas.wire.blocks import Contents, Heads, Space, find, load
from schemas.wire.builder import Messages
from schemas.wire.cdr import ROOM
from schemas.wire.container import Block, File, Outline, Summary, file_crc
from schemas.wire.plan import passing_over
from schemas.wire.records import (
    FRAME,
    FRAME_SIZE,
    MESSAGE_BODY,
    MESSAGE_HEAD,
    RecordError,
    join_heads,
    message_heads,
    parse_record,
)

if TYPE_CHECKING:
    from schemas.wire.shortcut import Shortcut

BATCH = 1 << 23  # bytes of messages taken at a time
_PAYLOAD = FRAME_SIZE + MESSAGE_BODY
NOTHING = np.zeros(0, MESSAGE_HEAD)
LATEST = 2**63 - 1  # ns; MCAP's own times have one bit more
Progress = Callable[[int, int], None]
Sink = Callable[[mcap.Channel, mcap.Schema | None, Messages], None]


@dataclass
class Pass:
    """One pass over the blocks of a file; hands every batch of messages of a wanted channel to a sink."""

    file: File
    found: Outline
    sink: Sink
    expect: Callable[[dict[int, int]], None]
    topics: Collection[str] | None
    shortcut: Shortcut | None = None
    schemas: dict[int, mcap.Schema] = field(default_factory=dict)
    channels: dict[int, mcap.Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    span: tuple[int | None, int | None] = (None, None)
    _spoilt: dict[int, int] = field(default_factory=dict)
    _undeclared: dict[int, int] = field(default_factory=dict)
    _absurd: dict[int, int] = field(default_factory=dict)
    _space: Space = field(default_factory=Space)
    _waiting: list[Contents] = field(default_factory=list)
    _filled: int = 0
    _learnt: bool = False

    def run(self, progress: Progress | None) -> None:
        """Go through the whole file."""
        self.expect(announced(self.found, {}))
        for entry in self.found.entries:
            if isinstance(entry, Block):
                self._take_block(entry)
                if progress is not None:
                    progress(entry.stop, self.found.size)
            else:
                self._declare(entry)
        self._flush()
        self._conclude()
        if progress is not None:
            progress(self.found.size, self.found.size)

    def _take_block(self, block: Block) -> None:
        if self._unwanted(block):
            return
        try:
            size = load(self.file, block, self._space, self._filled, ROOM)
            contents = self._by_shortcut(block, size)
            if contents is None:
                contents = find(self.file, block, self._space[0], self._filled, size)
        except RecordError as error:
            self._note(block, str(error), f"its {sum(block.counts.values()) or ''} messages are lost")
            return
        if contents.problem:
            self._note(block, contents.problem, f"{len(contents.starts)} messages of it were read")
        for record in contents.others:
            self._declare(record)
        if len(contents.starts):
            self._keep(contents)

    def _keep(self, contents: Contents) -> None:
        """Have messages wait until there are enough of them, or, on the short way, some to learn from."""
        self._waiting.append(contents)
        self._filled += contents.size
        if self.shortcut is not None:
            self.shortcut.close(np.unique(contents.heads["channel"]).tolist())
        if self._filled >= BATCH or not self._learnt:
            self._flush()
            self._learnt = True

    def _by_shortcut(self, block: Block, size: int) -> Contents | None:
        """What is left of a block after the short way; None where it has to go the long way as a whole."""
        if self.shortcut is None or block.partial:
            return None
        buffer = self._space[0]
        left = self.shortcut.take(buffer, self._filled, size)
        if left is None or not all(self._is_known(buffer, start) for start in left.others.tolist()):
            return None
        span = self.shortcut.keep(self.counts)
        if span is not None:
            self._extend_span(*span)
        heads = message_heads(buffer, left.rest) if len(left.rest) else NOTHING
        return Contents(size, left.rest, heads, [])

    def _is_known(self, buffer: NDArray[np.uint8], start: int) -> bool:
        """Whether the record at start, not a message, says nothing new."""
        opcode, length = FRAME.unpack_from(buffer.data, start)
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return True
        known: dict[int, Any] = self.schemas if opcode == Opcode.SCHEMA else self.channels
        try:
            record = parse_record(opcode, buffer[start + FRAME_SIZE : start + FRAME_SIZE + length].tobytes())
        except RecordError:
            return False
        return bool(known.get(record.id) == record)

    def _learn(self, channel_id: int, batch: Messages) -> None:
        """Let messages like the last one of a batch go the short way, if they can."""
        assert self.shortcut is not None
        channel = self.channels.get(channel_id)
        last = int(batch.offset[-1])
        record = batch.buffer[last - _PAYLOAD : last + int(batch.length[-1])].copy()
        if channel is None or channel_id in self._spoilt:
            self.shortcut.open(channel_id, None, None)
        elif self.topics is not None and channel.topic not in self.topics:
            self.shortcut.open(channel_id, passing_over(), None)
        else:
            self.shortcut.open(channel_id, *self.shortcut.ask(channel, record))

    def __post_init__(self) -> None:
        self._learnt = self.shortcut is None

    def _note(self, block: Block, problem: str, loss: str) -> None:
        what = "chunk" if block.chunk else "run of messages"
        last = self._last_time()
        when = "" if last is None else f"; the last time read before it is {last * 1e-9:.3f} s"
        self.problems.append(f"{what} at byte {block.start}: {problem}; {' '.join(loss.split())}{when}")

    def _last_time(self) -> int | None:
        """The last log time so far, of the messages that wait too."""
        times = join_heads([NOTHING, *(one.heads for one in self._waiting)])["log"]
        waiting = int(times[times <= LATEST].max(initial=0))
        return max(waiting, self.span[1] or 0) if len(times) or self.span[1] is not None else None

    def _unwanted(self, block: Block) -> bool:
        """True when the index of a block names only channels that the summary says nobody asked for."""
        summary = self.found.summary
        if self.topics is None or summary is None or not block.counts:
            return False
        known = [summary.channels.get(channel) for channel in block.counts]
        return all(channel is not None and channel.topic not in self.topics for channel in known)

    def _declare(self, record: mcap.Schema | mcap.Channel) -> None:
        known: dict[int, Any] = self.schemas if isinstance(record, mcap.Schema) else self.channels
        before = known.get(record.id)
        if before is None:
            known[record.id] = record
        elif before != record and record.id not in self._spoilt:
            kind = "schema" if isinstance(record, mcap.Schema) else "channel"
            self._flush()
            if kind == "channel":
                self._spoilt[record.id] = 0
                if self.shortcut is not None:
                    self.shortcut.open(record.id, None, None)
            names = [one.name if isinstance(one, mcap.Schema) else one.topic for one in (before, record)]
            what = "the first one is used" if kind == "schema" else "its messages from there on are left out"
            self.problems.append(f"{kind} id {record.id} is defined twice, as {names[0]} and as {names[1]}; {what}")

    def _flush(self) -> None:
        """Hand the gathered messages on, channel by channel."""
        waiting, self._waiting, self._filled = self._waiting, [], 0
        if not any(len(contents.starts) for contents in waiting):
            return
        buffer, starts = self._space[0], np.concatenate([contents.starts for contents in waiting])
        heads, starts = self._without_absurd_times(join_heads([one.heads for one in waiting]), starts)
        if len(starts) == 0:
            return
        channel = heads["channel"].astype(np.intp)
        times = heads["log"].astype(np.int64)
        self._extend_span(int(times.min()), int(times.max()))
        batch = Messages(
            buffer,
            starts + _PAYLOAD,
            heads["size"].astype(np.int64) - MESSAGE_BODY,
            times,
            heads["publish"].astype(np.int64),
            heads["sequence"].astype(np.uint32),
        )
        self.deliver(batch, channel)

    def _without_absurd_times(self, heads: Heads, starts: NDArray[np.int64]) -> tuple[Heads, NDArray[np.int64]]:
        """Messages whose times do not fit 63 bits of nanoseconds (the year 2262) left out, and counted."""
        latest = np.maximum(heads["log"], heads["publish"])
        if latest.max() <= LATEST:
            return heads, starts
        fine = latest <= LATEST
        for one, count in zip(*np.unique(heads["channel"][~fine], return_counts=True), strict=True):
            self._absurd[int(one)] = self._absurd.get(int(one), 0) + int(count)
        return heads[fine], starts[fine]

    def deliver(self, batch: Messages, channel: NDArray[np.intp]) -> None:
        """Hand a batch on, channel by channel (channel: id of each message)."""
        for one in np.flatnonzero(np.bincount(channel)):
            mine = _select(batch, np.flatnonzero(channel == one))
            self._hand_on(int(one), mine)
            if self.shortcut is not None:
                self._learn(int(one), mine)

    def usable(self, channel_id: int) -> bool:
        """True for a channel that is defined, once."""
        return channel_id in self.channels and channel_id not in self._spoilt

    def _hand_on(self, channel_id: int, batch: Messages) -> None:
        channel = self.channels.get(channel_id) or self._from_summary(channel_id)
        if channel is None:
            self._undeclared[channel_id] = self._undeclared.get(channel_id, 0) + len(batch)
        elif channel_id in self._spoilt:
            self._spoilt[channel_id] += len(batch)
        else:
            self.counts[channel_id] = self.counts.get(channel_id, 0) + len(batch)
            if self.topics is None or channel.topic in self.topics:
                self.sink(channel, self.schemas.get(channel.schema_id), batch)

    def _from_summary(self, channel_id: int) -> mcap.Channel | None:
        """A channel that only the summary declares."""
        summary = self.found.summary
        channel = summary.channels.get(channel_id) if summary is not None else None
        if channel is not None and summary is not None:
            self.channels[channel_id] = channel
            if channel.schema_id in summary.schemas:
                self.schemas.setdefault(channel.schema_id, summary.schemas[channel.schema_id])
        return channel

    def _extend_span(self, first: int, last: int) -> None:
        start, end = self.span
        self.span = (first if start is None else min(start, first), last if end is None else max(end, last))

    def _conclude(self) -> None:
        """Problems that show only at the end."""
        for channel, count in sorted(self._undeclared.items()):
            self.problems.append(f"{count} messages belong to channel id {channel}, which is not defined; left out")
        for channel, count in sorted(self._absurd.items()):
            known = self.channels.get(channel)
            name = known.topic if known is not None else f"channel id {channel}"
            self.problems.append(f"{name}: {count} messages with times after the year 2262 were left out")
        for channel, count in sorted(self._spoilt.items()):
            self.problems.append(f"{count} messages of channel id {channel} were left out after its second definition")
        summary = self.found.summary
        if summary is not None:
            for channel_id in summary.channels:
                if channel_id not in self.channels:
                    self._from_summary(channel_id)
        self._check_count(summary)
        self._check_crc()
        if not self.found.complete and self.span[1] is not None:
            self.problems.append(f"the last time that could be read is {self.span[1] * 1e-9:.3f} s")

    def _check_count(self, summary: Summary | None) -> None:
        if summary is None or summary.statistics is None or self.topics is not None:
            return
        announced = summary.statistics.message_count
        got = sum(self.counts.values()) + sum(self._undeclared.values()) + sum(self._spoilt.values())
        got += sum(self._absurd.values())
        if got != announced:
            self.problems.append(f"the summary counts {announced} messages, the log holds {got} readable ones")

    def _check_crc(self) -> None:
        """The CRC of the data section, where any messages have no CRC of their own."""
        crc = self.found.data_crc
        if crc and not all(block.protected for block in self.found.blocks):
            try:
                if file_crc(self.file, self.found.data_end) != crc:
                    self.problems.append("the CRC of the data section does not match: bytes of the file have changed")
            except RecordError as error:
                self.problems.append(str(error))


def _select(batch: Messages, rows: NDArray[np.intp]) -> Messages:
    return Messages(
        batch.buffer,
        batch.offset[rows],
        batch.length[rows],
        batch.log_time[rows],
        batch.publish_time[rows],
        batch.sequence[rows],
    )


def announced(found: Outline, fallback: dict[int, int]) -> dict[int, int]:
    """Messages by channel as the message indexes count them, which the size of the file bounds."""
    counts = dict(fallback)
    indexed: dict[int, int] = {}
    for block in found.blocks:
        for channel, count in block.counts.items():
            indexed[channel] = indexed.get(channel, 0) + count
    counts.update(indexed)
    return counts
