"""The outline of an MCAP file: where its chunks, bare messages and other records are, found without decompressing.

The file is walked from the front, so a missing or damaged summary costs nothing; the summary serves to start fast and
to step over damage.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap import records as mcap
from mcap.opcode import Opcode

from schemas.errors import DataError
from schemas.wire.checksum import crc32
from schemas.wire.records import (
    CHUNK_HEAD,
    FRAME,
    FRAME_SIZE,
    MAGIC,
    MESSAGE_BODY,
    RecordError,
    frames,
    parse_record,
)
from schemas.wire.table import Attachment

FOOTER_SIZE = FRAME_SIZE + 20
MAX_RECORD = 1 << 28  # bytes of any record but chunks and attachments
RUN_BYTES = 1 << 22  # bare messages are taken in blocks of about this size
_INDEX_ENTRY = 16


@dataclass(frozen=True)
class Block:
    """Bytes start..stop of the file that hold messages: one chunk's body, or (chunk False) a run of bare messages.

    index: (start, stop) in the file of the message index records that follow a chunk; counts: their entries by
    channel. partial: the file ends inside the chunk.
    """

    start: int
    stop: int
    chunk: bool
    counts: dict[int, int] = field(default_factory=dict)
    index: tuple[int, int] = (0, 0)
    partial: bool = False
    protected: bool = False


@dataclass
class Summary:
    """What the summary section of a file says."""

    start: int
    schemas: dict[int, mcap.Schema] = field(default_factory=dict)
    channels: dict[int, mcap.Channel] = field(default_factory=dict)
    chunks: list[mcap.ChunkIndex] = field(default_factory=list)
    attachments: list[mcap.AttachmentIndex] = field(default_factory=list)
    metadata: list[mcap.MetadataIndex] = field(default_factory=list)
    statistics: mcap.Statistics | None = None


@dataclass
class Outline:
    """Entries in file order: blocks of messages, and schemas and channels that stand outside chunks.

    data_end: byte at which the data section ends (DataEnd record or the last whole record). data_crc: as written.
    """

    path: Path
    size: int
    header: mcap.Header | None = None
    entries: list[Block | mcap.Schema | mcap.Channel] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    attachment_places: list[tuple[int, int]] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    summary: Summary | None = None
    data_end: int = len(MAGIC)
    data_crc: int = 0
    complete: bool = False

    @property
    def blocks(self) -> list[Block]:
        """The blocks alone."""
        return [entry for entry in self.entries if isinstance(entry, Block)]

    def attachment_records(self, file: File) -> Iterator[mcap.Attachment]:
        """The attachments with their contents, one at a time."""
        for start, stop in self.attachment_places:
            yield parse_record(Opcode.ATTACHMENT, file.read(start, stop))


class File:
    """Random reads of a file that never return less than was asked for. Raises DataError when it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.handle = path.open("rb", buffering=0)
            self.size = os.fstat(self.handle.fileno()).st_size
        except OSError as error:
            raise DataError(f"cannot be opened: {error.strerror or error}", file=path) from error
        try:
            self._check_magic()
        except BaseException:
            self.handle.close()
            raise

    def __enter__(self) -> File:
        return self

    def __exit__(self, *_: object) -> None:
        self.handle.close()

    def read(self, start: int, stop: int) -> bytes:
        """Bytes start..stop. Raises RecordError when the file does not have them (any more)."""
        parts: list[bytes] = []
        position = start
        try:
            while position < stop and (part := os.pread(self.handle.fileno(), stop - position, position)):
                parts.append(part)
                position += len(part)
        except OSError as error:
            raise DataError(f"cannot be read: {error.strerror or error}", file=self.path) from error
        if position < stop:
            raise RecordError("the file is shorter than it was")
        return parts[0] if len(parts) == 1 else b"".join(parts)

    def frame(self, position: int) -> tuple[int, int]:
        """(opcode, body length) of the record at a byte. Raises RecordError when the file ends before the body does."""
        if position + FRAME_SIZE > self.size:
            raise RecordError("the file ends")
        opcode, length = FRAME.unpack(self.read(position, position + FRAME_SIZE))
        if opcode == 0:
            raise RecordError("there is no record")
        if length > self.size - position - FRAME_SIZE:
            raise RecordError("the file ends inside a record")
        return opcode, length

    def _check_magic(self) -> None:
        if self.size == 0:
            raise DataError("the file is empty", file=self.path)
        if self.size < len(MAGIC) or self.read(0, len(MAGIC)) != MAGIC:
            raise DataError("this is not an MCAP file", file=self.path)


