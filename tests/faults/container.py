"""Mutations of the container: bytes of a sound log in, bytes of a damaged one out."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable

import zstandard
from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from schemas.wire.records import FRAME_SIZE, MAGIC, frames
from schemas.wire.section import record_bytes

Bytes = Callable[[bytes], bytes]
_CRC_AT = FRAME_SIZE + 24  # of a chunk's uncompressed CRC, from the start of the record


def records(data: bytes) -> list[tuple[int, int, int]]:
    """(opcode, start, stop) of every record outside chunks."""
    return [(op, at - FRAME_SIZE, at + length) for op, at, length in frames(memoryview(data)[:-8], len(MAGIC))]


def chunks(data: bytes) -> list[tuple[int, int]]:
    return [(start, stop) for op, start, stop in records(data) if op == Opcode.CHUNK]


def data_end(data: bytes) -> int:
    return next(start for op, start, _ in records(data) if op == Opcode.DATA_END)


def truncated_in_header(data: bytes) -> bytes:
    return data[: len(MAGIC) + 5]


def truncated_in_chunk(data: bytes) -> bytes:
    start, stop = chunks(data)[-3]
    return data[: (start + stop) // 2]


def truncated_in_summary(data: bytes) -> bytes:
    return data[: (data_end(data) + len(data)) // 2]


def flipped(data: bytes) -> bytes:
    """A byte in the middle of the fourth chunk."""
    start, stop = chunks(data)[3]
    return with_byte(data, (start + stop) // 2)


def with_byte(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :]


def flipped_without_crc(data: bytes) -> bytes:
    """The same in a log whose chunks carry no CRC: the damaged samples themselves must betray it."""
    data = uncompressed(data)
    for start, _ in chunks(data):
        data = data[: start + _CRC_AT] + bytes(4) + data[start + _CRC_AT + 4 :]
    place = data.index(b"imu_sub", chunks(data)[3][0])
    return with_byte(data, place + 12 + 32 + 72 + 6)  # in the exponent of the gyro's x


def rewritten(data: bytes, **options: object) -> bytes:
    """The same messages as the library's own writer lays them out."""
    target = io.BytesIO()
    writer = Writer(target, chunk_size=100_000, **options)  # type: ignore[arg-type]
    writer.start("ros2")
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages(log_time_order=False):
        assert schema is not None
        if schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
        if channel.id not in channels:
            channels[channel.id] = writer.register_channel(channel.topic, "cdr", schemas[schema.id])
        writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
    writer.finish()
    return target.getvalue()


def uncompressed(data: bytes) -> bytes:
    return rewritten(data, compression=CompressionType.NONE)


def lz4(data: bytes) -> bytes:
    return rewritten(data, compression=CompressionType.LZ4)


def unchunked(data: bytes) -> bytes:
    return rewritten(data, use_chunking=False)


def without_message_index(data: bytes) -> bytes:
    parts = [data[start:stop] for op, start, stop in records(data) if op not in (Opcode.MESSAGE_INDEX, Opcode.DATA_END)]
    body = b"".join(parts[: next(k for k, part in enumerate(parts) if part[0] in (3, 4))])
    return MAGIC + body + end()


def without_summary(data: bytes) -> bytes:
    return data[: data_end(data)] + end()


def end() -> bytes:
    return record_bytes(mcap.DataEnd(0)) + record_bytes(mcap.Footer(0, 0, 0)) + MAGIC


def unknown_compression(data: bytes) -> bytes:
    """One chunk says it is compressed in a way nobody knows."""
    start, _ = chunks(data)[3]
    place = data.index(b"zstd", start)
    return data[:place] + b"snap" + data[place + 4 :]


def zero_length_records(data: bytes) -> bytes:
    """Empty records of every kind in front of the first chunk; none can be what it says it is."""
    start, _ = chunks(data)[0]
    empty = b"".join(struct.pack("<BQ", op, 0) for op in (5, 0x7F, 0x80, 0xFF))
    return without_summary(data[:start] + empty + data[start:])


