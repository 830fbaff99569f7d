"""Writing logs: tables to a new MCAP file, or appended to a copy of an existing one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap import records as mcap
from numpy.typing import NDArray

from schemas import scratch
from schemas.errors import DataError
from schemas.wire.atomic import replacing
from schemas.wire.cdr import encode, scatter
from schemas.wire.definitions import MessageType, definition, message_type
from schemas.wire.layout import empty_layout, field_view
from schemas.wire.records import FRAME_SIZE, MESSAGE_BODY
from schemas.wire.section import SectionWriter, next_id
from schemas.wire.table import Table

LIBRARY = "deckflex"
CHUNK_BYTES = 1 << 21
CHUNKS_HELD = 32  # whose rows of tables in files stay in memory
_LEAD = FRAME_SIZE + MESSAGE_BODY
Metadata = Mapping[str, Mapping[str, str]]
_CHANNEL_METADATA = {"offered_qos_profiles": ""}


def write_log(
    path: Path | str,
    tables: Sequence[Table],
    *,
    compression: str = "zstd",
    chunk_bytes: int = CHUNK_BYTES,
    metadata: Metadata | None = None,
) -> None:
    """Write tables as a new log, messages of all tables merged by log time, each table in its own order.

    The file appears whole or not at all. The same tables give the same bytes. Raises DataError for a schema that
    ``schemas/msg`` does not have, a column that does not fit it, or a path that cannot be written.
    """
    with replacing(Path(path)) as handle:
        writer = SectionWriter(handle, compression)
        writer.begin("ros2", LIBRARY)
        write_metadata(writer, metadata)
        write_tables(writer, tables, chunk_bytes)
        writer.finish()


def write_metadata(writer: SectionWriter, metadata: Metadata | None) -> None:
    """Metadata records, in order of their names."""
    for name, values in sorted((metadata or {}).items()):
        writer.metadata(name, {str(key): str(value) for key, value in values.items()})


def write_tables(writer: SectionWriter, tables: Sequence[Table], chunk_bytes: int = CHUNK_BYTES) -> None:
    """Declare the channels of tables and write their messages in chunks."""
    streams = [_Stream(table, _declare(writer, table), _message_type(table)) for table in tables]
    writer.idle([stream.channel for stream in streams if len(stream.table) == 0])
    with ThreadPoolExecutor(1) as pool:  # one chunk is packed and written while the next is laid out
        written: Future[None] | None = None
        for k, chosen in enumerate(_chunks(streams, chunk_bytes)):
            made = _chunk(writer, streams, chosen)
            if written is not None:
                written.result()
            written = pool.submit(writer.chunk, *made)
            if k % CHUNKS_HELD == 0:
                scratch.release(*(column for table in tables for column in table.columns.values()))
        if written is not None:
            written.result()


@dataclass(frozen=True)
class _Stream:
    table: Table
    channel: int
    mtype: MessageType


def _message_type(table: Table) -> MessageType:
    try:
        return message_type(table.schema)
    except KeyError as error:
        raise DataError(str(error.args[0]), channel=table.topic) from error


def _declare(writer: SectionWriter, table: Table) -> int:
    """Id of the channel for a table: one the log already has, or a new one."""
    _message_type(table)
    data = definition(table.schema).encode()
    schemas, channels = writer.index.schemas, writer.index.channels
    same = (one for one in schemas.values() if (one.name, one.encoding, one.data) == (table.schema, "ros2msg", data))
    schema = next(same, None) or mcap.Schema(
        id=next_id(dict(schemas)), data=data, encoding="ros2msg", name=table.schema
    )
    for channel in channels.values():
        if (channel.topic, channel.schema_id, channel.message_encoding) == (table.topic, schema.id, "cdr"):
            return channel.id
    channel = mcap.Channel(
        id=next_id(dict(channels)),
        topic=table.topic,
        message_encoding="cdr",
        metadata=dict(_CHANNEL_METADATA),
        schema_id=schema.id,
    )
    writer.declare(channel, schema)
    return channel.id


def _chunks(streams: Sequence[_Stream], chunk_bytes: int) -> Iterator[list[NDArray[np.int64]]]:
    """For each chunk the rows of every stream and, in the same list behind them, the merged order of these rows."""
    counts = [len(stream.table) for stream in streams]
    keys = [np.maximum.accumulate(stream.table.log_time) for stream in streams if len(stream.table)]
    if not keys:
        return
    # Narrow types, and sums in place: these arrays are as long as all messages together.
    owner = np.repeat(np.arange(len(streams), dtype=np.int16), counts)
    row = np.concatenate([np.arange(count, dtype=np.uint32) for count in counts])
    order = np.argsort(np.concatenate(keys), kind="stable")
    del keys
    owner, row = owner[order], row[order]
    del order
    size = np.array([_LEAD + 4 + empty_layout(stream.mtype).size for stream in streams])[owner]
    np.cumsum(size, out=size)
    size //= chunk_bytes
    cuts = np.flatnonzero(size[1:] != size[:-1]) + 1
    del size
    for first, last in zip([0, *cuts.tolist()], [*cuts.tolist(), len(owner)], strict=True):
        mine = owner[first:last]
        yield [row[first:last][mine == k] for k in range(len(streams))] + [mine]


def _chunk(
    writer: SectionWriter, streams: Sequence[_Stream], chosen: list[NDArray[np.int64]]
) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The chosen rows encoded, the message records in their merged order: what the writer's chunk takes."""
    *rows, owner = chosen
    encoded = [_encode(stream, mine) for stream, mine in zip(streams, rows, strict=True)]
    used = sorted({stream.channel for stream, mine in zip(streams, rows, strict=True) if len(mine)})
    size = np.empty(len(owner), np.int64)
    places = [np.flatnonzero(owner == k) for k in range(len(streams))]
    for place, groups in zip(places, encoded, strict=True):
        for which, data in groups:
            size[place[which]] = data.shape[1]
    preamble = writer.preamble(used)
    start = np.cumsum(size) - size + len(preamble)
    buffer = np.empty(len(preamble) + int(size.sum()), np.uint8)
    buffer[: len(preamble)] = np.frombuffer(preamble, np.uint8)
    for place, groups in zip(places, encoded, strict=True):
        for which, data in groups:
            scatter(buffer, start[place[which]], data)
    channel = np.array([stream.channel for stream in streams])[owner]
    log_time = np.empty(len(owner), np.int64)
    for place, mine, stream in zip(places, rows, streams, strict=True):
        log_time[place] = stream.table.log_time[mine]
    return buffer, channel, log_time, start


