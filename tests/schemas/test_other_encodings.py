"""Protobuf and JSON channels, and channels that nothing decodes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.writer import Writer

from schemas.wire import read_log


def write(path: Path, encoding: str, schema: tuple[str, str, bytes] | None, payloads: list[bytes]) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema_id = writer.register_schema(*schema) if schema else 0
        channel = writer.register_channel("/x", encoding, schema_id)
        for k, payload in enumerate(payloads):
            writer.add_message(channel, k, payload, k)
        writer.finish()


def test_json_messages_become_columns_with_times_in_nanoseconds(tmp_path: Path):
    messages = [
        {"timestamp": {"sec": 1_700_000_000, "nsec": k}, "gyro": {"x": k + 0.5, "y": k}, "cov": [1, 2, k], "ok": k > 0}
        for k in range(3)
    ]
    payloads = [json.dumps(message).encode() for message in messages]
    write(tmp_path / "a.mcap", "json", ("Imu", "jsonschema", b"{}"), payloads)
    table = read_log(tmp_path / "a.mcap").tables["/x"]
    assert table.schema == "Imu"
    assert table.columns["timestamp"].tolist() == [1_700_000_000_000_000_000 + k for k in range(3)]
    assert table.columns["timestamp"].dtype == np.int64
    assert table.columns["gyro.x"].tolist() == [0.5, 1.5, 2.5]
    assert table.columns["gyro.y"].dtype == np.int64
    assert table.columns["cov"].shape == (3, 3)
    assert table.columns["ok"].tolist() == [False, True, True]


def test_json_that_is_broken_is_left_out_and_counted_and_missing_numbers_are_nan(tmp_path: Path):
    write(tmp_path / "a.mcap", "json", None, [b'{"a": 1}', b"{", b"[1]", b'{"b": 2}', b"[" * 100_000])
    log = read_log(tmp_path / "a.mcap")
    assert np.array_equal(log.tables["/x"].columns["a"], [1, np.nan], equal_nan=True)
    assert log.tables["/x"].log_time.tolist() == [0, 3]
    assert sum("could not be decoded" in problem for problem in log.problems) == 2


def descriptors() -> descriptor_pb2.FileDescriptorSet:
    """Imu {Timestamp time; Vector gyro; repeated double cov; Imu next}, with its dependencies in the wrong order."""
    file = descriptor_pb2.FileDescriptorProto(name="imu.proto", package="p", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    vector = file.message_type.add(name="Vector")
    for k, axis in enumerate("xyz"):
        vector.field.add(name=axis, number=k + 1, type=1, label=1)
    imu = file.message_type.add(name="Imu")
    imu.field.add(name="time", number=1, type=11, label=1, type_name=".google.protobuf.Timestamp")
    imu.field.add(name="gyro", number=2, type=11, label=1, type_name=".p.Vector")
    imu.field.add(name="cov", number=3, type=1, label=3)
    imu.field.add(name="next", number=4, type=11, label=1, type_name=".p.Imu")
    stamp = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    return descriptor_pb2.FileDescriptorSet(file=[file, stamp])


def test_protobuf_messages_become_columns_with_times_in_nanoseconds(tmp_path: Path):
    found = descriptors()
    pool = descriptor_pool.DescriptorPool()
    for file in reversed(found.file):
        pool.Add(file)
    imu = message_factory.GetMessageClass(pool.FindMessageTypeByName("p.Imu"))
    messages = [imu(time={"seconds": 5, "nanos": k}, gyro={"x": k, "z": -1.0}, cov=[1.0, k]) for k in range(4)]
    payloads = [message.SerializeToString() for message in messages]
    schema = ("p.Imu", "protobuf", found.SerializeToString())
    write(tmp_path / "a.mcap", "protobuf", schema, [*payloads, b"\xff\xff"])
    log = read_log(tmp_path / "a.mcap")
    table = log.tables["/x"]
    assert table.columns["time"].tolist() == [5_000_000_000 + k for k in range(4)]
    assert table.vector("gyro").tolist() == [[k, 0.0, -1.0] for k in range(4)]
    assert table.columns["cov"].tolist() == [[1.0, k] for k in range(4)]
    assert len(log.problems) == 1
    assert "1 messages could not be decoded" in log.problems[0]


def test_a_broken_protobuf_schema_or_an_unknown_encoding_is_said_and_the_log_is_read(tmp_path: Path):
    for schema, encoding in ((("p.Imu", "protobuf", b"junk"), "protobuf"), (("x", "ros1msg", b""), "ros1")):
        write(tmp_path / "a.mcap", encoding, schema, [b"x"])
        log = read_log(tmp_path / "a.mcap")
        assert log.tables == {}
        assert log.channels[0].count == 1
        assert log.problems[0].startswith("/x: not decoded:")
