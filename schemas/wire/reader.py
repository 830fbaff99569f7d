"""Reading logs: any MCAP file into tables, whatever its compression, order, index or damage."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.blocks import Contents, Heads, Space, load
from schemas.wire.builder import CdrDecoder, MessageDecoder, Messages, TableBuilder
from schemas.wire.cdr import ROOM, Decoder
from schemas.wire.container import Block, File, Outline, Summary, check_attachments, file_crc, outline, read_summary
from schemas.wire.definitions import full_name, parse
from schemas.wire.records import FRAME_SIZE, MESSAGE_BODY, RecordError, join_heads, parse_record
from schemas.wire.table import Attachment, ChannelInfo, Log, Table

BATCH = 1 << 23  # bytes of messages taken at a time
_PAYLOAD = FRAME_SIZE + MESSAGE_BODY
LATEST = 2**63 - 1  # ns; MCAP's own times have one bit more
Progress = Callable[[int, int], None]
Sink = Callable[[mcap.Channel, mcap.Schema | None, Messages], None]


def read_log(
    path: Path | str,
    topics: Collection[str] | None = None,
    progress: Progress | None = None,
    *,
    columns: Mapping[str, Collection[str]] | None = None,
    attachments: bool = False,
) -> Log:
    """Everything a log holds, or the topics asked for, as tables in the order of the log.

    progress is called with bytes done and bytes in all. columns: by topic, the paths of the columns to keep, or of
    messages that hold them ("header"); topics not in it are kept whole, and so are messages that are not CDR. What is
    checked is the same: every byte of a message counts, kept or not. attachments: check their CRCs too, which takes
    reading them. Damage is told in ``problems`` of what comes back; messages that cannot be decoded are left out and
    counted there. Raises DataError when the file is not readable as MCAP.
    """
    tables = _Tables(topics, columns or {})
    with File(Path(path)) as file:
        found = outline(file)
        pass_ = Pass(file, found, tables.add, tables.expect, topics)
        pass_.run(progress)
        broken = check_attachments(file, found) if attachments else []
    done = tables.tables(pass_)
    problems = (*found.problems, *pass_.problems, *tables.problems, *broken)
    counts = {channel: pass_.counts.get(channel, 0) for channel in pass_.channels}
    channels = _channel_infos(pass_.channels, pass_.schemas, counts if topics is None else _announced(found, counts))
    start, end = pass_.span
    return Log(Path(path), channels, done, problems, found.metadata, tuple(found.attachments), start, end)


def scan_log(path: Path | str) -> Log:
    """The channels of a log without its tables: from the summary where there is a sound one, else by walking."""
    with File(Path(path)) as file:
        summary = read_summary(file)
        if summary is not None and summary.statistics is not None and summary.channels:
            return _log_of_summary(file, summary, summary.statistics)
        found = outline(file)
        pass_ = Pass(file, found, lambda *_: None, lambda *_: None, None)
        pass_.run(None)
    channels = _channel_infos(pass_.channels, pass_.schemas, pass_.counts)
    problems = (*found.problems, *pass_.problems)
    return Log(Path(path), channels, {}, problems, found.metadata, tuple(found.attachments), *pass_.span)


def read_messages(path: Path | str, topic: str) -> Messages:
    """The undecoded messages of one topic, all encodings, payloads end to end in one buffer.

    Raises DataError when the log has no such topic.
    """
    batches: list[Messages] = []
    with File(Path(path)) as file:
        pass_ = Pass(file, outline(file), lambda _c, _s, batch: batches.append(_copy(batch)), lambda *_: None, [topic])
        pass_.run(None)
    if topic not in {channel.topic for channel in pass_.channels.values()}:
        raise DataError("the log has no such topic", file=path, channel=topic)
    return join_messages(batches)


def join_messages(batches: list[Messages]) -> Messages:
    """Batches end to end."""
    sizes = [0, *np.cumsum([len(batch.buffer) for batch in batches]).tolist()]
    empty = np.zeros(0, np.int64)
    return Messages(
        np.concatenate([np.zeros(0, np.uint8), *(batch.buffer for batch in batches)]),
        np.concatenate([empty, *(batch.offset + size for batch, size in zip(batches, sizes, strict=False))]),
        np.concatenate([empty, *(batch.length for batch in batches)]),
        np.concatenate([empty, *(batch.log_time for batch in batches)]),
        np.concatenate([empty, *(batch.publish_time for batch in batches)]),
        np.concatenate([np.zeros(0, np.uint32), *(batch.sequence for batch in batches)]),
    )


def _copy(batch: Messages) -> Messages:
    """The batch in a buffer of its own, payloads end to end."""
    buffer = np.frombuffer(b"".join(batch.payload(row) for row in range(len(batch))), np.uint8)
    offset = np.cumsum(batch.length) - batch.length
    return Messages(buffer, offset, batch.length, batch.log_time, batch.publish_time, batch.sequence)


@dataclass
class Pass:
    """One pass over the blocks of a file; hands every batch of messages of a wanted channel to a sink."""

    file: File
    found: Outline
    sink: Sink
    expect: Callable[[dict[int, int]], None]
    topics: Collection[str] | None
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

    def run(self, progress: Progress | None) -> None:
        """Go through the whole file."""
        self.expect(_announced(self.found, {}))
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
            contents = load(self.file, block, self._space, self._filled, ROOM)
        except RecordError as error:
            self._note(block, str(error), f"its {sum(block.counts.values()) or ''} messages are lost")
            return
        if contents.problem:
            self._note(block, contents.problem, f"{len(contents.starts)} messages of it were read")
        for record in contents.others:
            self._declare(record)
        self._waiting.append(contents)
        self._filled += contents.size
        if self._filled >= BATCH:
            self._flush()

    def _note(self, block: Block, problem: str, loss: str) -> None:
        what = "chunk" if block.chunk else "run of messages"
        last = self.span[1]
        when = "" if last is None else f"; the last time read before it is {last * 1e-9:.3f} s"
        self.problems.append(f"{what} at byte {block.start}: {problem}; {' '.join(loss.split())}{when}")

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
            self._hand_on(int(one), _select(batch, np.flatnonzero(channel == one)))

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


class _Tables:
    """Sorts batches into the tables of their topics."""

    def __init__(self, topics: Collection[str] | None, columns: Mapping[str, Collection[str]]) -> None:
        self.topics, self.columns = topics, columns
        self.problems: list[str] = []
        self._builders: dict[str, TableBuilder | None] = {}
        self._announced: dict[int, int] = {}
        self._foreign: set[int] = set()

    def expect(self, counts: dict[int, int]) -> None:
        """Take note of how many messages each channel announces."""
        self._announced = counts

    def add(self, channel: mcap.Channel, schema: mcap.Schema | None, batch: Messages) -> None:
        """Append a batch to the table of its topic."""
        builder = self._builder(channel, schema)
        if builder is None:
            return
        if builder.schema == _schema_name(schema):
            builder.add(batch)
        elif channel.id not in self._foreign:
            self._foreign.add(channel.id)
            self.problems.append(
                f"{channel.topic}: carries {builder.schema} and also {_schema_name(schema)}; the latter is left out"
            )

    def tables(self, pass_: Pass) -> dict[str, Table]:
        """The finished tables, empty ones for channels without messages."""
        for channel in pass_.channels.values():
            if self.topics is None or channel.topic in self.topics:
                self._builder(channel, pass_.schemas.get(channel.schema_id))
        done: dict[str, Table] = {}
        for topic, builder in self._builders.items():
            if builder is not None:
                done[topic] = builder.table()
                self.problems += builder.problems()
        return done

    def _builder(self, channel: mcap.Channel, schema: mcap.Schema | None) -> TableBuilder | None:
        if channel.topic not in self._builders:
            expected = self._announced.get(channel.id, 0)
            try:
                decoder = make_decoder(channel, schema, self.columns.get(channel.topic))
                self._builders[channel.topic] = TableBuilder(channel.topic, _schema_name(schema), decoder, expected)
            except DataError as error:
                self._builders[channel.topic] = None
                self.problems.append(f"{channel.topic}: not decoded: {error.problem}")
        return self._builders[channel.topic]


def make_decoder(channel: mcap.Channel, schema: mcap.Schema | None, wanted: Collection[str] | None) -> MessageDecoder:
    """The decoder of a channel's encoding, for the columns wanted (None: all). Raises DataError when there is none."""
    encoding = (channel.message_encoding, schema.encoding if schema is not None else "")
    if schema is not None and encoding == ("cdr", "ros2msg"):
        return CdrDecoder(Decoder(parse(schema.name, schema.data.decode("utf-8", errors="replace")), wanted))
    if schema is not None and encoding == ("protobuf", "protobuf"):
        from schemas.wire.protobuf import ProtobufDecoder  # slow to import and rarely needed

        return ProtobufDecoder(schema.name, schema.data)
    if encoding[0] == "json" and encoding[1] in ("", "jsonschema"):
        from schemas.wire.json_messages import JsonDecoder

        return JsonDecoder()
    raise DataError(f"message encoding '{encoding[0]}' with schema encoding '{encoding[1]}' is not supported")


