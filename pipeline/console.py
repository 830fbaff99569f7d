"""The terminal: results on standard output; progress, logs and errors on standard error."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from pipeline.files import reason
from schemas.errors import DataError

if TYPE_CHECKING:
    from pipeline.one_log import Progress

BAD_DATA = 1
INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
PLAIN_WIDTH = 160  # columns where standard output is not a terminal


def guarded(command: Callable[[], object], *, debug: bool) -> int:
    """Run a command; whatever goes wrong becomes one line on standard error. Returns the exit status."""
    try:
        with quiet(debug), terminable():
            command()
    except SystemExit as exit_:
        return exit_.code if isinstance(exit_.code, int) else int(exit_.code is not None)
    except KeyboardInterrupt:
        return complain("interrupted; nothing half-written is left", INTERRUPTED)
    except Exception as error:
        if debug:
            traceback.print_exc()
        return complain(explained(error), BAD_DATA)
    return 0


def explained(error: Exception) -> str:
    """One sentence for an engineer."""
    if isinstance(error, DataError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {reason(error)}" if error.filename else reason(error)
    if isinstance(error, MemoryError):
        return "out of memory; the log is too large for this machine"
    return f"internal error: {type(error).__name__}: {error} (deckflex --debug ... shows where)"


def complain(sentence: str, status: int) -> int:
    """Print one line, whatever the sentence holds, and hand back the exit status."""
    one_line = "".join(c if c.isprintable() else " " for c in sentence)
    with contextlib.suppress(OSError):
        print(f"deckflex: {one_line}", file=sys.stderr)
    return status


def emit(document: dict[str, Any]) -> None:
    """The one JSON document of a command, on standard output."""
    print(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False))


@contextlib.contextmanager
def quiet(debug: bool) -> Iterator[None]:
    """Keep libraries' warnings off the terminal unless asked for, and let no character stop the printing."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    with warnings.catch_warnings():
        if not debug:
            warnings.simplefilter("ignore")
        yield


@contextlib.contextmanager
def terminable() -> Iterator[None]:
    """Let a polite kill unwind the stack, so that temporary files go."""

    def stop(_signal: int, _frame: FrameType | None) -> NoReturn:
        sys.exit(TERMINATED)

    previous = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextlib.contextmanager
def progress_bar() -> Iterator[Progress | None]:
    """A bar on standard error while the block runs, if a person is there to see it."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description:<12}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda step, done, total: bar.update(task, description=step, completed=done, total=total or None)


def display(*parts: object) -> None:
    """Tables and lines for people, on standard output; nothing in them is taken as markup."""
    from rich.console import Console
    from rich.table import Table

    from pipeline.tables import fitted

    width = None if sys.stdout.isatty() else int(os.environ.get("COLUMNS", PLAIN_WIDTH))
    console = Console(width=width, markup=False, highlight=False, emoji=False)
    for part in parts:
        shown = fitted(part, console) if isinstance(part, Table) else part
        console.print(shown, soft_wrap=isinstance(part, str))


def relative(path: Path) -> str:
    """A path as a person would type it from here."""
    with contextlib.suppress(ValueError):
        return str(path.resolve().relative_to(Path.cwd()))
    return str(path)
