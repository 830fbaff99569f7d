"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from schemas.errors import DataError


@contextmanager
def replacing(target: Path) -> Iterator[BinaryIO]:
    """A file beside target that is synced and renamed to it when the block ends well, and removed when it does not.

    Raises DataError when the file cannot be written.
    """
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{target.name[:80]}.", suffix=".part", dir=target.parent)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror or error}", file=target) from error
    try:
        with os.fdopen(descriptor, "wb") as handle:
            yield handle
            handle.flush()
            os.fsync(handle.fileno())
        _adopt_mode(Path(name), target)
        Path(name).replace(target)
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror or error}", file=target) from error
    finally:
        with suppress(OSError):
            Path(name).unlink()


def _adopt_mode(path: Path, target: Path) -> None:
    """The permissions a plain new file would have, or those of the file that is replaced."""
    try:
        mode = target.stat().st_mode & 0o777
    except OSError:
        mask = os.umask(0)
        os.umask(mask)
        mode = 0o666 & ~mask
    path.chmod(mode)