def read_summary(file: File) -> Summary | None:
    """The summary section, or None when the file has none or it is damaged."""
    try:
        return _read_summary(file)
    except RecordError:
        return None


def _read_summary(file: File) -> Summary | None:
    tail = file.size - len(MAGIC)
    place = tail - FOOTER_SIZE
    if place < len(MAGIC) or file.read(tail, file.size) != MAGIC:
        return None
    opcode, length = file.frame(place)
    if opcode != Opcode.FOOTER or length != FOOTER_SIZE - FRAME_SIZE:
        return None
    footer = parse_record(opcode, file.read(place + FRAME_SIZE, tail))
    if not len(MAGIC) <= footer.summary_start < place:
        return None
    data = file.read(footer.summary_start, tail)
    if footer.summary_crc and crc32(data[:-4]) != footer.summary_crc:
        return None
    summary = Summary(footer.summary_start)
    for kind, start, size in frames(data[:-FOOTER_SIZE]):
        _add_to_summary(summary, parse_record(kind, data[start : start + size]))
    return summary


def _add_to_summary(summary: Summary, record: Any) -> None:
    match record:
        case mcap.Schema():
            summary.schemas[record.id] = record
        case mcap.Channel():
            summary.channels[record.id] = record
        case mcap.ChunkIndex():
            summary.chunks.append(record)
        case mcap.AttachmentIndex():
            summary.attachments.append(record)
        case mcap.MetadataIndex():
            summary.metadata.append(record)
        case mcap.Statistics():
            summary.statistics = record


def outline(file: File) -> Outline:
    """Walk the data section from the front to its end, or to where the file breaks off."""
    found = Outline(file.path, file.size, summary=read_summary(file))
    position = len(MAGIC)
    while not found.complete:
        try:
            opcode, length = file.frame(position)
            position = _take_record(file, found, opcode, position, length)
        except RecordError as error:
            resumed = _step_over(found, position)
            if resumed is None:
                _note_end(file, found, position, str(error))
                break
            found.problems.append(f"{error} at byte {position}; reading goes on at byte {resumed}")
            position = resumed
        found.data_end = position
    return found


def _take_record(file: File, found: Outline, opcode: int, position: int, length: int) -> int:
    """File one record away; the byte at which the next begins. Raises RecordError."""
    start, stop = position + FRAME_SIZE, position + FRAME_SIZE + length
    if opcode == Opcode.CHUNK:
        return _take_chunk(file, found, start, stop)
    if opcode == Opcode.MESSAGE:
        return _take_run(file, found, position)
    if opcode == Opcode.ATTACHMENT:
        found.attachments.append(_attachment(file, start, stop))
        found.attachment_places.append((start, stop))
        return stop
    if opcode == Opcode.FOOTER:
        found.complete = True
        found.problems.append("the data section has no end record")
        return position
    if opcode in (Opcode.MESSAGE_INDEX, *range(0x10, 0x100)):
        return stop
    if length > MAX_RECORD:
        raise RecordError(f"a record of type 0x{opcode:02x} claims {length} bytes")
    _take_small(found, parse_record(opcode, file.read(start, stop)))
    return position if found.complete else stop


def _take_small(found: Outline, record: Any) -> None:
    match record:
        case mcap.Header():
            found.header = record
        case mcap.Schema() | mcap.Channel():
            found.entries.append(record)
        case mcap.Metadata():
            found.metadata[record.name] = dict(record.metadata)
        case mcap.DataEnd():
            found.complete, found.data_crc = True, record.data_section_crc


def _take_chunk(file: File, found: Outline, start: int, stop: int) -> int:
    """A chunk and the message index records behind it."""
    counts: dict[int, int] = {}
    position = stop
    while position + FRAME_SIZE + 6 <= file.size:
        opcode, length, channel, size = struct.unpack("<BQHI", file.read(position, position + FRAME_SIZE + 6))
        if opcode != Opcode.MESSAGE_INDEX or length != size + 6 or length > file.size - position - FRAME_SIZE:
            break
        counts[channel] = counts.get(channel, 0) + size // _INDEX_ENTRY
        position += FRAME_SIZE + length
    crc = stop - start >= CHUNK_HEAD.size and CHUNK_HEAD.unpack(file.read(start, start + CHUNK_HEAD.size))[3]
    found.entries.append(Block(start, stop, True, counts, (stop, position), protected=bool(crc)))
    return position


