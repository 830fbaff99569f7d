"""Killed for real: the whole process, a worker, the scheduler. What is finished stays, the next run goes on."""

import json
import os
import signal
from contextlib import suppress
from pathlib import Path

import pytest

from tests.pipeline.archive.processes import PATIENCE, check_whole, entries, started, until
from tests.pipeline.archive.voyages import CHEAP, digest


def gone(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def test_a_killed_batch_loses_nothing_that_was_finished(few, cluster, tmp_path, deckflex):
    out = tmp_path / "out"
    process = started("batch", few, "-o", out, *CHEAP, "--workers", "1", folder=tmp_path)
    until(lambda: entries(out), "first result")
    process.kill()  # its worker must notice by itself
    process.wait()
    until(lambda: gone(process.pid), "end of its worker")
    finished = entries(out)
    assert 1 <= len(finished) < 6
    check_whole(out)
    before = digest(out)
    told = json.loads(deckflex("batch", few, "-o", out, *CHEAP, "--scheduler", cluster.address, "--json").out)
    assert (told["done"], told["done_before"] + told["same_content"]) == (6 - len(finished), len(finished))
    check_whole(out)
    after = digest(out)
    assert len(entries(out)) == 6
    kept = [name for name in before if name.startswith("manifest")]
    assert all(after[name] == before[name] for name in kept)
    assert not [name for name in after if name.startswith(".partial")]


def workers_of(group: int) -> list[int]:
    """Processes of a batch that do the work."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            same = os.getpgid(int(process.name)) == group
            found += [int(process.name)] if same and b"spawn_main" in (process / "cmdline").read_bytes() else []
    return found


def test_a_worker_that_is_killed_is_replaced(few, tmp_path):
    if not Path("/proc/self/cmdline").exists():
        pytest.skip("workers are found in /proc")
    out = tmp_path / "out"
    process = started("batch", few, "-o", out, *CHEAP, "--workers", "1", folder=tmp_path)
    until(lambda: entries(out), "first result")
    for worker in workers_of(process.pid):
        os.kill(worker, signal.SIGKILL)
    assert process.wait(PATIENCE) == 0, (tmp_path / "err.txt").read_text()
    assert len(entries(out)) == 6
    check_whole(out)
    assert "6 logs: " in (tmp_path / "out.txt").read_text()


def test_a_cluster_loses_a_worker_and_then_its_scheduler(few, cluster, tmp_path, deckflex):
    out = tmp_path / "out"
    first = started("batch", few, "-o", out, *CHEAP, "--scheduler", cluster.address, folder=tmp_path)
    until(lambda: entries(out), "first result")
    cluster.workers[0].kill()
    assert first.wait(PATIENCE) == 0, (tmp_path / "err.txt").read_text()
    assert len(entries(out)) == 6
    check_whole(out)
    said = (tmp_path / "out.txt").read_text()
    assert "6 logs: 6 done" in said or "6 logs: 5 done, 1 done before" in said  # it may have died just after its result

    second = started(
        "batch", few, "-o", out, *CHEAP, "--keep", "nothing", "--scheduler", cluster.address, folder=tmp_path
    )
    until(lambda: len(entries(out)) > 6, "first result of other options")
    cluster.scheduler.kill()
    assert second.wait(PATIENCE) == 1
    said = (tmp_path / "err.txt").read_text()
    assert "the connection to the scheduler was lost" in said
    assert "Traceback" not in said
    check_whole(out)
    plan = json.loads(deckflex("batch", few, "-o", out, *CHEAP, "--keep", "nothing", "--dry-run", "--json").out)
    assert len(plan["to_do"]) <= 12 - len(entries(out)) + 1
    nobody = deckflex(
        "batch", few, "-o", out, *CHEAP, "--keep", "nothing", "--scheduler", "tcp://127.0.0.1:9", "--json"
    )
    assert nobody.status == 1
    assert "no scheduler answers at tcp://127.0.0.1:9" in nobody.err
