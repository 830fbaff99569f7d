"""The short way gives, bit for bit, what the long way gives: tables, counts, times and what is said of damage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

from schemas.wire import Log, Table, read_log, reader, write_log
from schemas.wire.container import File, outline
from schemas.wire.one_pass import Pass
from schemas.wire.shortcut import Shortcut
from schemas.wire.tables import Tables
from tests.schemas.random_messages import Sample, samples
from tests.schemas.sample_logs import EPOCH, imu, score, small_log

CONFORMANCE = sorted((Path(__file__).parents[2].parent / "shared" / "mcap-conformance").glob("*/*.mcap"))
FIELDS = ["builtin_interfaces/Time stamp", "bool flag", "bool[3] flags", "int16 x", "float32[3] y", "uint8[5] z"]
TIME = ["=" * 80, "MSG: builtin_interfaces/Time", "int32 sec", "uint32 nanosec", ""]
ODD = "\n".join([*FIELDS, "string name", "int64 w", *TIME])
Message = tuple[str, int, bytes]  # topic, log time, payload


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Log]:
    """Reads a log both ways, holds one against the other and gives what the short way gave."""

    def read(path: Path, **options: object) -> Log:
        monkeypatch.setattr(reader, "LONG", 1 << 62)
        long = read_log(path, **options)  # type: ignore[arg-type]
        monkeypatch.setattr(reader, "LONG", 0)
        short = read_log(path, **options)  # type: ignore[arg-type]
        assert_alike(short, long)
        return short

    return read


def assert_alike(one: Log, other: Log) -> None:
    assert (one.problems, one.channels, one.start, one.end) == (other.problems, other.channels, other.start, other.end)
    assert list(one.tables) == list(other.tables)
    for topic, table in one.tables.items():
        expected = other.tables[topic]
        assert (table.schema, table.fields, list(table.columns)) == (
            expected.schema, expected.fields, list(expected.columns)
        )  # fmt: skip
        for name in ("log_time", "publish_time", "sequence"):
            assert np.array_equal(getattr(table, name), getattr(expected, name)), (topic, name)
        for name, values in table.columns.items():
            assert_bits(values, expected.columns[name])


def assert_bits(one: np.ndarray, other: np.ndarray) -> None:
    assert (one.dtype, one.shape) == (other.dtype, other.shape)
    if one.dtype != object:
        assert one.tobytes() == other.tobytes()
    for a, b in zip(one, other, strict=True) if one.dtype == object else ():
        if isinstance(a, np.ndarray):
            assert_bits(a, b)
        else:
            assert a == b


def write(
    path: Path, text: str, messages: Sequence[Message], chunk: int = 300, index: IndexType = IndexType.ALL
) -> None:
    """Messages of one definition, chunked."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk, compression=CompressionType.NONE, index_types=index)
        writer.start("ros2", "test")
        schema = writer.register_schema("pkg/msg/Outer", "ros2msg", text.encode())
        ids: dict[str, int] = {}
        for k, (topic, time, payload) in enumerate(messages):
            if topic not in ids:
                ids[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(ids[topic], time, payload, time, k)
        writer.finish()


def lanes(path: Path) -> set[str]:
    """Topics that went the short way to the end."""
    tables = Tables(None, {})
    shortcut = Shortcut(tables.plan)
    with File(path) as file:
        pass_ = Pass(file, outline(file), tables.add, tables.expect, None, shortcut)
        pass_.run(None)
    return {pass_.channels[lane.channel].topic for lane in shortcut.lanes}


def test_columns_grow_where_no_index_tells_how_long_they_become(both, tmp_path: Path):
    rng = np.random.default_rng(8)
    payloads = [odd(rng, b"abc") for _ in range(700)]
    messages = [(f"/{k % 3 and 1}", EPOCH + k, one) for k, one in enumerate(payloads)]
    write(tmp_path / "a.mcap", ODD, messages, 5_000, IndexType.NONE)
    log = both(tmp_path / "a.mcap")
    assert lanes(tmp_path / "a.mcap") == {"/0", "/1"}
    assert sum(map(len, log.tables.values())) == 700


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_logs_of_our_own_are_read_alike(both, tmp_path: Path, compression: str):
    tables = small_log(tmp_path / "a.mcap", compression)
    log = both(tmp_path / "a.mcap")
    assert sum(map(len, log.tables.values())) == sum(map(len, tables))
    assert lanes(tmp_path / "a.mcap") == {"/imu/main", "/imu/sub"}, "texts of varying length go the long way"


def test_what_was_alike_and_begins_to_vary_is_kept(both, tmp_path: Path):
    table = imu(n=400)
    constant = np.tile(np.arange(9.0), (400, 1))
    constant[250] += 1.0
    table.columns["orientation_covariance"] = constant
    table.columns["header.frame_id"] = np.array(["imu"] * 333 + ["umi"] * 67, dtype=object)
    table.columns["angular_velocity.y"] = np.where(np.arange(400) < 200, 0.0, -0.0)
    write_log(tmp_path / "a.mcap", [table], chunk_bytes=5_000)
    log = both(tmp_path / "a.mcap")
    assert np.array_equal(log.tables["/imu/main"].columns["orientation_covariance"], constant)
    assert list(log.tables["/imu/main"].columns["header.frame_id"][[332, 333]]) == ["imu", "umi"]
    assert np.signbit(log.tables["/imu/main"].columns["angular_velocity.y"]).sum() == 200


def test_topics_and_columns_that_nobody_asked_for_change_nothing(both, tmp_path: Path):
    small_log(tmp_path / "a.mcap")
    log = both(tmp_path / "a.mcap", topics=["/imu/sub"], columns={"/imu/sub": {"angular_velocity"}})
    assert set(log.tables) == {"/imu/sub"}
    assert len(log.tables["/imu/sub"].columns) == 3


def odd(rng: np.random.Generator, name: bytes) -> bytes:
    """A message of random bytes but for the length of its name."""
    fixed = rng.integers(0, 256, 8 + 1 + 3 + 2 + 2 + 12 + 5 + 3, np.uint8).tobytes()
    text = (len(name) + 1).to_bytes(4, "little") + name + b"\0"
    return b"\0\1\0\0" + fixed + text + bytes(-(len(fixed) + len(text)) % 8) + rng.bytes(8)


def test_booleans_small_numbers_and_stamps_before_1970(both, tmp_path: Path):
    rng = np.random.default_rng(3)
    write(tmp_path / "a.mcap", ODD, [("/odd", EPOCH + k, odd(rng, b"abc")) for k in range(100)])
    log = both(tmp_path / "a.mcap")
    table = log.tables["/odd"]
    assert log.problems == ()
    assert lanes(tmp_path / "a.mcap") == {"/odd"}
    assert (table.columns["stamp"] < 0).any()
    assert table.columns["flags"].dtype == np.bool_


def test_lengths_that_change_and_messages_that_are_cut_short(both, tmp_path: Path):
    rng = np.random.default_rng(4)
    names = [b"abc"] * 20 + [b"abcdefgh"] * 20 + [b"abd"] * 20 + [b"abc", b"abcd"] * 10 + [b"abc"] * 20
    messages = [("/odd", EPOCH + k, odd(rng, name)) for k, name in enumerate(names)]
    messages[30] = ("/odd", EPOCH + 30, messages[30][2][:20])
    messages[70] = ("/odd", 2**63 + 5, messages[70][2])
    write(tmp_path / "a.mcap", ODD, messages)
    log = both(tmp_path / "a.mcap")
    assert len(log.tables["/odd"]) == len(messages) - 2
    assert len(log.problems) == 2


def test_a_channel_that_begins_with_messages_cut_short(both, tmp_path: Path):
    rng = np.random.default_rng(7)
    sound = [odd(rng, b"abc") for _ in range(40)]
    write(tmp_path / "a.mcap", ODD, [("/odd", EPOCH + k, one[: 20 if k < 12 else None]) for k, one in enumerate(sound)])
    log = both(tmp_path / "a.mcap")
    assert len(log.tables["/odd"]) == 28


def records(path: Path, build: Callable[[Writer], None]) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=300, compression=CompressionType.NONE)
        writer.start("ros2", "test")
        build(writer)
        writer.finish()


