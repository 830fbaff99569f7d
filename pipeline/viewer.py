"""The Rerun viewer on one recording, reachable from this machine alone."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path

from pipeline.files import check_input
from pipeline.one_log import Progress, run_log
from pipeline.options import RunOptions
from pipeline.publishing import Outputs, write_outputs
from schemas.errors import DataError

LOOPBACK = "127.0.0.1"
BEGINNING = b"RRF2"  # of every recording
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
ANSI = re.compile(r"\x1b\[[0-9;]*m")
ADDRESS = re.compile(r"web-viewer at \S+ - connect at (\S+)")
FAULT = re.compile(r"\bERROR\b|^Error\b|panicked")

Tell = Callable[[str], object]


def view(path: Path, options: RunOptions, tell: Tell, *, web: bool = False, progress: Progress | None = None) -> None:
    """Open a recording, or run a log first and open what it found; returns when the viewer is closed.

    tell: called with the address to open in a browser. Raises DataError when the file is neither a recording nor a
    log, there is no screen, or the viewer cannot start.
    """
    if not web and not has_screen(os.environ):
        raise DataError("there is no screen to open a window on; --web shows it in a browser", file=path)
    if path.suffix == ".rrd":
        show(check_recording(path), tell, web=web)
        return
    with tempfile.TemporaryDirectory(prefix="deckflex-") as folder:
        recording = Path(folder) / f"{path.stem}.rrd"
        write_outputs(run_log(path, options, progress), Outputs(rrd=recording), progress)
        show(recording, tell, web=web)


def has_screen(environment: Mapping[str, str]) -> bool:
    """Whether a window can be opened; only Linux says so beforehand."""
    return not sys.platform.startswith("linux") or any(environment.get(name) for name in SCREENS)


def check_recording(path: Path) -> Path:
    """The path; DataError unless a Rerun recording is there. The viewer itself would show nothing and say nothing."""
    with check_input(path).open("rb") as file:
        if file.read(len(BEGINNING)) != BEGINNING:
            raise DataError("this is not a Rerun recording", file=path)
    return path


def viewer_command(recording: Path, *, web: bool) -> list[str]:
    """The viewer's own command line: bound to loopback, on a free port."""
    command = [str(viewer_program()), str(recording.resolve()), "--bind", LOOPBACK, "--port", "auto"]
    return [*command, "--web-viewer", "--web-viewer-port", "0"] if web else command


def viewer_program() -> Path:
    """The program itself: its Python entry hides how it ended, and would leave it behind when stopped."""
    spec = find_spec("rerun_cli")
    folder = Path(spec.origin).parent if spec is not None and spec.origin is not None else Path()
    places = [folder / "Rerun.app/Contents/MacOS/Rerun", folder / "rerun", folder / "rerun.exe"]
    for place in places:
        if place.is_file():
            return place
    raise DataError("the Rerun viewer is not installed; pip install rerun-sdk brings it")


def show(recording: Path, tell: Tell, *, web: bool) -> None:
    """Run the viewer until it ends; what it says besides its address and its faults is left out."""
    environment = {**os.environ, "RUST_LOG": "info" if web else "error"}  # the address is told as information
    viewer = subprocess.Popen(
        viewer_command(recording, web=web), env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        text=True, errors="replace",
    )  # fmt: skip
    try:
        fault = _listen(viewer, tell)
        status = viewer.wait()
    finally:
        viewer.terminate()
        viewer.wait()
    if status != 0:
        raise DataError(f"the viewer ended with status {status}" + (f": {fault}" if fault else ""), file=recording)


def _listen(viewer: subprocess.Popen[str], tell: Tell) -> str:
    """Pass the address on; the last fault the viewer spoke of."""
    fault = ""
    for line in viewer.stderr or ():
        said = ANSI.sub("", line).strip()
        if address := ADDRESS.search(said):
            tell(f"open {address[1]} in a browser; Ctrl+C ends the viewer")
        elif FAULT.search(said):
            fault = said[:300]
    return fault
