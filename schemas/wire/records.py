"""MCAP record by record: framing, strict parsing of record bodies, chunk contents.

Record bodies are parsed by the mcap library, through a stream that refuses short reads. No length is believed before
it is compared with the bytes that are really there.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from numpy.typing import NDArray

from schemas.wire.checksum import crc32

MAGIC = b"\x89MCAP0\r\n"
FRAME = struct.Struct("<BQ")
FRAME_SIZE = FRAME.size
MESSAGE_HEAD = np.dtype(
    [("opcode", "u1"), ("size", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
MESSAGE_BODY = 22  # bytes of a message record before its payload
MAX_CHUNK = 1 << 29  # bytes; recorders write chunks of some MiB, anything near this is damage or malice
_OFFSET = struct.Struct("<HQ")
CHUNK_HEAD = struct.Struct("<QQQII")

_PARSERS: dict[int, Any] = {
    Opcode.HEADER: mcap.Header,
    Opcode.FOOTER: mcap.Footer,
    Opcode.SCHEMA: mcap.Schema,
    Opcode.CHANNEL: mcap.Channel,
    Opcode.CHUNK: mcap.Chunk,
    Opcode.MESSAGE_INDEX: mcap.MessageIndex,
    Opcode.CHUNK_INDEX: mcap.ChunkIndex,
    Opcode.ATTACHMENT: mcap.Attachment,
    Opcode.ATTACHMENT_INDEX: mcap.AttachmentIndex,
    Opcode.STATISTICS: mcap.Statistics,
    Opcode.METADATA: mcap.Metadata,
    Opcode.METADATA_INDEX: mcap.MetadataIndex,
    Opcode.SUMMARY_OFFSET: mcap.SummaryOffset,
    Opcode.DATA_END: mcap.DataEnd,
}


class RecordError(Exception):
    """A record that cannot be what it says it is."""


class _StrictStream(ReadDataStream):
    def read(self, length: int) -> bytes:
        data = super().read(length) if length else b""
        if len(data) != length:
            raise RecordError("a length inside the record points past its end")
        return data


def parse_record(opcode: int, body: bytes) -> Any:
    """The mcap record of a body; None for opcodes not known here. Raises RecordError for a damaged one."""
    stream = _StrictStream(BytesIO(body))
    try:
        if opcode == Opcode.CHUNK_INDEX:
            return _chunk_index(body)
        if opcode == Opcode.MESSAGE:
            return mcap.Message.read(stream, len(body))
        parser = _PARSERS.get(opcode)
        return None if parser is None else parser.read(stream)
    except RecordError:
        raise
    except Exception as error:
        raise RecordError(f"a damaged record of type 0x{opcode:02x} ({error or type(error).__name__})") from error


def _chunk_index(body: bytes) -> mcap.ChunkIndex:
    """As the library parses it, in a tenth of its time: a long log has hundreds of them, each with a map."""
    start_time, end_time, start, length, size = struct.unpack_from("<QQQQI", body)
    if size % _OFFSET.size:
        raise RecordError("a chunk index whose map does not hold whole entries")
    place = 36 + size
    index_length, name = struct.unpack_from("<QI", body, place)
    data_size, plain_size = struct.unpack_from("<QQ", body, place + 12 + name)
    return mcap.ChunkIndex(
        chunk_length=length,
        chunk_start_offset=start,
        compression=body[place + 12 : place + 12 + name].decode(),
        compressed_size=data_size,
        message_end_time=end_time,
        message_index_length=index_length,
        message_index_offsets=dict(_OFFSET.iter_unpack(body[36:place])),
        message_start_time=start_time,
        uncompressed_size=plain_size,
    )


def frames(data: bytes | memoryview, start: int = 0) -> Iterator[tuple[int, int, int]]:
    """(opcode, start, length) of each whole record's body in data. Raises RecordError at one that is cut short."""
    position, end, unpack = start, len(data), FRAME.unpack_from
    while position < end:
        if position + FRAME_SIZE > end:
            raise RecordError("a record is cut short")
        opcode, length = unpack(data, position)
        position += FRAME_SIZE
        if length > end - position:
            raise RecordError("a record claims more bytes than there are")
        yield opcode, position, length
        position += length


def read_records(data: bytes) -> Iterator[Any]:
    """Every record of a whole file in order, chunks opened, message indexes left out.

    This is the plain reading of the format that the official conformance files are written for. Raises RecordError.
    """
    if not data.startswith(MAGIC) or not data.endswith(MAGIC):
        raise RecordError("the magic bytes of an MCAP file are missing")
    for opcode, start, length in frames(memoryview(data)[: -len(MAGIC)], len(MAGIC)):
        body = data[start : start + length]
        if opcode == Opcode.CHUNK:
            inner = open_chunk(body)
            for kind, first, size in frames(inner):
                yield parse_record(kind, bytes(inner[first : first + size]))
        elif opcode != Opcode.MESSAGE_INDEX and (record := parse_record(opcode, body)) is not None:
            yield record


