"""Damaged and hostile logs: what is there is read, what is lost is said, nothing is invented, memory is bounded."""

from __future__ import annotations

import struct
import tracemalloc
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap import records as mcap
from mcap.data_stream import ReadDataStream
from mcap.writer import Writer

from schemas.errors import DataError
from schemas.wire import append_tables, read_log, scan_log
from schemas.wire.records import MAGIC, RecordError, decompress_into, frames, open_chunk, parse_record
from schemas.wire.section import record_bytes
from tests.schemas.sample_logs import imu, small_log


def boundaries(data: bytes) -> list[tuple[int, int, int]]:
    """(opcode, start, stop) of every top-level record."""
    return [(op, start - 9, start + length) for op, start, length in frames(memoryview(data)[:-8], len(MAGIC))]


def total(log: object) -> int:
    return sum(map(len, log.tables.values()))  # type: ignore[attr-defined]


def test_a_file_cut_anywhere_gives_a_prefix_of_every_table_and_says_so(tmp_path: Path):
    tables = {table.topic: table for table in small_log(tmp_path / "a.mcap")}
    data = (tmp_path / "a.mcap").read_bytes()
    cuts = {cut for _, start, stop in boundaries(data) for cut in (start, start + 5, start + 9, (start + stop) // 2)}
    previous = -1
    for cut in sorted(cuts | {len(data) - 1, len(data) - 8}):
        if cut < len(MAGIC):
            continue
        (tmp_path / "b.mcap").write_bytes(data[:cut])
        log = read_log(tmp_path / "b.mcap")
        for topic, table in log.tables.items():
            n = len(table)
            assert np.array_equal(table.log_time, tables[topic].log_time[:n])
            for path in table.columns.keys() & tables[topic].columns.keys():
                assert np.array_equal(table.columns[path], tables[topic].columns[path][:n]), path
        assert total(log) >= previous, "a longer piece never gives less"
        previous = total(log)
        lost = total(log) < sum(map(len, tables.values()))
        assert log.problems or not lost
    assert previous == sum(map(len, tables.values()))


def test_a_cut_inside_a_chunk_tells_byte_and_last_time_and_keeps_the_whole_messages(tmp_path: Path):
    small_log(tmp_path / "a.mcap", "none")
    data = (tmp_path / "a.mcap").read_bytes()
    _, start, stop = [record for record in boundaries(data) if record[0] == 6][2]
    (tmp_path / "b.mcap").write_bytes(data[: (start + stop) // 2])
    log = read_log(tmp_path / "b.mcap")
    assert any(f"byte {start}" in problem and "truncated" in problem for problem in log.problems)
    assert any("last time" in problem for problem in log.problems)
    whole = read_log_of(tmp_path, data[:start])
    assert total(log) > total(whole)
    assert scan_log(tmp_path / "b.mcap").problems == log.problems


def read_log_of(tmp_path: Path, data: bytes):
    (tmp_path / "x.mcap").write_bytes(data)
    return read_log(tmp_path / "x.mcap")


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_flipped_bytes_never_pass_unnoticed_and_never_crash(tmp_path: Path, compression: str):
    tables = {table.topic: table for table in small_log(tmp_path / "a.mcap", compression)}
    data = (tmp_path / "a.mcap").read_bytes()
    summary = scan_log(tmp_path / "a.mcap")
    end = next(start for op, start, _ in boundaries(data) if op == 0x0F)
    for place in np.random.default_rng(5).integers(8, end, 60):
        flipped = bytearray(data)
        flipped[place] ^= 0x41
        try:
            log = read_log_of(tmp_path, bytes(flipped))
        except DataError:
            continue
        for topic, table in log.tables.items():
            if topic not in tables or len(table) != len(tables[topic]):
                assert log.problems, place
                continue
            values = table.vector("angular_velocity") if "imu" in topic else table.columns["duration"]
            own = tables[topic]
            expected = own.vector("angular_velocity") if "imu" in topic else own.columns["duration"]
            assert log.problems or np.array_equal(values, expected), place
    assert summary.problems == ()


def with_chunk(**changes: object) -> bytes:
    """A log of one chunk with one schemaless message, its chunk record changed."""
    inner = record_bytes(mcap.Channel(id=1, topic="/x", message_encoding="json", metadata={}, schema_id=0))
    inner += record_bytes(mcap.Message(channel_id=1, log_time=7, data=b'{"a": 1}', publish_time=7, sequence=0))
    fields = {
        "compression": "", "data": inner, "message_end_time": 7, "message_start_time": 7, "uncompressed_crc": 0,
        "uncompressed_size": len(inner), **changes,
    }  # fmt: skip
    body = record_bytes(mcap.Header("", "")) + record_bytes(mcap.Chunk(**fields))  # type: ignore[arg-type]
    return MAGIC + body + record_bytes(mcap.DataEnd(0)) + record_bytes(mcap.Footer(0, 0, 0)) + MAGIC


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"compression": "brotli"}, "unknown compression 'brotli'"),
        ({"uncompressed_crc": 5}, "CRC does not match"),
        ({"uncompressed_size": 1 << 40}, "more than the"),
        ({"uncompressed_size": 5}, "does not hold as many bytes"),
        ({"compression": "zstd", "data": b"nonsense"}, "cannot be decompressed"),
        ({"compression": "lz4", "data": b"nonsense"}, "cannot be decompressed"),
    ],
)
def test_a_chunk_that_cannot_be_used_is_lost_with_its_byte_and_reason(tmp_path: Path, changes: dict, words: str):
    log = read_log_of(tmp_path, with_chunk(**changes))
    assert total(log) == 0
    assert len(log.problems) == 1
    assert words in log.problems[0]
    assert "byte 34" in log.problems[0]


