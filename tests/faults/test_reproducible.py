"""The same log, options and version give the same bytes, whatever the process's hashing of strings."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_a_run_gives_the_same_bytes_in_any_process(sound: bytes, tmp_path: Path) -> None:
    log = tmp_path / "trial.mcap"
    log.write_bytes(sound)
    code = "import sys; from pipeline.cli import main; main(sys.argv[1:])"
    for name, seed in (("here", "1"), ("elsewhere", "7")):
        folder = tmp_path / name
        folder.mkdir()
        arguments = ["run", log, "-o", folder / "out.mcap", "--parquet", folder / "tables"]
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", code, *map(str, arguments)]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    here, elsewhere = (
        {path.name: path.read_bytes() for path in (tmp_path / name).rglob("*") if path.is_file()}
        for name in ("here", "elsewhere")
    )
    assert here.keys() == elsewhere.keys() >= {"out.mcap", "trial.deformation.parquet"}
    assert [name for name in here if here[name] != elsewhere[name]] == []