def _encode(stream: _Stream, rows: NDArray[np.int64]) -> list[tuple[NDArray[np.int64], NDArray[np.uint8]]]:
    """Message records of some rows of a table: (which of them, bytes) by length."""
    if len(rows) == 0:
        return []
    table = stream.table
    span: Any = slice(rows[0], rows[-1] + 1) if rows[-1] - rows[0] + 1 == len(rows) else rows
    columns = {path: values[span] for path, values in table.columns.items()}
    try:
        groups = encode(stream.mtype, columns, len(rows), _LEAD)
    except DataError as error:
        raise error.located(channel=table.topic) from error
    done = []
    for group in groups:
        mine = rows[group.rows]
        _fill_head(group.data, stream.channel, table, mine)
        done.append((group.rows, group.data))
    return done


def _fill_head(data: NDArray[np.uint8], channel: int, table: Table, rows: NDArray[np.int64]) -> None:
    data[:, 0] = 0x05
    field_view(data, 1, np.dtype("<u8"))[:] = data.shape[1] - FRAME_SIZE
    field_view(data, 9, np.dtype("<u2"))[:] = channel
    field_view(data, 11, np.dtype("<u4"))[:] = table.sequence[rows]
    field_view(data, 15, np.dtype("<i8"))[:] = table.log_time[rows]
    field_view(data, 23, np.dtype("<i8"))[:] = table.publish_time[rows]
