"""Faults of the machine around a sound log: files that cannot be read or written, links, a full disk."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.permissions import permissions_that_hold
from tests.pipeline.running import run_command

FULL = 50_000  # bytes that still fit


@pytest.fixture
def log(sound: bytes, tmp_path: Path) -> Path:
    path = tmp_path / "trial.mcap"
    path.write_bytes(sound)
    return path


@pytest.fixture(scope="module", autouse=True)
def compiled(sound: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Compiled code is cached in files of its own, before the disk is full."""
    path = tmp_path_factory.mktemp("compiled") / "trial.mcap"
    path.write_bytes(sound)
    assert run_command("run", path).status == 0


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


@contextmanager
def full_disk() -> Iterator[None]:
    """No file can grow beyond some bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (FULL, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("option", ["-o", "--rrd", "--parquet"])
def test_a_full_disk_leaves_nothing_behind_and_what_was_there_as_it_was(option: str, log: Path, out: Path) -> None:
    before = log.read_bytes()
    target = out / {"-o": "out.mcap", "--rrd": "out.rrd", "--parquet": "tables"}[option]
    if option != "--parquet":
        target.write_bytes(b"of old")
    with full_disk():
        told = run_command("run", log, option, target)
    assert told.status == 1
    assert told.err.count("\n") == 1
    assert target.name in told.err
    assert "internal" not in told.err
    assert log.read_bytes() == before
    left = [path for path in out.rglob("*") if path.is_file()]
    assert [(path.name, path.read_bytes()) for path in left] == (
        [] if option == "--parquet" else [(target.name, b"of old")]
    )


def test_a_loop_of_links_is_told(log: Path, out: Path) -> None:
    one, other = out / "one.mcap", out / "other.mcap"
    one.symlink_to(other)
    other.symlink_to(one)
    for arguments in (("run", one), ("info", one)):
        told = run_command(*arguments)
        assert told.status == 1
        assert told.err.count("\n") == 1
        assert "one.mcap" in told.err


def test_a_link_to_the_input_is_no_target(log: Path, out: Path) -> None:
    before = log.read_bytes()
    (out / "link.mcap").symlink_to(log)
    assert run_command("run", log, "-o", out / "link.mcap").status == 1
    assert log.read_bytes() == before


def test_a_log_that_may_not_be_read_and_a_folder_that_may_not_be_written_are_told(log: Path, out: Path) -> None:
    out.chmod(0o500)
    with permissions_that_hold():
        told = run_command("run", log, "-o", out / "out.mcap")
    out.chmod(0o700)
    assert (told.status, "ermission" in told.err) == (1, True)
    log.chmod(0)
    with permissions_that_hold():
        told = run_command("run", log, "-o", out / "out.mcap")
    log.chmod(0o600)
    assert (told.status, "ermission" in told.err) == (1, True)
    assert not list(out.iterdir())
