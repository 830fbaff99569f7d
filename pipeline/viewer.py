"""The Rerun viewer on one recording, reachable from this machine alone."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from pipeline.files import check_input
from pipeline.one_log import Progress, run_log
from pipeline.options import RunOptions
from pipeline.publishing import Outputs, write_outputs
from schemas.errors import DataError

LOOPBACK = "127.0.0.1"


def view(path: Path, options: RunOptions, *, web: bool = False, progress: Progress | None = None) -> None:
    """Open a recording, or run a log first and open what it found; returns when the viewer is closed.

    Raises DataError when the file is neither, or the viewer cannot start.
    """
    if path.suffix == ".rrd":
        _show(path, web)
        return
    with tempfile.TemporaryDirectory(prefix="deckflex-") as folder:
        recording = Path(folder) / f"{path.stem}.rrd"
        write_outputs(run_log(path, options, progress), Outputs(rrd=recording), progress)
        _show(recording, web)


def viewer_command(recording: Path, *, web: bool) -> list[str]:
    """The viewer's own command line: bound to loopback, on a free port."""
    command = [sys.executable, "-m", "rerun_cli", str(recording.resolve()), "--bind", LOOPBACK, "--port", "auto"]
    return [*command, "--web-viewer", "--web-viewer-port", "0"] if web else command


def _show(recording: Path, web: bool) -> None:
    command = viewer_command(check_input(recording), web=web)
    loudness = {"RUST_LOG": "info" if web else "error"}  # the address to open is told as information
    status = subprocess.run(command, check=False, stdout=sys.stderr, env={**os.environ, **loudness}).returncode
    if status != 0:
        raise DataError(f"the viewer ended with status {status}; without a screen, try --web", file=recording)
