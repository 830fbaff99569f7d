"""Bad logs through the command line: one line and status 1, or a warning where the rest is still good.

Whatever happens: no traceback, the input as it was, nothing half-written.
"""

import json
import os
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from schemas.wire import Table, read_log, write_log
from tests.permissions import permissions_that_hold

Tables = dict[str, Table]
Mutation = Callable[[Tables], Tables]


def column(topic: str, prefix: str, change: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Mutation:
    """Change x, y, z of a vector of one channel; change takes values and seconds since the start."""

    def mutate(tables: Tables) -> Tables:
        table = tables[topic]
        t = (table.columns["header.stamp"] - table.columns["header.stamp"][0]) * 1e-9
        columns = {name: change(v, t) if name.startswith(prefix) else v for name, v in table.columns.items()}
        return tables | {topic: replace(table, columns=columns)}

    return mutate


def rows(table: Table, keep: np.ndarray) -> Table:
    columns = {name: values[keep] for name, values in table.columns.items()}
    return replace(
        table, columns=columns, log_time=table.log_time[keep], publish_time=table.publish_time[keep],
        sequence=table.sequence[keep],
    )  # fmt: skip


def without(*topics: str) -> Mutation:
    return lambda tables: {topic: table for topic, table in tables.items() if topic not in topics}


def unknown_schema(tables: Tables) -> Tables:
    return tables | {"/imu/sub": replace(tables["/imu/main/temperature"], topic="/imu/sub")}


def first_seconds(seconds: float) -> Mutation:
    def mutate(tables: Tables) -> Tables:
        start = min(int(table.log_time[0]) for table in tables.values())
        return {topic: rows(table, table.log_time < start + seconds * 1e9) for topic, table in tables.items()}

    return mutate


def stamps_jump_back(tables: Tables) -> Tables:
    table = tables["/imu/main"]
    stamp = table.columns["header.stamp"].copy()
    stamp[len(stamp) // 2 :] -= 20_000_000_000
    return tables | {"/imu/main": replace(table, columns=dict(table.columns) | {"header.stamp": stamp})}


AT_REST = """
[run]
duration = 60.0
[ship]
speed = 0.0
[sea]
pitch = []
roll = []
heading = []
[flexure]
std_arcmin = [0.01, 0.01, 0.01]
"""


REFUSED: dict[str, tuple[Mutation, str]] = {
    "no sub-IMU": (without("/imu/sub"), "/imu/sub"),
    "no IMU at all": (without("/imu/main", "/imu/sub"), "/imu/main"),
    "unknown schema": (unknown_schema, "/imu/sub"),
    "gyro in deg/s": (column("/imu/sub", "angular_velocity.", lambda v, t: v * 180 / np.pi), "/imu/sub"),
    "acceleration in g": (column("/imu/main", "linear_acceleration.", lambda v, t: v / 9.80665), "/imu/main"),
    "constant gyro": (column("/imu/sub", "angular_velocity.", lambda v, t: np.full_like(v, v[0])), "/imu/sub"),
    "gyro all NaN": (column("/imu/main", "angular_velocity.", lambda v, t: v * np.nan), "/imu/main"),
    "three seconds": (first_seconds(3.0), "/imu/"),
}
WARNED: dict[str, tuple[Mutation, str]] = {
    "some NaN": (
        column("/imu/main", "angular_velocity.", lambda v, t: np.where(abs(t - 50) < 1, np.nan, v)),
        "/imu/main",
    ),
    "stamps jump back": (stamps_jump_back, "/imu/main"),
    "dead PHINS": (column("/phins/sub", "orientation.", lambda v, t: v * 0.0), "/phins/sub"),
    "sled stands still": (
        column("/sliding/odom", "", lambda v, t: np.full_like(v, v[0]) if v.dtype == float else v),
        "deck",
    ),
}


@pytest.fixture(scope="module")
def tables(sample) -> Tables:
    return dict(read_log(sample).tables)


@pytest.fixture
def spoilt(tables, tmp_path):
    def make(mutation: Mutation):
        path = tmp_path / "spoilt.mcap"
        write_log(path, list(mutation(tables).values()))
        return path

    return make


def assert_refused(told, path, out, reason):
    assert told.status == 1, told.out
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert str(path) in told.err
    assert reason in told.err
    assert "internal error" not in told.err
    assert not list(out.iterdir())


@pytest.fixture
def out(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


@pytest.mark.parametrize("name", REFUSED)
def test_a_log_that_cannot_be_run_is_refused_in_one_line(deckflex, spoilt, out, name):
    mutation, reason = REFUSED[name]
    path = spoilt(mutation)
    before = path.read_bytes()
    told = deckflex("run", path, "-o", out / "out.mcap", "--rrd", out / "out.rrd", "--json")
    assert_refused(told, path, out, reason)
    assert path.read_bytes() == before


@pytest.mark.parametrize("name", WARNED)
def test_what_is_odd_but_not_fatal_is_a_warning(deckflex, spoilt, out, name):
    mutation, reason = WARNED[name]
    told = deckflex("run", spoilt(mutation), "-o", out / "out.mcap", "--json")
    assert told.status == 0, told.err
    document = json.loads(told.out)
    assert any(reason in warning for warning in document["warnings"]), document["warnings"]
    assert np.all(np.array(document["rmse_arcmin"]["truth"]) < [3.0, 3.0, 8.0])


def test_a_calm_sea_is_refused_or_told(deckflex, tmp_path, out):
    twin, path = tmp_path / "calm.toml", tmp_path / "calm.mcap"
    twin.write_text(AT_REST)
    assert deckflex("simulate", twin, "-o", path).status == 0
    told = deckflex("run", path, "--json")
    if told.status == 0:
        assert any("calm sea" in warning for warning in json.loads(told.out)["warnings"])
    else:
        assert_refused(told, path, out, "")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "empty"),
        (b"time,gyro\n1,2\n" * 100, "MCAP"),
        (b"\x89MCAP0\r\n", ""),
        (b"\x89MCAP0\r\n" + b"\xff" * 200, ""),
    ],
)
@pytest.mark.parametrize("command", ["run", "info", "compare"])
def test_a_file_that_is_no_log_is_refused(deckflex, tmp_path, out, command, content, reason):
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    more = {"run": ["-o", out / "out.mcap"], "compare": ["--estimator", "smoother"], "info": []}[command]
    told = deckflex(command, path, *more)
    if command == "info" and told.status == 0:
        assert "problem" in told.out
        return
    assert_refused(told, path, out, reason)
    assert path.read_bytes() == content


