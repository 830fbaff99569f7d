"""Reading logs: any MCAP file into tables, whatever its compression, order, index or damage."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode

from schemas.errors import DataError
from schemas.wire.builder import Messages
from schemas.wire.container import File, Summary, check_attachments, outline, read_summary
from schemas.wire.one_pass import LATEST, Pass, Progress, announced
from schemas.wire.records import FRAME_SIZE, RecordError, parse_record
from schemas.wire.table import Attachment, ChannelInfo, Log
from schemas.wire.tables import Tables, schema_name

if TYPE_CHECKING:
    from schemas.wire.shortcut import Shortcut

LONG = 1 << 26  # bytes of a file from which on the short way is worth its start


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
    tables = Tables(topics, columns or {})
    with File(Path(path)) as file:
        found = outline(file)
        pass_ = Pass(file, found, tables.add, tables.expect, topics, _shortcut(tables, file.size))
        pass_.run(progress)
        broken = check_attachments(file, found) if attachments else []
    done = tables.tables(pass_)
    problems = (*found.problems, *pass_.problems, *tables.problems, *broken)
    counts = {channel: pass_.counts.get(channel, 0) for channel in pass_.channels}
    channels = _channel_infos(pass_.channels, pass_.schemas, counts if topics is None else announced(found, counts))
    start, end = pass_.span
    return Log(Path(path), channels, done, problems, found.metadata, tuple(found.attachments), start, end)


def _shortcut(tables: Tables, size: int) -> Shortcut | None:
    """The short way for files so large that it makes up for loading its compiled code."""
    if size < LONG:
        return None
    from schemas.wire.shortcut import Shortcut  # slow to import

    return Shortcut(tables.plan)


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


def _channel_infos(
    channels: dict[int, mcap.Channel], schemas: dict[int, mcap.Schema], counts: dict[int, int]
) -> tuple[ChannelInfo, ...]:
    infos = []
    for channel in channels.values():
        schema = schemas.get(channel.schema_id)
        encoding = schema.encoding if schema is not None else ""
        count = counts.get(channel.id, 0)
        infos.append(ChannelInfo(channel.topic, schema_name(schema), encoding, channel.message_encoding, count))
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
