"""Only the columns asked for: the same values, and the same watch over everything else."""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from schemas.wire import Table, read_log, write_log
from schemas.wire.checksum import crc32
from schemas.wire.definitions import parse
from schemas.wire.fields import Block, blocks_of, is_wanted
from schemas.wire.layout import Leaf, empty_layout, rows_alike
from schemas.wire.memory import Room, Supply
from tests.schemas.sample_logs import assert_same, imu, score, small_log

ASKED = {"/imu/main": ["header.stamp", "angular_velocity", "orientation_covariance"]}
KEPT = ["header.stamp", "orientation_covariance", *(f"angular_velocity.{axis}" for axis in "xyz")]


def test_the_columns_asked_for_are_those_of_the_whole_table(tmp_path: Path):
    tables = small_log(tmp_path / "a.mcap")
    log = read_log(tmp_path / "a.mcap", columns=ASKED)
    part, whole = log.tables["/imu/main"], read_log(tmp_path / "a.mcap").tables["/imu/main"]
    assert list(part.columns) == KEPT
    assert_same(part, whole)
    assert part.fields == whole.fields == tuple(whole.columns)
    assert log.problems == ()
    assert_same(tables[1], log.tables["/imu/sub"])


def test_an_empty_channel_has_the_columns_asked_for(tmp_path: Path):
    write_log(tmp_path / "a.mcap", [imu(n=0), score()])
    table = read_log(tmp_path / "a.mcap", columns=ASKED).tables["/imu/main"]
    assert list(table.columns) == KEPT
    assert table.vector("angular_velocity").shape == (0, 3)


def test_none_asked_for_leaves_the_times(tmp_path: Path):
    table, *_ = small_log(tmp_path / "a.mcap")
    found = read_log(tmp_path / "a.mcap", columns={"/imu/main": []}).tables["/imu/main"]
    assert found.columns == {}
    assert np.array_equal(found.log_time, table.log_time)


def test_a_changed_byte_outside_the_columns_asked_for_is_noticed(tmp_path: Path):
    table = imu(n=50)
    table.columns["linear_acceleration_covariance"][17, 4] = 1234.5
    write_log(tmp_path / "a.mcap", [table], compression="none")
    data = (tmp_path / "a.mcap").read_bytes()
    assert data.count(np.float64(1234.5).tobytes()) == 1
    (tmp_path / "a.mcap").write_bytes(data.replace(np.float64(1234.5).tobytes(), np.float64(1234.6).tobytes()))
    log = read_log(tmp_path / "a.mcap", columns={"/imu/main": ["header.stamp"]})
    assert "CRC does not match" in log.problems[0]


@pytest.mark.parametrize("width", [1, 3, 9])
@pytest.mark.parametrize("change_at", [0, 1, 60_000, 119_999])
def test_an_array_that_changes_once_in_a_long_log_comes_back(tmp_path: Path, width: int, change_at: int):
    n = 120_000  # several batches
    table = imu(n=4)
    columns = {path: np.repeat(values[:1], n, axis=0) for path, values in table.columns.items()}
    columns["header.stamp"] = columns["header.stamp"] + np.arange(n)
    columns["orientation_covariance"][change_at:, :width] = -0.0
    columns["angular_velocity.y"][change_at] = np.nan
    table = Table(
        "/imu/main", table.schema, columns, columns["header.stamp"], columns["header.stamp"], np.zeros(n, "u4")
    )
    write_log(tmp_path / "a.mcap", [table])
    found = read_log(tmp_path / "a.mcap").tables["/imu/main"]
    for path in columns.keys() - {"header.frame_id"}:
        assert np.ascontiguousarray(found.columns[path]).tobytes() == columns[path].tobytes(), path


def test_strings_that_differ_in_one_letter_only_are_told_apart(tmp_path: Path):
    table = imu()
    names = np.array(["imu_a"] * 199 + ["imu_b"], dtype=object)
    write_log(tmp_path / "a.mcap", [replace(table, columns={**table.columns, "header.frame_id": names})])
    assert read_log(tmp_path / "a.mcap").tables["/imu/main"].columns["header.frame_id"].tolist() == names.tolist()


def test_fields_side_by_side_are_one_block_and_others_are_not():
    text = (
        "V v\nfloat64[2] two\nfloat64 a\nfloat64 b\nfloat32 c\nbool d\nbool e\n===\nMSG: pkg/V\nfloat64 x\nfloat64 y\n"
    )
    layout = empty_layout(parse("pkg/Outer", text))
    found = [block.paths for block in blocks_of(layout, None)]
    assert found == [("v.x", "v.y"), ("two",), ("a", "b"), ("c",), ("d",), ("e",)]
    assert [block.paths for block in blocks_of(layout, {"a", "v"})] == [("v.x", "v.y"), ("a",)]
    assert blocks_of(layout, {"v.y"}) == [Block(("v.y",), Leaf("primitive", np.dtype("<f8"), 8))]


@pytest.mark.parametrize(
    ("path", "wanted", "expected"),
    [
        ("a.b.c", {"a"}, True),
        ("a.b.c", {"a.b.c"}, True),
        ("ab.c", {"a"}, False),
        ("a", {"a.b"}, False),
        ("a", (), False),
    ],
)
def test_a_path_is_wanted_by_itself_or_by_what_holds_it(path: str, wanted: set[str], expected: bool):
    assert is_wanted(path, wanted) is expected


@pytest.mark.parametrize("dtype", ["u1", "<f4", ">f8", "<f8"])
def test_rows_are_alike_when_their_bits_are(dtype: str):
    rows = np.zeros((50, 7), dtype)[:, 1:6]
    assert rows_alike(rows)
    for row in (0, 1, 49):
        changed = rows.copy()
        changed[row, 4] = 1
        assert not rows_alike(changed)
    if "f" in dtype:
        assert rows_alike(np.full((3, 2), np.nan, dtype))
        assert not rows_alike(np.array([[0.0], [-0.0]], dtype))


@pytest.mark.parametrize("count", [0, 10, 1 << 18])
def test_memory_is_writable_whatever_its_size(count: int):
    room = Room(Supply(), (count, 3), np.dtype(np.float64))
    for row in range(0, count, 1000):
        room.ready(min(row + 1000, count))
        room.values[row : row + 1000] = row
    expected = np.arange(count) // 1000 * 1000
    assert (room.values == expected[:, None]).all()


def test_a_supply_of_slow_huge_pages_turns_to_plain_ones(monkeypatch: pytest.MonkeyPatch):
    clock = iter(np.arange(0.0, 1000.0))  # a second between any two looks
    monkeypatch.setattr("schemas.wire.memory.time.thread_time", lambda: next(clock))
    supply, calls = Supply(), []
    pages = SimpleNamespace(madvise=lambda advice, start, size: calls.append(advice))
    for k in range(4):
        supply.provide(pages, k << 21, 1 << 21)
    assert calls[::2] == [14, 15, 15, 15]


def test_memory_that_cannot_be_had_ahead_is_left_to_the_first_touch():
    def refuse(*_: int) -> None:
        raise OSError

    supply = Supply()
    supply.provide(SimpleNamespace(madvise=refuse), 0, 1 << 21)
    assert not supply.helps
    assert Room(supply, (1 << 18, 3), np.dtype(np.float64)).values.shape == (1 << 18, 3)


def test_checksums_are_zlibs():
    data = np.random.default_rng(0).bytes(100_001)
    assert crc32(data) == zlib.crc32(data)
    assert crc32(data, 77) == zlib.crc32(data, 77)
    assert crc32(memoryview(b"")) == 0