def test_half_a_log_gives_half_the_answer_and_says_what_was_lost(deckflex, sample, tmp_path, out):
    path = tmp_path / "half.mcap"
    path.write_bytes(sample.read_bytes()[: sample.stat().st_size * 6 // 10])
    told = deckflex("run", path, "-o", out / "out.mcap", "--json")
    assert told.status == 0, told.err
    document = json.loads(told.out)
    assert 50 < document["duration_s"] < 90
    assert document["warnings"]


def test_a_missing_file_and_a_directory_are_told_by_name(deckflex, tmp_path, out):
    for command, path in (
        ("run", tmp_path / "absent.mcap"),
        ("info", tmp_path / "absent.mcap"),
        ("run", out),
        ("view", out),
    ):
        assert_refused(deckflex(command, path), path, out, "")


def test_files_without_permission_are_told_by_name(deckflex, sample, tmp_path, out):
    closed = tmp_path / "closed.mcap"
    closed.write_bytes(sample.read_bytes())
    closed.chmod(0)
    with permissions_that_hold():
        told = deckflex("run", closed)
    assert_refused(told, closed, out, "ermission")
    out.chmod(0o500)
    with permissions_that_hold():
        told = deckflex("run", sample, "-o", out / "a.mcap")
    assert_refused(told, out / "a.mcap", out, "ermission")


def test_an_input_is_not_overwritten_and_a_directory_is_no_target(deckflex, sample, out):
    before = sample.read_bytes()
    for target in (sample, out, out / "nowhere" / "a.mcap"):
        told = deckflex("run", sample, "-o", target)
        assert told.status == 1
        assert str(target) in told.err
        assert told.err.count("\n") == 1
    assert sample.read_bytes() == before
    assert not list(out.iterdir())


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")  # noqa: PTH110
def test_a_device_is_not_replaced(deckflex, sample):
    told = deckflex("run", sample, "-o", "/dev/full")
    assert told.status == 1
    assert "ordinary file" in told.err
    assert os.path.exists("/dev/full")  # noqa: PTH110


@pytest.mark.parametrize(("text", "reason"), [("[main]\ntopik = 'a'\n", "topik"), ("[main", "TOML"), ("", None)])
def test_a_bad_rig_profile_is_refused_with_the_key(deckflex, sample, tmp_path, out, text, reason):
    rig = tmp_path / "rig.toml"
    rig.write_text(text)
    told = deckflex("info", sample, "--rig", rig)
    if reason is None:
        assert told.status == 0
    else:
        assert_refused(told, rig, out, reason)


@pytest.mark.parametrize(("text", "reason"), [("[run]\nduraton = 1.0\n", "duraton"), ("[sea", "TOML")])
def test_a_bad_twin_is_refused_with_the_key(deckflex, tmp_path, out, text, reason):
    twin = tmp_path / "twin.toml"
    twin.write_text(text)
    assert_refused(deckflex("simulate", twin, "-o", out / "a.mcap"), twin, out, reason)


def test_a_twin_is_not_overwritten_by_its_log(deckflex, tmp_path):
    twin = tmp_path / "twin.toml"
    twin.write_text("[run]\nduration = 10.0\n")
    assert deckflex("simulate", twin, "-o", twin).status == 1
    assert twin.read_text() == "[run]\nduration = 10.0\n"


def test_simulate_does_not_overwrite_what_was_not_named(deckflex, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "idam.mcap").write_text("a real log")
    told = deckflex("simulate", "idam", "--duration", "10")
    assert told.status == 1
    assert (tmp_path / "idam.mcap").read_text() == "a real log"
