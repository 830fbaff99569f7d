"""One short simulated log for all faults, made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from schemas.wire import Table, read_log, write_log
from tests.faults.corpus import CHUNK
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


@pytest.fixture(scope="session")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Table]:
    folder = tmp_path_factory.mktemp("faults")
    (folder / "twin.toml").write_text(TWIN)
    assert run_command("simulate", folder / "twin.toml", "-o", folder / "log.mcap").status == 0
    return dict(read_log(folder / "log.mcap").tables)


@pytest.fixture(scope="session")
def sound(tables: dict[str, Table], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path: Path = tmp_path_factory.mktemp("faults") / "sound.mcap"
    write_log(path, list(tables.values()), chunk_bytes=CHUNK)
    return path.read_bytes()
