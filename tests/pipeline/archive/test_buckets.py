"""Inputs and outputs in a bucket: real servers of this machine that speak S3 and GCS, real requests."""

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from socketserver import BaseServer
from typing import Any

import pytest

from pipeline.archive.remote import file_system
from tests.pipeline.archive.voyages import CHEAP

pytest.importorskip("s3fs")


def pointed_at(address: str, patch: pytest.MonkeyPatch) -> None:
    """Let every process that is started from now on, and this one, find S3 there."""
    stated = {"AWS_ENDPOINT_URL": address, "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test",
              "AWS_DEFAULT_REGION": "us-east-1", "AWS_MAX_ATTEMPTS": "1"}  # fmt: skip
    for name, value in stated.items():
        patch.setenv(name, value)
    file_system("s3://").clear_instance_cache()


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@contextmanager
def s3(patch: pytest.MonkeyPatch) -> Iterator[None]:
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    pointed_at("http://{}:{}".format(*server.get_host_and_port()), patch)
    yield
    server.stop()


@contextmanager
def gs(patch: pytest.MonkeyPatch) -> Iterator[None]:
    create_server = pytest.importorskip("gcp_storage_emulator.server").create_server
    port = free_port()
    # A client that hangs up early is told of on standard error, which is the command's here.
    patch.setattr(BaseServer, "handle_error", lambda *_: None)
    patch.setenv("STORAGE_EMULATOR_HOST", f"http://127.0.0.1:{port}")
    with create_server("127.0.0.1", port, in_memory=True):
        file_system("gs://").clear_instance_cache()
        yield


SERVERS = {"s3": s3, "gs": gs}


@contextmanager
def filled(protocol: str, fleet: Path) -> Iterator[Any]:
    """A server with two voyages, a bad log and a note in ``voyages/2026``, and an empty bucket."""
    with pytest.MonkeyPatch.context() as patch, SERVERS[protocol](patch):
        fs = file_system(f"{protocol}://")
        for name in ("voyages", "results"):
            fs.mkdir(name)
        for source, name in (
            (fleet / "month-00" / "voyage 00-0.mcap", "a b.mcap"),
            (fleet / "month-01" / "voyage 01-0.mcap", "deep/c [1] #2?.mcap"),
            (fleet / "bad" / "no_sub.mcap", "bad.mcap"),
            (fleet / "bad" / "not_mcap.mcap", "note.txt"),
        ):
            fs.put_file(str(source), f"voyages/2026/{name}")
        yield fs


@pytest.fixture(scope="module", params=list(SERVERS))
def bucket(request, fleet):
    with filled(request.param, fleet) as fs:
        yield fs


@pytest.fixture
def protocol(request) -> str:
    return str(request.node.callspec.params["bucket"])


def test_an_archive_from_bucket_to_bucket(bucket, protocol, fleet, deckflex):
    words = (
        "batch",
        f"{protocol}://voyages/2026",
        "-o",
        f"{protocol}://results/2026",
        *CHEAP,
        "--workers",
        "1",
        "--json",
    )
    told = deckflex(*words)
    document = json.loads(told.out)
    assert (document["logs"], document["done"], document["failed"]) == (3, 2, [])
    assert document["set_aside"][0]["name"] == "bad.mcap"
    assert told.status == 1
    held = sorted(bucket.find("results/2026"))
    assert sum("/manifest/" in name for name in held) == 3
    estimates = [name for name in held if "/results/" in name]
    assert len(estimates) == 2
    assert all(bucket.cat_file(name)[-8:] == b"\x89MCAP0\r\n" for name in estimates)

    again = json.loads(deckflex(*words).out)
    assert (again["done"], again["done_before"], len(again["set_aside"]), again["workers"]) == (0, 2, 1, 0)
    assert sorted(bucket.find("results/2026")) == held

    bucket.put_file(str(fleet / "month-02" / "voyage 02-0.mcap"), "voyages/2026/bad.mcap")
    plan = json.loads(deckflex(*words[:-1], "--dry-run", "--json").out)
    assert plan["to_do"] == [f"{protocol}://voyages/2026/bad.mcap"]
    for word in ("**/c*.mcap", "2026/deep/c [1] #2?.mcap"):
        listed = json.loads(deckflex("batch", f"{protocol}://voyages/{word}", *words[2:-1], "--dry-run", "--json").out)
        assert (listed["logs"], listed["done_before"]) == (1, 1)

    catalogue = json.loads(deckflex("catalogue", f"{protocol}://results/2026", "--json").out)
    assert catalogue["logs"] == 2
    assert bucket.exists("results/2026/catalogue.parquet")


def test_what_stands_against_a_bucket_is_said_in_a_line(bucket, protocol, deckflex, tmp_path):
    missing = deckflex("batch", f"{protocol}://nowhere/x", "-o", tmp_path / "out")
    assert missing.status == 1
    assert f"{protocol}://nowhere/x" in missing.err
    assert missing.err.count("\n") == 1
    words = ("batch", f"{protocol}://voyages/2026", "-o", f"{protocol}://nowhere/out", *CHEAP, "--workers", "1")
    unwritten = deckflex(*words)
    assert unwritten.status == 1
    assert "cannot be written" in unwritten.err.splitlines()[-1]


def test_the_server_is_gone(monkeypatch, deckflex, tmp_path):
    pointed_at(f"http://127.0.0.1:{free_port()}", monkeypatch)
    told = deckflex("batch", "s3://voyages/2026", "-o", tmp_path / "out")
    assert told.status == 1
    assert "cannot be read" in told.err
    assert told.err.count("\n") == 1
