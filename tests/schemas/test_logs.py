"""Logs written, read back, appended to; by us and by others."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rerun.chunk import McapReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from schemas.errors import DataError
from schemas.wire import append_tables, definition, read_log, read_messages, scan_log, write_log
from tests.schemas.sample_logs import EPOCH, assert_same, imu, score, small_log

SHARED = Path(__file__).parents[2].parent / "shared"
REAL = sorted(SHARED.glob("logs/*.mcap")) + sorted(SHARED.glob("data/*/*.mcap"))


def counts(path: Path) -> Counter[str]:
    """Messages by topic as mcap's CRC-checking reader sees them."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return Counter(channel.topic for _, channel, _ in reader.iter_messages())


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_tables_come_back_as_they_were_written(tmp_path: Path, compression: str):
    tables = small_log(tmp_path / "a.mcap", compression)
    log = read_log(tmp_path / "a.mcap")
    assert log.problems == ()
    assert log.metadata == {"voyage": {"ship": "A"}}
    for table in tables:
        assert_same(table, log.tables[table.topic])


def test_the_same_tables_give_the_same_bytes(tmp_path: Path):
    small_log(tmp_path / "a.mcap")
    small_log(tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_the_summary_alone_tells_channels_and_span(tmp_path: Path):
    tables = small_log(tmp_path / "a.mcap")
    log = scan_log(tmp_path / "a.mcap")
    assert {(c.topic, c.schema, c.count) for c in log.channels} == {(t.topic, t.schema, len(t)) for t in tables}
    assert (log.start, log.end) == (
        min(int(table.log_time.min()) for table in tables),
        max(int(table.log_time.max()) for table in tables),
    )


def test_topics_and_progress(tmp_path: Path):
    small_log(tmp_path / "a.mcap")
    seen: list[tuple[int, int]] = []
    log = read_log(tmp_path / "a.mcap", ["/imu/sub"], lambda done, size: seen.append((done, size)))
    assert set(log.tables) == {"/imu/sub"}
    assert len(log.tables["/imu/sub"]) == 200
    size = (tmp_path / "a.mcap").stat().st_size
    assert seen[-1] == (size, size)
    assert seen == sorted(seen)


def test_vectors_and_quaternions(tmp_path: Path):
    table = imu()
    assert np.array_equal(table.vector("angular_velocity")[:, 2], table.columns["angular_velocity.z"])
    assert table.quaternion("orientation").shape == (200, 4)
    with pytest.raises(DataError, match=r"/imu/main: .* has no field pose\.x"):
        table.vector("pose")


def test_rosbags_reads_the_same_values(tmp_path: Path):
    tables = small_log(tmp_path / "a.mcap")
    store = get_typestore(Stores.EMPTY)
    for table in tables:
        store.register(get_types_from_msg(definition(table.schema), table.schema))
    with Reader(tmp_path / "a.mcap") as reader:
        names = [
            store.deserialize_cdr(raw, c.msgtype).estimator for c, _, raw in reader.messages() if "score" in c.topic
        ]
    assert names == score().columns["estimator"].tolist()


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
@pytest.mark.parametrize("options", [
    {}, {"use_chunking": False}, {"index_types": 0}, {"enable_crcs": False}, {"use_statistics": False},
    {"use_summary_offsets": False, "repeat_channels": False, "repeat_schemas": False},
])  # fmt: skip
def test_every_shape_of_file_gives_the_same_table(tmp_path: Path, compression: CompressionType, options: dict):
    from mcap.writer import IndexType

    options = {**options, **({"index_types": IndexType.NONE} if "index_types" in options else {})}
    small_log(tmp_path / "a.mcap")
    raw = read_messages(tmp_path / "a.mcap", "/deckflex/score")
    with (tmp_path / "b.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=1000, compression=compression, **options)
        writer.start("ros2", "test")
        schema = writer.register_schema(
            "deckflex_msgs/msg/Score", "ros2msg", definition("deckflex_msgs/Score").encode()
        )
        channel = writer.register_channel("/deckflex/score", "cdr", schema)
        for k in range(len(raw)):
            writer.add_message(channel, int(raw.log_time[k]), raw.payload(k), int(raw.publish_time[k]))
        writer.finish()
    log = read_log(tmp_path / "b.mcap")
    assert log.problems == ()
    assert_same(score(), log.tables["/deckflex/score"])
    problems = append_tables(tmp_path / "b.mcap", tmp_path / "c.mcap", [imu("/new")])
    assert problems == ()
    assert counts(tmp_path / "c.mcap") == {"/deckflex/score": 40, "/new": 200}
    assert_same(score(), read_log(tmp_path / "c.mcap").tables["/deckflex/score"])


def test_disorder_duplicates_and_overlapping_chunks_survive_in_the_order_of_the_log(tmp_path: Path):
    table = imu(n=60)
    order = np.random.default_rng(3).permutation(60)
    order[10] = order[11]
    shuffled = replace(
        table,
        columns={path: values[order] for path, values in table.columns.items()},
        log_time=table.log_time[order],
    )
    write_log(tmp_path / "a.mcap", [shuffled], chunk_bytes=4000)
    assert_same(shuffled, read_log(tmp_path / "a.mcap").tables["/imu/main"])


def test_appending_keeps_the_source_and_its_chunks_and_is_valid_for_others(tmp_path: Path):
    tables = small_log(tmp_path / "a.mcap")
    before = (tmp_path / "a.mcap").read_bytes()
    assert append_tables(tmp_path / "a.mcap", tmp_path / "b.mcap", [imu("/new", 500)], metadata={"n": {"k": "v"}}) == ()
    after = (tmp_path / "b.mcap").read_bytes()
    assert (tmp_path / "a.mcap").read_bytes() == before
    data_end = before.index(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00", len(before) // 2)
    assert after[:data_end] == before[:data_end]
    expected = {table.topic: len(table) for table in tables} | {"/new": 500}
    assert counts(tmp_path / "b.mcap") == expected
    with Reader(tmp_path / "b.mcap") as reader:
        assert Counter(connection.topic for connection, _, _ in reader.messages()) == expected
    entities = {str(chunk.entity_path) for chunk in McapReader(tmp_path / "b.mcap").stream()}
    assert "/new" in entities
    log = read_log(tmp_path / "b.mcap")
    assert log.problems == ()
    assert log.metadata == {"voyage": {"ship": "A"}, "n": {"k": "v"}}


def test_appending_keeps_attachments_in_the_index_and_in_a_rewrite(tmp_path: Path):
    for chunking in (True, False):
        with (tmp_path / "a.mcap").open("wb") as file:
            writer = Writer(file, use_chunking=chunking)
            writer.start()
            writer.add_attachment(1, 2, "../../etc/passwd", "text/plain", b"hello")
            channel = writer.register_channel("/x", "json", 0)
            writer.add_message(channel, 5, b'{"a": 1}', 5)
            writer.finish()
        append_tables(tmp_path / "a.mcap", tmp_path / "b.mcap", [imu()])
        with (tmp_path / "b.mcap").open("rb") as file:
            found = list(make_reader(file, validate_crcs=True).iter_attachments())
        assert [(one.name, one.data) for one in found] == [("../../etc/passwd", b"hello")]
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["a.mcap", "b.mcap"]


def test_a_failed_write_leaves_nothing_behind_and_an_old_target_untouched(tmp_path: Path):
    target = tmp_path / "a.mcap"
    target.write_bytes(b"old")
    bad = replace(imu(), columns={**imu().columns, "angular_velocity.x": np.zeros((200, 2))})
    with pytest.raises(DataError, match=r"/imu/main: angular_velocity\.x does not fit"):
        write_log(target, [bad])
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]
    with pytest.raises(DataError, match="cannot be written"):
        write_log(tmp_path / "nowhere" / "a.mcap", [imu()])


def test_the_input_is_never_the_output(tmp_path: Path):
    small_log(tmp_path / "a.mcap")
    with pytest.raises(DataError, match="never changed"):
        append_tables(tmp_path / "a.mcap", tmp_path / "a.mcap", [imu()])


def test_an_empty_table_keeps_its_channel_and_columns(tmp_path: Path):
    write_log(tmp_path / "a.mcap", [imu(n=0), score()])
    table = read_log(tmp_path / "a.mcap").tables["/imu/main"]
    assert len(table) == 0
    assert table.columns["orientation_covariance"].shape == (0, 9)
    assert table.vector("angular_velocity").shape == (0, 3)


def test_a_stamp_beyond_32_bits_of_seconds_is_refused(tmp_path: Path):
    table = imu(n=3)
    table.columns["header.stamp"] = np.full(3, 2 * EPOCH)
    with pytest.raises(DataError, match="32-bit"):
        write_log(tmp_path / "a.mcap", [table])


@pytest.mark.skipif(not REAL, reason="the shared logs are not beside the repository")
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_shared_logs_read_without_a_problem_and_agree_with_their_summary(path: Path):
    log, summary = read_log(path), scan_log(path)
    assert log.problems == ()
    assert log.channels == summary.channels
    assert all(len(log.tables[channel.topic]) == channel.count for channel in summary.channels)


def test_lz4_frames_without_content_size_are_read(tmp_path: Path):
    with lz4.frame.open(tmp_path / "x.lz4", "wb") as file:
        file.write(b"x" * 1000)
    from schemas.wire.records import decompress_into

    out = np.zeros(1000, np.uint8)
    decompress_into(memoryview((tmp_path / "x.lz4").read_bytes()), "lz4", out.data)
    assert (out == ord("x")).all()