def _take_run(file: File, found: Outline, position: int) -> int:
    """A run of bare message records, whole records only, of some MiB."""
    opcode, length = file.frame(position)
    stop = min(file.size, max(position + RUN_BYTES, position + FRAME_SIZE + length))
    data = file.read(position, stop)
    counts: dict[int, int] = {}
    place, end, unpack = 0, len(data), struct.Struct("<BQH").unpack_from
    while place + FRAME_SIZE + MESSAGE_BODY <= end:
        opcode, length, channel = unpack(data, place)
        if opcode != Opcode.MESSAGE or length < MESSAGE_BODY or place + FRAME_SIZE + length > end:
            break
        counts[channel] = counts.get(channel, 0) + 1
        place += FRAME_SIZE + length
    if place == 0:
        found.problems.append(f"the message record at byte {position} is too short to be one; it is left out")
        return position + FRAME_SIZE + length
    found.entries.append(Block(position, position + place, False, counts))
    return position + place


def _attachment(file: File, start: int, stop: int) -> Attachment:
    """Name, type and size of an attachment, without reading its contents."""
    head = file.read(start, min(stop, start + 65536))
    try:
        log_time, _, length = struct.unpack_from("<QQI", head)
        name, place = head[20 : 20 + length], 20 + length
        (length,) = struct.unpack_from("<I", head, place)
        media, place = head[place + 4 : place + 4 + length], place + 4 + length
        (size,) = struct.unpack_from("<Q", head, place)
    except struct.error as error:
        raise RecordError("a damaged attachment") from error
    return Attachment(name.decode(errors="replace"), media.decode(errors="replace"), size, log_time)


def _step_over(found: Outline, position: int) -> int | None:
    """Start of the next chunk that the summary knows of, or of the summary, after damage at a byte."""
    if found.summary is None:
        return None
    later = [index.chunk_start_offset for index in found.summary.chunks if index.chunk_start_offset > position]
    inside = [start for start in later if start < found.summary.start]
    return min(inside, default=None)


def _note_end(file: File, found: Outline, position: int, reason: str) -> None:
    """Say where the file breaks off, and keep what there is of a chunk that was being written."""
    lost = file.size - position
    if found.summary is not None:
        lost = found.summary.start - position
        found.problems.append(f"{reason} at byte {position}; {lost} bytes up to the summary are lost")
        return
    found.problems.append(
        f"the file is truncated or damaged: {reason} at byte {position} of {file.size}; {lost} bytes cannot be read"
        if lost
        else f"the file is truncated: it ends at byte {position} without an end record"
    )
    start = position + FRAME_SIZE
    if lost > FRAME_SIZE + CHUNK_HEAD.size and file.read(position, position + 1)[0] == Opcode.CHUNK:
        found.entries.append(Block(start, file.size, True, partial=True))


def check_attachments(file: File, found: Outline) -> list[str]:
    """A sentence for each attachment whose CRC, where it has one, does not match its contents."""
    problems: list[str] = []
    for attachment, (start, stop) in zip(found.attachments, found.attachment_places, strict=True):
        try:
            (crc,) = struct.unpack("<I", file.read(stop - 4, stop))
            if crc and file_crc(file, stop - 4, start) != crc:
                problems.append(f"attachment '{attachment.name}' at byte {start}: its CRC does not match its contents")
        except RecordError as error:
            problems.append(f"attachment '{attachment.name}' at byte {start}: {error}")
    return problems


def file_crc(file: File, stop: int, start: int = 0) -> int:
    """CRC-32 of the bytes start..stop."""
    crc = 0
    for part in file_parts(file, stop, start):
        crc = crc32(part, crc)
    return crc


def file_parts(file: File, stop: int, start: int = 0) -> Iterator[bytes]:
    """The bytes start..stop, some MiB at a time."""
    for first in range(start, stop, RUN_BYTES):
        yield file.read(first, min(stop, first + RUN_BYTES))