def conflicting_channel(data: bytes) -> bytes:
    """In the midst of the log the sub-IMU's channel id is given to the main one's topic."""
    with io.BytesIO(data) as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    channel = next(one for one in summary.channels.values() if one.topic == "/imu/sub")
    again = mcap.Channel(channel.id, "/imu/main", "cdr", {}, channel.schema_id)
    start, _ = chunks(data)[-2]
    return without_summary(data[:start] + record_bytes(again) + data[start:])


def with_chunk(**changes: object) -> Bytes:
    """A chunk behind the others, changed so that it lies."""

    def mutate(data: bytes) -> bytes:
        inner = bytes(64)
        fields = {
            "compression": "", "data": inner, "message_end_time": 7, "message_start_time": 7, "uncompressed_crc": 0,
            "uncompressed_size": len(inner), **changes,
        }  # fmt: skip
        return data[: data_end(data)] + record_bytes(mcap.Chunk(**fields)) + end()  # type: ignore[arg-type]

    return mutate


def bomb(size: int) -> bytes:
    return zstandard.ZstdCompressor(level=3).compress(bytes(size))


def with_claim(opcode: int) -> Bytes:
    """A record that claims an exabyte, behind all others."""
    return lambda data: data[: data_end(data)] + struct.pack("<BQ", opcode, 1 << 60) + bytes(100)


def with_hostile_schema(text: str) -> Bytes:
    """A channel nobody asked for, with one message, whose definition asks for the impossible."""

    def mutate(data: bytes) -> bytes:
        extra = record_bytes(mcap.Schema(900, text.encode(), "ros2msg", "evil/msg/Evil"))
        extra += record_bytes(mcap.Channel(900, "/evil", "cdr", {}, 900))
        extra += record_bytes(mcap.Message(900, 5, b"\0\1\0\0" + b"\xff" * 60, 5, 0))
        return data[: data_end(data)] + extra + end()

    return mutate


def hostile_main(text: str) -> Bytes:
    """200 bytes that define the main IMU as the impossible."""

    def mutate(_: bytes) -> bytes:
        body = record_bytes(mcap.Header("ros2", ""))
        for number, topic in enumerate(("/imu/main", "/imu/sub"), start=1):
            body += record_bytes(mcap.Schema(number, text.encode(), "ros2msg", "sensor_msgs/msg/Imu"))
            body += record_bytes(mcap.Channel(number, topic, "cdr", {}, number))
            body += record_bytes(mcap.Message(number, 5, b"\0\1\0\0" + b"\xff" * 12, 5, 0))
        return MAGIC + body + end()

    return mutate


def lying_statistics(data: bytes) -> bytes:
    """A sound log whose summary counts messages that are not there."""
    place = next(start for op, start, _ in records(data) if op == Opcode.STATISTICS) + FRAME_SIZE
    changed = data[:place] + struct.pack("<Q", 1 << 50) + data[place + 8 :]
    return changed[:-12] + bytes(4) + changed[-8:]  # no summary CRC to betray it


def lying_message_index(data: bytes) -> bytes:
    """A message index that names places outside its chunk."""
    start = next(start for op, start, _ in records(data) if op == Opcode.MESSAGE_INDEX)
    place = start + FRAME_SIZE + 6
    return data[:place] + struct.pack("<QQ", 5, (1 << 64) - 3) + data[place + 16 :]


def with_hostile_names(data: bytes) -> bytes:
    """Topics, types, attachments and metadata that are named as files elsewhere."""
    name = "../../escape"
    extra = record_bytes(mcap.Schema(901, b"float64 x", "ros2msg", name))
    extra += record_bytes(mcap.Channel(901, f"/{name}", "cdr", {name: name}, 901))
    extra += record_bytes(mcap.Message(901, 5, b"\0\1\0\0" + bytes(8), 5, 0))
    extra += record_bytes(mcap.Attachment(5, 5, name, "text/plain", b"#!/bin/sh"))
    extra += record_bytes(mcap.Metadata(name, {name: name, "[red]": "\x1b[31m"}))
    return data[: data_end(data)] + extra + end()
