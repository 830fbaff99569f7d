"""Appending to a log: a copy of it with further chunks or, where its summary is no help, a rewrite of what it holds."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.atomic import replacing
from schemas.wire.builder import Messages
from schemas.wire.container import File, Outline, Summary, check_attachments, file_parts, outline
from schemas.wire.one_pass import Pass
from schemas.wire.records import FRAME_SIZE, MESSAGE_BODY
from schemas.wire.section import Index, SectionWriter
from schemas.wire.table import Table
from schemas.wire.writer import LIBRARY, write_metadata, write_tables

_HEAD = FRAME_SIZE + MESSAGE_BODY


def append_tables(
    source: Path | str,
    target: Path | str,
    tables: Sequence[Table],
    *,
    compression: str = "zstd",
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    without: str = "",
) -> tuple[str, ...]:
    """Copy a log and append tables to the copy; what of the source was lost or odd comes back, a sentence each.

    without: channels whose topics begin so stay behind, and with them the metadata that is written anew.
    The source is only read. Its bytes are copied as they are up to the end of the data section where its summary is
    sound and covers it; otherwise every message that can be read is written anew. The target appears whole or not at
    all. Raises DataError as :func:`~schemas.wire.writer.write_log` does, and when source and target are one file.
    """
    source, target = Path(source), Path(target)
    if target.exists() and source.exists() and target.samefile(source):
        raise DataError("the input log is never changed: choose another output", file=target)
    with File(source) as file:
        found = outline(file)
        with replacing(target) as handle:
            if _summary_covers(found) and not _stays_behind(found, without):
                writer, problems = _continue_copy(file, found, handle, compression), list(found.problems)
            else:
                writer, problems = _rewrite(file, found, handle, compression, without, set(metadata or ()))
            write_metadata(writer, metadata)
            handle.flush()
            with ThreadPoolExecutor(1) as pool:  # what is copied goes to the disk while the rest is made
                synced = pool.submit(os.fsync, handle.fileno())
                write_tables(writer, tables)
                synced.result()
            writer.finish()
    return tuple(problems)


def _summary_covers(found: Outline) -> bool:
    """The file is whole and its summary names every chunk; nothing stands outside chunks."""
    summary = found.summary
    if summary is None or summary.statistics is None or not found.complete or found.problems:
        return False
    chunks = sorted(index.chunk_start_offset for index in summary.chunks)
    there = [block.start - FRAME_SIZE for block in found.blocks]
    counted = summary.statistics.message_count == sum(summary.statistics.channel_message_counts.values())
    used = {channel for block in found.blocks for channel in block.counts} | set(
        summary.statistics.channel_message_counts
    )
    declared = used <= set(summary.channels) and all(
        channel.schema_id == 0 or channel.schema_id in summary.schemas for channel in summary.channels.values()
    )
    return all(block.chunk for block in found.blocks) and chunks == there and counted and declared


def _stays_behind(found: Outline, without: str) -> bool:
    """The summary names a channel that is not to be copied."""
    channels = found.summary.channels.values() if found.summary is not None else ()
    return bool(without) and any(channel.topic.startswith(without) for channel in channels)


def _continue_copy(file: File, found: Outline, handle: BinaryIO, compression: str) -> SectionWriter:
    """The source up to its DataEnd record, and a writer that goes on from there."""
    assert found.summary is not None
    _copy_bytes(file, handle, found.data_end)
    index = _index_of(found.summary)
    return SectionWriter(handle, compression, index, found.data_end, found.data_crc or None)


def _index_of(summary: Summary) -> Index:
    statistics = summary.statistics
    assert statistics is not None
    span = (statistics.message_start_time, statistics.message_end_time) if statistics.message_count else None
    return Index(
        dict(summary.schemas),
        dict(summary.channels),
        list(summary.chunks),
        list(summary.attachments),
        list(summary.metadata),
        dict(statistics.channel_message_counts),
        span,
    )


def _copy_bytes(file: File, handle: BinaryIO, size: int) -> None:
    """The first bytes of a file, inside the kernel where it can."""
    handle.flush()
    done = 0
    try:
        while done < size and (count := os.copy_file_range(file.handle.fileno(), handle.fileno(), size - done, done)):
            done += count
    except (AttributeError, OSError):
        handle.seek(0)
        handle.truncate()
        for part in file_parts(file, size):
            handle.write(part)
        return
    if done != size:
        raise DataError("the file is shorter than it was", file=file.path)
    handle.seek(size)


def _rewrite(
    file: File, found: Outline, handle: BinaryIO, compression: str, without: str, anew: set[str]
) -> tuple[SectionWriter, list[str]]:
    """Every readable record of the source in fresh chunks, but for channels that stay behind."""
    writer = SectionWriter(handle, compression)
    header = found.header
    writer.begin(header.profile if header is not None else "", LIBRARY)
    for name, values in found.metadata.items():
        if not without or name not in anew:
            writer.metadata(name, values)
    for record in found.attachment_records(file):
        writer.attachment(record)
    copying = _Rewrite(file, found, lambda *_: None, lambda _: None, None)
    copying.writer, copying.without = writer, without
    copying.run(None)
    kept = sorted(channel.id for channel in copying.channels.values() if not copying.stays_behind(channel.id))
    for channel_id in kept:
        copying.declare(channel_id)
    writer.idle(kept)
    return writer, [*found.problems, *copying.problems, *check_attachments(file, found)]


class _Rewrite(Pass):
    """A pass that writes each batch of messages as one chunk, in the same order."""

    writer: SectionWriter
    without: str

    def stays_behind(self, channel_id: int) -> bool:
        """Whether a channel of the source is not to be copied."""
        return bool(self.without) and self.channels[channel_id].topic.startswith(self.without)

    def declare(self, channel_id: int) -> None:
        """Make a channel of the source known to the writer; without schema when the source lost that."""
        channel = self.channels[channel_id]
        schema = self.schemas.get(channel.schema_id)
        self.writer.declare(channel if schema is not None else replace(channel, schema_id=0), schema)

    def deliver(self, batch: Messages, channel: NDArray[np.intp]) -> None:
        super().deliver(batch, channel)
        there = [int(one) for one in np.flatnonzero(np.bincount(channel)) if self.usable(int(one))]
        used = [one for one in there if not self.stays_behind(one)]
        for one in used:
            self.declare(one)
        keep = np.isin(channel, used)
        if not keep.any():
            return
        start, size = batch.offset[keep] - _HEAD, batch.length[keep] + _HEAD
        preamble = np.frombuffer(self.writer.preamble(used), np.uint8)
        place = np.cumsum(size) - size
        source = np.repeat(start - place, size) + np.arange(int(size.sum()))
        data = np.concatenate([preamble, batch.buffer[source]])
        self.writer.chunk(data, channel[keep].astype(np.int64), batch.log_time[keep], place + len(preamble))
