"""What the tests of archives share: voyages and what a batch made of them, once a session however many processes test;
a scheduler with workers; a server that speaks S3."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.pipeline.archive import voyages
from tests.pipeline.archive.processes import Cluster
from tests.pipeline.running import run_command


def once(base: Path, name: str, make: Callable[[Path], None]) -> Path:
    """A folder that the first process makes and the others find."""
    folder = base / name
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            work = base / f"{name}.making"
            work.mkdir()
            make(work)
            work.rename(folder)
    return folder


@pytest.fixture(scope="session")
def shared(tmp_path_factory) -> Path:
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session")
def fleet(shared) -> Path:
    """Forty sound voyages over ten months, and six bad logs; not to be changed."""

    def make(folder: Path) -> None:
        voyages.make_voyages(folder)
        voyages.damage(folder)

    return once(shared, "fleet", make)


@pytest.fixture(scope="session")
def done(fleet, shared) -> Path:
    """``out``, the archive of the fleet; ``told.json``, what batch said; ``said``, its lines. Not to be changed."""

    def make(folder: Path) -> None:
        out = shared / "done-out"
        told = run_command("batch", fleet, "-o", out, *voyages.CHEAP, "--workers", "2", "--json")
        (folder / "told.json").write_text(told.out)
        (folder / "said").write_text(told.err)
        (folder / "status").write_text(str(told.status))
        out.rename(folder / "out")

    return once(shared, "done", make)


@pytest.fixture
def few(fleet, tmp_path) -> Path:
    """Six voyages of one's own."""
    folder = tmp_path / "few"
    folder.mkdir()
    for path in sorted(fleet.glob("month-*/*-0.mcap"))[:6]:
        shutil.copy2(path, folder)
    return folder


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Iterator[Cluster]:
    """A real scheduler and two real workers, processes of their own."""
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.stop()