def test_a_sound_chunk_without_message_index_is_read(tmp_path: Path):
    log = read_log_of(tmp_path, with_chunk())
    assert log.tables["/x"].columns["a"].tolist() == [1]
    assert log.problems == ()


def test_a_small_file_cannot_make_us_use_much_memory(tmp_path: Path):
    bomb = zstandard.ZstdCompressor(level=19).compress(bytes(100_000_000))
    cases = [
        with_chunk(compression="zstd", data=bomb, uncompressed_size=1000),
        with_chunk(compression="zstd", data=bomb, uncompressed_size=1 << 50),
        MAGIC + struct.pack("<BQ", 6, 1 << 60) + bytes(40),
        MAGIC + struct.pack("<BQ", 4, 1 << 40) + bytes(40),
        MAGIC + bytes(200),
    ]
    for case in cases:
        tracemalloc.start()
        log = read_log_of(tmp_path, case)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert log.problems
        assert peak < 20_000_000


def test_decompression_stops_at_the_declared_size():
    bomb = zstandard.ZstdCompressor().compress(bytes(1_000_000))
    with pytest.raises(RecordError, match="does not hold as many bytes"):
        decompress_into(memoryview(bomb), "zstd", memoryview(bytearray(10)))


@pytest.mark.parametrize(
    ("data", "words"),
    [(b"", "the file is empty"), (b"hello, this is text", "not an MCAP file"), (MAGIC[:5], "not an MCAP file")],
)
def test_what_is_no_mcap_file_is_refused_in_one_line(tmp_path: Path, data: bytes, words: str):
    (tmp_path / "x.mcap").write_bytes(data)
    for read in (read_log, scan_log):
        with pytest.raises(DataError, match=words) as caught:
            read(tmp_path / "x.mcap")
        assert "x.mcap" in str(caught.value)


def test_a_missing_file_or_a_folder_is_refused(tmp_path: Path):
    for path in (tmp_path / "none.mcap", tmp_path):
        with pytest.raises(DataError):
            read_log(path)


def test_a_channel_id_defined_twice_is_reported_and_no_message_is_misattributed(tmp_path: Path):
    with (tmp_path / "a.mcap").open("wb") as file:
        file.write(MAGIC + record_bytes(mcap.Header("", "")))
        for topic in ("/a", "/b"):
            file.write(record_bytes(mcap.Channel(1, topic, "json", {}, 0)))
            file.write(record_bytes(mcap.Message(1, 5, b'{"a": 1}', 5, 0)))
        file.write(record_bytes(mcap.DataEnd(0)) + record_bytes(mcap.Footer(0, 0, 0)) + MAGIC)
    log = read_log(tmp_path / "a.mcap")
    assert {topic: len(table) for topic, table in log.tables.items()} == {"/a": 1}
    assert "channel id 1 is defined twice, as /a and as /b" in log.problems[0]
    assert "1 messages of channel id 1 were left out" in log.problems[1]


def test_messages_of_an_undefined_channel_and_empty_message_records_are_reported(tmp_path: Path):
    with (tmp_path / "a.mcap").open("wb") as file:
        file.write(MAGIC + record_bytes(mcap.Header("", "")))
        file.write(record_bytes(mcap.Message(9, 5, b"x", 5, 0)) + struct.pack("<BQ", 5, 0))
        file.write(record_bytes(mcap.DataEnd(0)) + record_bytes(mcap.Footer(0, 0, 0)) + MAGIC)
    log = read_log(tmp_path / "a.mcap")
    assert any("channel id 9, which is not defined" in problem for problem in log.problems)
    assert any("too short" in problem for problem in log.problems)