def test_two_channels_of_one_topic_share_a_table(both, tmp_path: Path):
    rng = np.random.default_rng(5)

    def build(writer: Writer) -> None:
        schema = writer.register_schema("pkg/msg/Odd", "ros2msg", ODD.encode())
        ids = [writer.register_channel("/odd", "cdr", schema, {"k": str(k)}) for k in range(2)]
        for k in range(60):
            writer.add_message(ids[int(k > 20 and k % 2)], EPOCH + k, odd(rng, b"abc"), EPOCH + k, k)

    records(tmp_path / "a.mcap", build)
    log = read_both_orders(both, tmp_path / "a.mcap")
    assert len(log.tables["/odd"]) == 60


def read_both_orders(both: Callable[..., Log], path: Path) -> Log:
    """Rows of two channels in one batch come channel by channel, so that their order is not the same: sorted here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader, "LONG", 1 << 62)
        long = read_log(path).tables["/odd"]
        patch.setattr(reader, "LONG", 0)
        log = read_log(path)
    short = log.tables["/odd"]
    a, b = np.argsort(long.sequence), np.argsort(short.sequence)
    assert np.array_equal(long.log_time[a], short.log_time[b])
    for name in long.columns:
        assert_bits(long.columns[name][a], short.columns[name][b])
    return log


@pytest.mark.skipif(not CONFORMANCE, reason="the official conformance files are not beside the repository")
def test_the_official_conformance_files_are_read_alike(both):
    for path in CONFORMANCE:
        both(path)


def test_damage_is_told_alike(both, tmp_path: Path):
    small_log(tmp_path / "a.mcap", "none", 4_000)
    data = (tmp_path / "a.mcap").read_bytes()
    rng = np.random.default_rng(6)
    for k in range(30):
        damaged = bytearray(data[: rng.integers(len(data) // 2, len(data))] if k % 3 == 0 else data)
        for place in rng.integers(100, len(damaged), 4):
            damaged[place] ^= int(rng.integers(1, 256))
        (tmp_path / "b.mcap").write_bytes(damaged)
        both(tmp_path / "b.mcap")


@st.composite
def logs(draw: st.DrawFn) -> tuple[Sample, list[Message]]:
    """Messages of a random type, repeated in any order on three topics, some of them big-endian or cut short."""
    sample = draw(samples())
    pool = [*sample.payloads("<"), *sample.payloads("<"), *sample.payloads(">")]
    pool.append(pool[0][: draw(st.integers(0, len(pool[0])))])
    runs = draw(st.lists(st.tuples(st.sampled_from(pool), st.integers(0, 2), st.integers(1, 12)), max_size=12))
    many = [(f"/{topic}", payload) for payload, topic, count in runs for _ in range(count)]
    return sample, [(topic, EPOCH + k, payload) for k, (topic, payload) in enumerate(many)]


@settings(
    max_examples=40, deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
@given(logs())
def test_random_messages_are_read_alike(both, tmp_path: Path, case: tuple[Sample, list[Message]]):
    sample, messages = case
    write(tmp_path / "a.mcap", sample.text, messages)
    both(tmp_path / "a.mcap")


def test_a_table_of_one_message_a_chunk(both, tmp_path: Path):
    tables: list[Table] = [imu(n=30), score(5)]
    write_log(tmp_path / "a.mcap", tables, chunk_bytes=10)
    assert len(both(tmp_path / "a.mcap").tables["/imu/main"]) == 30
