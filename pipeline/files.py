"""Files a command reads and writes: checked before the work starts, whole or absent after it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from schemas.errors import DataError


def check_input(path: Path) -> Path:
    """The path, if it is a file that can be read; otherwise a DataError that says why not."""
    if path.is_dir():
        raise DataError("is a directory; a file is needed", file=path)
    try:
        with path.open("rb"):
            return path
    except OSError as error:
        raise DataError(f"cannot be read: {reason(error)}", file=path) from error


def check_target(target: Path, inputs: Iterable[Path]) -> Path:
    """The target, if a file can be put there without harming an input; otherwise a DataError that says why not."""
    if target.is_dir():
        raise DataError("is a directory; name a file to write", file=target)
    for source in inputs:
        if _same_file(target, source):
            raise DataError("is an input, and inputs are never changed; name another file to write", file=target)
    if target.exists() and not target.is_file():
        raise DataError("is not an ordinary file and is not replaced", file=target)
    if not target.parent.is_dir():
        raise DataError(f"cannot be written: there is no directory {target.parent}", file=target)
    if not os.access(target.parent, os.W_OK):
        raise DataError(f"cannot be written: no permission to write in {target.parent}", file=target)
    return target


def check_targets(targets: Sequence[Path], inputs: Sequence[Path]) -> None:
    """:func:`check_target` on each, and no two of them the same file."""
    for index, target in enumerate(targets):
        check_target(target, inputs)
        if any(_same_file(target, other) for other in targets[:index]):
            raise DataError("is named twice as a file to write", file=target)


@contextmanager
def staged(targets: Sequence[Path]) -> Iterator[list[Path]]:
    """Temporary names beside the targets; all of them become the targets when the block ends well, else all vanish."""
    temporary = [_beside(target) for target in targets]
    with ExitStack() as stack:
        for path in temporary:
            stack.callback(path.unlink, missing_ok=True)
        yield temporary
        for path, target in zip(temporary, targets, strict=True):
            path.replace(target)


@contextmanager
def writing(target: Path, temporary: Path | None = None) -> Iterator[None]:
    """Name the target, not its temporary stand-in, in whatever is said against writing it."""
    try:
        yield
    except OSError as error:
        raise DataError(f"cannot be written: {reason(error)}", file=target) from error
    except DataError as error:
        if temporary is None or error.file != str(temporary):
            raise
        raise DataError(error.problem, file=target, channel=error.channel, time_s=error.time_s) from error


def reason(error: OSError) -> str:
    """What the file system said, in its own words."""
    return error.strerror or str(error) or type(error).__name__


def _beside(target: Path) -> Path:
    """A name that is free, hidden and of the same suffix, in the target's directory."""
    return target.with_name(f".{target.stem[:100]}.{secrets.token_hex(6)}{target.suffix}")


def _same_file(a: Path, b: Path) -> bool:
    if a.exists() and b.exists():
        return a.samefile(b)
    return a.resolve() == b.resolve()
