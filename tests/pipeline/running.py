"""The command line, run in this process as the entry point runs it."""

import contextlib
import io
from dataclasses import dataclass

from pipeline import cli


@dataclass(frozen=True)
class Outcome:
    status: int
    out: str
    err: str


def run_command(*arguments: object) -> Outcome:
    """Exit status and what was printed."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            cli.main([str(argument) for argument in arguments])
        except SystemExit as exit_:
            status = exit_.code
    return Outcome(status, out.getvalue(), err.getvalue())
