"""Writing an MCAP data section and its summary, chunk by chunk."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.checksum import crc32
from schemas.wire.records import FRAME, FRAME_SIZE, MAGIC

_ZSTD_LEVEL = 1  # sensor noise does not compress better at higher levels
_SUMMARY_GROUPS = (
    (Opcode.SCHEMA, "schemas"),
    (Opcode.CHANNEL, "channels"),
    (Opcode.STATISTICS, "statistics"),
    (Opcode.CHUNK_INDEX, "chunks"),
    (Opcode.ATTACHMENT_INDEX, "attachments"),
    (Opcode.METADATA_INDEX, "metadata"),
)


@dataclass
class Index:
    """What the summary will say: of old chunks, where a log is continued, and of new ones."""

    schemas: dict[int, mcap.Schema] = field(default_factory=dict)
    channels: dict[int, mcap.Channel] = field(default_factory=dict)
    chunks: list[mcap.ChunkIndex] = field(default_factory=list)
    attachments: list[mcap.AttachmentIndex] = field(default_factory=list)
    metadata: list[mcap.MetadataIndex] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    span: tuple[int, int] | None = None

    def statistics(self) -> mcap.Statistics:
        """The statistics record of all that is indexed."""
        start, end = self.span or (0, 0)
        return mcap.Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(sorted(self.counts.items())),
            chunk_count=len(self.chunks),
            message_count=sum(self.counts.values()),
            message_end_time=end,
            message_start_time=start,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )


class SectionWriter:
    """Writes records to a file from a given position on, keeping the data section's CRC and the index.

    crc: of the bytes before position; None where it is unknown, then none is written.
    """

    def __init__(
        self, handle: BinaryIO, compression: str, index: Index | None = None, position: int = 0, crc: int | None = 0
    ) -> None:
        if compression not in ("zstd", "lz4", "", "none"):
            raise ValueError(f"compression is zstd, lz4 or none, not {compression!r}")
        self.index = index or Index()
        self._handle, self._position, self._crc = handle, position, crc
        self._compression = "" if compression == "none" else compression
        self._zstd = zstandard.ZstdCompressor(level=_ZSTD_LEVEL)
        self._declared: set[int] = set()

    def begin(self, profile: str, library: str) -> None:
        """Magic and header."""
        self._put(MAGIC)
        self._put(record_bytes(mcap.Header(profile=profile, library=library)))

    def declare(self, channel: mcap.Channel, schema: mcap.Schema | None) -> None:
        """Make a channel known; its records go into the first chunk that uses it."""
        self.index.channels[channel.id] = channel
        if schema is not None:
            self.index.schemas[schema.id] = schema

    def metadata(self, name: str, values: dict[str, str]) -> None:
        """A metadata record."""
        data = record_bytes(mcap.Metadata(name=name, metadata=values))
        self.index.metadata.append(mcap.MetadataIndex(offset=self._position, length=len(data), name=name))
        self._put(data)

    def attachment(self, attachment: mcap.Attachment) -> None:
        """An attachment record."""
        data = record_bytes(attachment)
        self.index.attachments.append(
            mcap.AttachmentIndex(
                offset=self._position,
                length=len(data),
                log_time=attachment.log_time,
                create_time=attachment.create_time,
                data_size=len(attachment.data),
                name=attachment.name,
                media_type=attachment.media_type,
            )
        )
        self._put(data)

    def preamble(self, channel_ids: list[int]) -> bytes:
        """Schema and channel records that the next chunk must carry before messages of these channels."""
        parts = []
        for channel_id in channel_ids:
            if channel_id not in self._declared:
                self._declared.add(channel_id)
                channel = self.index.channels[channel_id]
                if channel.schema_id:
                    parts.append(record_bytes(self.index.schemas[channel.schema_id]))
                parts.append(record_bytes(channel))
        return b"".join(parts)

    def idle(self, channel_ids: list[int]) -> None:
        """Channels without messages still belong into the data section, in a chunk of their own."""
        data = np.frombuffer(self.preamble(channel_ids), np.uint8)
        if len(data):
            none = np.zeros(0, np.int64)
            self.chunk(data, none, none, none)

    def chunk(
        self, data: NDArray[np.uint8], channel: NDArray[np.int64], log_time: NDArray[np.int64], start: NDArray[np.int64]
    ) -> None:
        """One chunk of uncompressed records; channel, log_time and start (byte in data) of each message, in order."""
        view = np.ascontiguousarray(data).data
        first, last = (int(log_time.min()), int(log_time.max())) if len(log_time) else (0, 0)
        packed = self._compress(view)
        name = self._compression.encode()
        head = struct.pack("<QQQII", first, last, len(view), crc32(view), len(name)) + name
        head += struct.pack("<Q", len(packed))
        place = self._position
        length = len(head) + len(packed)
        self._put(FRAME.pack(Opcode.CHUNK, length) + head)
        self._put(packed)
        offsets, index_length = self._message_indexes(channel, log_time, start)
        self.index.chunks.append(
            mcap.ChunkIndex(
                chunk_length=FRAME_SIZE + length,
                chunk_start_offset=place,
                compression=self._compression,
                compressed_size=len(packed),
                message_end_time=last,
                message_index_length=index_length,
                message_index_offsets=offsets,
                message_start_time=first,
                uncompressed_size=len(view),
            )
        )
        if len(log_time):
            old = self.index.span
            self.index.span = (first, last) if old is None else (min(old[0], first), max(old[1], last))

    def finish(self) -> None:
        """End of the data section, summary, footer."""
        end = record_bytes(mcap.DataEnd(data_section_crc=self._crc or 0))
        self._handle.write(end)
        start = self._position + len(end)
        groups = [(opcode, b"".join(map(record_bytes, self._group(name)))) for opcode, name in _SUMMARY_GROUPS]
        summary = b"".join(data for _, data in groups)
        offsets, place = [], start
        for opcode, data in groups:
            if data:
                offsets.append(mcap.SummaryOffset(group_opcode=opcode, group_start=place, group_length=len(data)))
            place += len(data)
        summary += b"".join(map(record_bytes, offsets))
        footer = FRAME.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", start, place)
        self._handle.write(summary + footer + struct.pack("<I", crc32(summary + footer)) + MAGIC)

    def _group(self, name: str) -> list[mcap.McapRecord]:
        if name == "statistics":
            return [self.index.statistics()]
        records = getattr(self.index, name)
        return list(records.values() if isinstance(records, dict) else records)

    def _message_indexes(
        self, channel: NDArray[np.int64], log_time: NDArray[np.int64], start: NDArray[np.int64]
    ) -> tuple[dict[int, int], int]:
        offsets: dict[int, int] = {}
        before = self._position
        for one in np.unique(channel).tolist():
            rows = np.flatnonzero(channel == one)
            entries = np.empty((len(rows), 2), "<u8")
            entries[:, 0], entries[:, 1] = log_time[rows], start[rows]
            offsets[one] = self._position
            self.index.counts[one] = self.index.counts.get(one, 0) + len(rows)
            self._put(FRAME.pack(Opcode.MESSAGE_INDEX, 6 + entries.nbytes) + struct.pack("<HI", one, entries.nbytes))
            self._put(entries.tobytes())
        return offsets, self._position - before

    def _compress(self, data: memoryview) -> bytes | memoryview:
        if self._compression == "zstd":
            return self._zstd.compress(data)
        return bytes(lz4.frame.compress(data)) if self._compression == "lz4" else data

    def _put(self, data: bytes | memoryview) -> None:
        self._handle.write(data)
        self._position += len(data)
        if self._crc is not None:
            self._crc = crc32(data, self._crc)


def record_bytes(record: mcap.McapRecord) -> bytes:
    """One record with its frame."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def next_id(used: dict[int, object]) -> int:
    """A channel or schema id that is free. Raises DataError when all 65535 are taken."""
    candidate = max(used, default=0) + 1
    if candidate > 0xFFFF:
        candidate = next((one for one in range(1, 0x10000) if one not in used), 0)
    if not candidate:
        raise DataError("the log has no free channel or schema id left")
    return candidate