def test_damage_in_the_middle_is_stepped_over_by_the_summary(tmp_path: Path):
    tables = small_log(tmp_path / "a.mcap")
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    chunks = [record for record in boundaries(bytes(data)) if record[0] == 6]
    data[chunks[1][1] + 4] = 0x7F  # the length of the second chunk
    log = read_log_of(tmp_path, bytes(data))
    assert 0 < total(log) < sum(map(len, tables))
    assert any(f"reading goes on at byte {chunks[2][1]}" in problem for problem in log.problems)
    assert log.tables["/imu/main"].log_time[-1] == tables[0].log_time[-1]


def test_changed_bytes_without_chunk_crc_show_in_the_crc_of_the_data_section(tmp_path: Path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file, use_chunking=False, enable_data_crcs=True)
        writer.start()
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 5, b'{"a": 12345}', 5)
        writer.finish()
    data = (tmp_path / "a.mcap").read_bytes()
    log = read_log_of(tmp_path, data.replace(b"12345", b"12346"))
    assert log.problems == ("the CRC of the data section does not match: bytes of the file have changed",)


def test_a_truncated_source_is_appended_to_with_what_there_is(tmp_path: Path):
    small_log(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "b.mcap").write_bytes(data[: len(data) // 2])
    problems = append_tables(tmp_path / "b.mcap", tmp_path / "c.mcap", [imu("/new")])
    assert any("truncated" in problem for problem in problems)
    log, cut = read_log(tmp_path / "c.mcap"), read_log(tmp_path / "b.mcap")
    assert log.problems == ()
    assert {t: len(v) for t, v in log.tables.items()} == {**{t: len(v) for t, v in cut.tables.items()}, "/new": 200}


def test_an_opened_chunk_is_checked_against_its_own_crc():
    body = record_bytes(mcap.Chunk("", b"abc", 0, 0, 1, 3))[9:]
    with pytest.raises(RecordError, match="CRC"):
        open_chunk(body)


@pytest.mark.parametrize(("log_time", "publish_time"), [(1 << 63, 5), (5, (1 << 64) - 1)])
def test_times_beyond_63_bits_are_left_out_and_counted(tmp_path: Path, log_time: int, publish_time: int):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 7, b'{"a": 1}', 7)
        writer.add_message(channel, log_time, b'{"a": 2}', publish_time)
        writer.finish()
    log = read_log(tmp_path / "a.mcap")
    assert log.tables["/x"].columns["a"].tolist() == [1]
    assert log.tables["/x"].log_time.tolist() == [7]
    assert log.problems == ("/x: 1 messages with times after the year 2262 were left out",)
    assert bool(scan_log(tmp_path / "a.mcap").problems) == (log_time > 5)


def test_a_log_of_impossible_times_alone_gives_an_empty_table(tmp_path: Path):
    body = record_bytes(mcap.Channel(1, "/x", "json", {}, 0)) + record_bytes(mcap.Message(1, 1 << 63, b"{}", 1, 0))
    end = record_bytes(mcap.DataEnd(0)) + record_bytes(mcap.Footer(0, 0, 0)) + MAGIC
    log = read_log_of(tmp_path, MAGIC + record_bytes(mcap.Header("", "")) + body + end)
    assert len(log.tables["/x"]) == 0
    assert "after the year 2262" in log.problems[0]


def with_attachments(path: Path, *contents: bytes) -> bytes:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for k, content in enumerate(contents):
            writer.add_attachment(k, k, f"file {k}", "text/plain", content)
        writer.finish()
    return path.read_bytes()


def test_a_changed_attachment_is_noticed_when_asked(tmp_path: Path):
    data = with_attachments(tmp_path / "a.mcap", b"sound", b"0123456789" * 1_000_000)
    assert read_log(tmp_path / "a.mcap", attachments=True).problems == ()
    (tmp_path / "b.mcap").write_bytes(data.replace(b"9012345678", b"9012345679", 1))
    assert read_log(tmp_path / "b.mcap").problems == ()
    (problem,) = read_log(tmp_path / "b.mcap", attachments=True).problems
    assert "attachment 'file 1'" in problem
    assert "CRC does not match" in problem


def test_a_changed_attachment_is_told_when_the_log_is_written_anew(tmp_path: Path):
    data = with_attachments(tmp_path / "a.mcap", b"sound as it was")
    (tmp_path / "b.mcap").write_bytes(data.replace(b"sound", b"SOUND")[:-30])  # without its summary
    problems = append_tables(tmp_path / "b.mcap", tmp_path / "c.mcap", [imu()])
    assert any("attachment 'file 0'" in problem for problem in problems)


def test_a_chunk_index_is_parsed_as_the_library_does(tmp_path: Path):
    small_log(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    bodies = [data[start + 9 : stop] for op, start, stop in boundaries(data) if op == 0x08]
    assert len(bodies) > 3
    for body in bodies:
        assert parse_record(8, body) == mcap.ChunkIndex.read(ReadDataStream(BytesIO(body)))
        for size in (0, 10, 40, len(body) - 1):
            with pytest.raises(RecordError):
                parse_record(8, body[:size])