@dataclass(frozen=True)
class ChunkHead:
    """The fixed part of a chunk record; data_start counts from the start of the body."""

    start_time: int
    end_time: int
    size: int
    crc: int
    compression: str
    data_start: int
    data_size: int


def chunk_head(body: bytes | memoryview, *, partial: bool = False) -> ChunkHead:
    """Head of a chunk's body (partial: the body's end is missing). Raises RecordError when it does not fit the body."""
    if len(body) < CHUNK_HEAD.size:
        raise RecordError("a chunk is too short")
    start, end, size, crc, name = CHUNK_HEAD.unpack_from(body)
    place = CHUNK_HEAD.size + name
    if place + 8 > len(body):
        raise RecordError("a chunk is too short")
    (data_size,) = struct.unpack_from("<Q", body, place)
    if data_size != len(body) - place - 8 and not partial:
        raise RecordError("a chunk's data do not fill its record")
    compression = bytes(body[CHUNK_HEAD.size : place]).decode("utf-8", errors="replace")
    return ChunkHead(start, end, size, crc, compression, place + 8, data_size)


def open_chunk(body: bytes | memoryview) -> memoryview:
    """Uncompressed records of a chunk, CRC checked where there is one. Raises RecordError."""
    head = chunk_head(body)
    if head.size > MAX_CHUNK:
        raise RecordError(f"a chunk claims {head.size} uncompressed bytes, more than the {MAX_CHUNK} allowed")
    out = np.empty(head.size, np.uint8)
    decompress_into(memoryview(body)[head.data_start :], head.compression, out.data)
    check_crc(out.data, head.crc)
    return out.data


def check_crc(data: memoryview, crc: int) -> None:
    """Raises RecordError when data do not have a CRC that is not zero (zero: none was written)."""
    if crc and crc32(data) != crc:
        raise RecordError("a chunk's CRC does not match its contents")


def decompress_into(data: memoryview, compression: str, out: memoryview) -> None:
    """Fill out, exactly, with the uncompressed data; never more. Raises RecordError."""
    if compression == "zstd":
        written = _unzstd(data, out)
    elif compression == "lz4":
        written = _unlz4(data, out)
    elif compression == "":
        written = len(data)
        if written == len(out):
            out[:] = data
    else:
        raise RecordError(f"unknown compression '{compression[:20]}'")
    if written != len(out):
        raise RecordError("a chunk does not hold as many bytes as it says")


def decompress_available(data: memoryview, compression: str, limit: int) -> bytes:
    """What can be decompressed, up to limit bytes, of data whose end is missing. Raises RecordError."""
    if compression == "":
        return bytes(data[:limit])
    if compression == "zstd":
        return _available_zstd(data, limit)
    if compression == "lz4":
        try:
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=limit))
        except (RuntimeError, ValueError, EOFError) as error:
            raise RecordError(f"a chunk cannot be decompressed ({error})") from error
    raise RecordError(f"unknown compression '{compression[:20]}'")


def _available_zstd(data: memoryview, limit: int) -> bytes:
    parts: list[bytes] = []
    room = limit
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        try:
            while room and (part := reader.read(min(room, 1 << 16))):
                parts.append(part)
                room -= len(part)
        except zstandard.ZstdError:
            pass  # damaged from here on; what came before is sound
    return b"".join(parts)


def _unzstd(data: memoryview, out: memoryview) -> int:
    try:
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as reader:
            written = _fill(reader.readinto, out)
            return written + len(reader.read(1))
    except zstandard.ZstdError as error:
        raise RecordError(f"a chunk cannot be decompressed ({error})") from error


def _fill(readinto: Any, out: memoryview) -> int:
    written = 0
    while written < len(out):
        count = readinto(out[written:])
        if not count:
            break
        written += count
    return written


def _unlz4(data: memoryview, out: memoryview) -> int:
    try:
        plain = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=len(out) + 1)
    except (RuntimeError, ValueError, EOFError) as error:
        raise RecordError(f"a chunk cannot be decompressed ({error})") from error
    if len(plain) == len(out):
        out[:] = plain
    return len(plain)


def message_heads(buffer: NDArray[np.uint8], start: NDArray[np.int64]) -> NDArray[Any]:
    """Heads (opcode to publish time) of the message records that begin at start in buffer."""
    size = MESSAGE_HEAD.itemsize
    # As opaque bytes first: numpy copies structured items field by field, which takes five times as long.
    windows = np.ndarray((max(len(buffer) - size + 1, 0),), np.dtype((np.void, size)), buffer, 0, (1,))
    return windows[start].view(MESSAGE_HEAD)


def join_heads(parts: list[NDArray[Any]]) -> NDArray[Any]:
    """Heads end to end; as opaque bytes too."""
    opaque = np.dtype((np.void, MESSAGE_HEAD.itemsize))
    return np.concatenate([part.view(opaque) for part in parts]).view(MESSAGE_HEAD)
