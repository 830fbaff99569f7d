"""Every fault of the corpus through the command line: its outcome, and what holds whatever happens."""

from __future__ import annotations

from pathlib import Path

import pytest

from schemas.wire import Table, read_log, write_log
from tests.faults.corpus import Damaged, Fault
from tests.faults.outcomes import Refused, assert_answered, assert_refused, run
from tests.pipeline.running import run_command

TWIN = """
name = "faults"
[run]
duration = 60.0
rate = 50.0
seed = 5
[ship]
latitude = 43.0
heading = 30.0
speed = 15.0
[sea]
model = "spectrum"
pitch_significant = 2.0
roll_significant = 5.0
heading_significant = 2.0
heave_significant = 0.6
[mount]
static_arcmin = [12.0, -20.0, 30.0]
lever_arm = [3.0, 25.0, 4.0]
time_delay = 0.004
[flexure]
damping = [0.2, 0.15, 0.15]
frequency = [0.6, 0.45, 0.4]
std_arcmin = [3.0, 2.5, 4.0]
"""
CHUNK = 100_000  # bytes: some tens of chunks


@pytest.fixture(scope="session")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Table]:
    folder = tmp_path_factory.mktemp("faults")
    (folder / "twin.toml").write_text(TWIN)
    assert run_command("simulate", folder / "twin.toml", "-o", folder / "log.mcap").status == 0
    return dict(read_log(folder / "log.mcap").tables)


@pytest.fixture(scope="session")
def sound(tables: dict[str, Table], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("faults") / "sound.mcap"
    write_log(path, list(tables.values()), chunk_bytes=CHUNK)
    return path.read_bytes()


def damaged(damage: Damaged, tables: dict[str, Table], sound: bytes, path: Path) -> None:
    if damage.bytes is not None:
        path.write_bytes(damage.bytes(sound))
    else:
        assert damage.channels is not None
        mutable = dict(tables)
        damage.channels(mutable)
        write_log(path, list(mutable.values()), chunk_bytes=CHUNK)


@pytest.mark.parametrize("fault", Fault, ids=lambda fault: fault.name)
def test_the_fault_has_its_outcome(fault: Fault, tables: dict[str, Table], sound: bytes, tmp_path: Path) -> None:
    damage, outcome = fault.value
    path, out = tmp_path / "trial.mcap", tmp_path / "out"
    out.mkdir()
    damaged(damage, tables, sound, path)
    before = path.read_bytes()
    told = run(path, out / "out.mcap")
    assert path.read_bytes() == before
    if isinstance(outcome, Refused):
        assert_refused(told, outcome, path, out)
    else:
        assert_answered(told, outcome, out, tables["/truth/deformation"])
