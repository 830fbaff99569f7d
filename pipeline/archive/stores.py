"""Where an archive's results are kept: a directory of this machine, or a bucket. Files appear whole or not at all.

Locally a file is made under ``.partial`` in the store, flushed to the disk, then renamed; what a killed process leaves
there is swept away by the next run. A bucket shows an object only when all of it has arrived.
"""

from __future__ import annotations

import os
import secrets
import shutil
import socket
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path, PurePath

from typing_extensions import override

from pipeline.archive.remote import READ_ONLY, absolute, file_system, joined, local_path, protocol_of, telling
from pipeline.files import reason
from schemas.errors import DataError

PARTIAL = ".partial"
MARK = "deckflex-archive.json"
STALE_S = 7 * 86400.0  # a partial file of another machine older than this belongs to nobody


class StoreError(DataError):
    """The store itself cannot be written: no use in going on."""


class Store(ABC):
    """Names are relative to the store, parts divided by a slash."""

    root: str

    @abstractmethod
    def names(self, folder: str) -> list[str]:
        """Names of the files directly in a folder; none where there is no folder. Raises DataError."""

    @abstractmethod
    def read(self, name: str) -> bytes:
        """A whole file. Raises DataError."""

    @abstractmethod
    def exists(self, name: str) -> bool:
        """Whether there is such a file."""

    @abstractmethod
    def write(self, name: str, data: bytes) -> None:
        """A file from its bytes. Raises StoreError."""

    @abstractmethod
    def put(self, source: Path, name: str) -> None:
        """A file from one made in :meth:`scratch`, which it may use up. Raises StoreError."""

    @abstractmethod
    def remove(self, name: str) -> None:
        """Take a file away, if it is there. Raises StoreError."""

    @abstractmethod
    def scratch(self) -> AbstractContextManager[Path]:
        """A directory of this machine to make files in; it is gone afterwards."""

    def sweep(self) -> int:
        """Clear away what killed processes left; how many places were cleared."""
        return 0

    def place_of(self, path: Path) -> PurePath | None:
        """Where a path of this machine lies in the store; None outside it."""
        return None


def open_store(address: str) -> Store:
    """The store at an address. Raises DataError for one that cannot be written to."""
    protocol = protocol_of(address)
    if protocol in READ_ONLY:
        raise DataError(f"{protocol}:// can only be read; results go to a directory, s3 or gs", file=address)
    return RemoteStore(address) if protocol else LocalStore(address)


class LocalStore(Store):
    """A directory."""

    def __init__(self, root: str) -> None:
        self.root = absolute(root)
        self.path = local_path(self.root)
        if self.path.exists() and not self.path.is_dir():
            raise DataError("is a file; name a directory for the results", file=self.root)

    @override
    def place_of(self, path: Path) -> PurePath | None:
        try:
            place = path.resolve().relative_to(self.path.resolve())
        except (ValueError, OSError):
            return None
        return place if place.parts else None

    @override
    def names(self, folder: str) -> list[str]:
        try:
            with os.scandir(self.path / folder) as entries:
                return sorted(entry.name for entry in entries if entry.is_file())
        except (FileNotFoundError, NotADirectoryError):
            return []
        except OSError as error:
            raise DataError(f"cannot be read: {reason(error)}", file=self.path / folder) from error

    @override
    def read(self, name: str) -> bytes:
        with telling(self.path / name):
            return (self.path / name).read_bytes()

    @override
    def exists(self, name: str) -> bool:
        return (self.path / name).is_file()

    @override
    def write(self, name: str, data: bytes) -> None:
        with self.scratch() as folder:
            source = folder / "file"
            with _writing(self.path / name):
                source.write_bytes(data)
            self.put(source, name)

    @override
    def put(self, source: Path, name: str) -> None:
        target = self.path / name
        with _writing(target):
            _made(target.parent)
            _flush(source)
            source.replace(target)
            _flush(target.parent)

    @override
    def remove(self, name: str) -> None:
        with _writing(self.path / name):
            (self.path / name).unlink(missing_ok=True)

    @override
    @contextmanager
    def scratch(self) -> Iterator[Path]:
        folder = self.path / PARTIAL / f"{socket.gethostname()}.{os.getpid()}.{secrets.token_hex(6)}"
        with _writing(self.path):
            folder.mkdir(parents=True)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    @override
    def sweep(self) -> int:
        try:
            left = [entry for entry in (self.path / PARTIAL).iterdir() if _abandoned(entry)]
        except OSError:
            return 0
        for entry in left:
            shutil.rmtree(entry, ignore_errors=True)
        return len(left)


class RemoteStore(Store):
    """A place in a bucket, through fsspec."""

    def __init__(self, root: str) -> None:
        self.root = absolute(root)
        if not self.root.partition("://")[2]:
            raise DataError("names no bucket", file=root)
        self.fs = file_system(self.root)

    @override
    def names(self, folder: str) -> list[str]:
        try:
            found = self.fs.find(joined(self.root, folder), maxdepth=1)
        except FileNotFoundError:
            return []
        except Exception as error:
            with telling(self.root):
                raise error
        return sorted(path.rpartition("/")[2] for path in found)

    @override
    def read(self, name: str) -> bytes:
        with telling(joined(self.root, name)):
            return bytes(self.fs.cat_file(joined(self.root, name)))

    @override
    def exists(self, name: str) -> bool:
        with telling(joined(self.root, name)):
            return bool(self.fs.isfile(joined(self.root, name)))

    @override
    def write(self, name: str, data: bytes) -> None:
        with _writing(joined(self.root, name)):
            self.fs.pipe_file(joined(self.root, name), data)

    @override
    def put(self, source: Path, name: str) -> None:
        with _writing(joined(self.root, name)):
            self.fs.put_file(str(source), joined(self.root, name))

    @override
    def remove(self, name: str) -> None:
        with _writing(joined(self.root, name)):
            if self.fs.exists(joined(self.root, name)):
                self.fs.rm_file(joined(self.root, name))

    @override
    @contextmanager
    def scratch(self) -> Iterator[Path]:
        with tempfile.TemporaryDirectory(prefix="deckflex-", ignore_cleanup_errors=True) as folder:
            yield Path(folder)


@contextmanager
def _writing(target: Path | str) -> Iterator[None]:
    """StoreError for whatever stands against writing."""
    try:
        with telling(target, "cannot be written"):
            yield
    except DataError as error:
        raise StoreError(error.problem, file=error.file) from error


def _made(folder: Path) -> None:
    """A folder whose name outlives a power cut as surely as the files in it: each one made is flushed in its parent."""
    if folder.is_dir():
        return
    _made(folder.parent)
    folder.mkdir(exist_ok=True)
    _flush(folder.parent)


def _flush(path: Path) -> None:
    """Down to the disk, as far as the file system takes the wish."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _abandoned(entry: Path) -> bool:
    """Whether the process that made a partial file is dead, or the file is older than any run."""
    host, _, rest = entry.name.rpartition(".")[0].rpartition(".")
    try:
        if time.time() - entry.stat().st_mtime > STALE_S:
            return True
        return host == socket.gethostname() and not _alive(int(rest))
    except (OSError, ValueError):
        return False


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
