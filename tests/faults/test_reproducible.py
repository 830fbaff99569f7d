"""The same log, options and version give the same bytes, whatever the process's hashing of strings."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.pipeline.running import run_command


def test_a_run_gives_the_same_bytes_in_any_process(sound: bytes, tmp_path: Path) -> None:
    log = tmp_path / "trial.mcap"
    log.write_bytes(sound)
    for name, elsewhere in (("here", False), ("elsewhere", True)):
        folder = tmp_path / name
        folder.mkdir()
        arguments = ["run", log, "-o", folder / "out.mcap", "--parquet", folder / "tables"]
        if elsewhere:
            code = "import sys; from pipeline.cli import main; main(sys.argv[1:])"
            environment = {**os.environ, "PYTHONHASHSEED": "7"}
            subprocess.run([sys.executable, "-c", code, *map(str, arguments)], check=True, env=environment)
        else:
            assert run_command(*arguments).status == 0
    here, elsewhere_ = (
        {path.name: path.read_bytes() for path in (tmp_path / name).rglob("*") if path.is_file()}
        for name in ("here", "elsewhere")
    )
    assert here.keys() == elsewhere_.keys() >= {"out.mcap", "trial.deformation.parquet"}
    assert [name for name in here if here[name] != elsewhere_[name]] == []