def _schema_name(schema: mcap.Schema | None) -> str:
    if schema is None:
        return ""
    return full_name(schema.name) if schema.encoding == "ros2msg" else schema.name


def _announced(found: Outline, fallback: dict[int, int]) -> dict[int, int]:
    """Messages by channel as the message indexes count them, which the size of the file bounds."""
    counts = dict(fallback)
    indexed: dict[int, int] = {}
    for block in found.blocks:
        for channel, count in block.counts.items():
            indexed[channel] = indexed.get(channel, 0) + count
    counts.update(indexed)
    return counts


def _channel_infos(
    channels: dict[int, mcap.Channel], schemas: dict[int, mcap.Schema], counts: dict[int, int]
) -> tuple[ChannelInfo, ...]:
    infos = []
    for channel in channels.values():
        schema = schemas.get(channel.schema_id)
        encoding = schema.encoding if schema is not None else ""
        count = counts.get(channel.id, 0)
        infos.append(ChannelInfo(channel.topic, _schema_name(schema), encoding, channel.message_encoding, count))
    return tuple(infos)


def _log_of_summary(file: File, summary: Summary, statistics: mcap.Statistics) -> Log:
    metadata: dict[str, dict[str, str]] = {}
    problems: list[str] = []
    for index in summary.metadata:
        try:
            opcode, length = file.frame(index.offset)
            body = file.read(index.offset + FRAME_SIZE, index.offset + FRAME_SIZE + length)
            if opcode == Opcode.METADATA:
                metadata[index.name] = dict(parse_record(opcode, body).metadata)
        except RecordError as error:
            problems.append(f"metadata at byte {index.offset}: {error}")
    attachments = tuple(Attachment(a.name, a.media_type, a.data_size, a.log_time) for a in summary.attachments)
    channels = _channel_infos(summary.channels, summary.schemas, dict(statistics.channel_message_counts))
    some = statistics.message_count > 0
    start, end = (statistics.message_start_time, statistics.message_end_time) if some else (None, None)
    if some and statistics.message_end_time > LATEST:
        problems.append("the summary tells of messages with times after the year 2262")
    return Log(file.path, channels, {}, tuple(problems), metadata, attachments, start, end)
