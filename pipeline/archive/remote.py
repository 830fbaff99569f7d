"""Addresses of files: paths of this machine, ``s3://``, ``gs://``, ``http(s)://``; what goes wrong there, in a line."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from pipeline.files import reason
from schemas.errors import DataError

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "http": "aiohttp", "https": "aiohttp"}
TALKATIVE = ("gcsfs", "s3fs", "fsspec", "botocore", "aiobotocore", "asyncio")
READ_ONLY = ("http", "https")
SCHEME = re.compile(r"^([A-Za-z][A-Za-z0-9+.-]*)::?//")
MISSING = "is not there"


def protocol_of(address: str) -> str:
    """The protocol of an address, empty for a path of this machine. Raises DataError for one that is not served."""
    if "::" in address and SCHEME.match(address):
        raise DataError("is a chain of addresses; name one address", file=address)
    found = SCHEME.match(address)
    if found is None:
        return ""
    protocol = {"gcs": "gs", "file": ""}.get(found[1].lower(), found[1].lower())
    if protocol not in ("", *PACKAGES):
        raise DataError(
            f"{protocol}:// is not served; there are paths, s3://, gs://, http:// and https://", file=address
        )
    return protocol


def local_path(address: str) -> Path:
    """The path that an address of this machine names."""
    if not address.lower().startswith("file://"):
        return Path(address)
    _, slash, path = address[len("file://") :].partition("/")  # before it a host; nothing behind it is more than a path
    return Path(unquote(slash + path))


def file_system(address: str) -> AbstractFileSystem:
    """The file system of a remote address. Raises DataError where its package is missing."""
    import fsspec

    protocol = protocol_of(address)
    for name in TALKATIVE:  # what matters is said in a line of ours
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        quiet = {"use_listings_cache": False} if protocol in PACKAGES else {}
        with telling(address):
            return fsspec.filesystem(protocol or "file", **quiet)
    except ImportError as error:
        needed = f"needs the package {PACKAGES.get(protocol, 'fsspec')}"
        raise DataError(f"{protocol}:// {needed}: pip install 'deckflex[cloud]'", file=address) from error


@contextmanager
def telling(address: str | Path, what: str = "cannot be read") -> Iterator[None]:
    """Whatever a store has to say becomes one DataError: each store raises errors of its own."""
    try:
        yield
    except (DataError, ImportError, MemoryError):
        raise
    except Exception as error:
        raise DataError(f"{what}: {said(error)}", file=address) from error


def said(error: BaseException) -> str:
    """What went wrong, in the words of whoever knows best: stores hide the cause behind 'file not found'."""
    cause = error.__cause__
    if isinstance(error, FileNotFoundError) and cause is not None and not isinstance(cause, FileNotFoundError):
        return said(cause)
    if isinstance(error, FileNotFoundError):
        return MISSING
    if isinstance(error, OSError):
        return reason(error)
    return " ".join(str(error).split()) or type(error).__name__


def joined(root: str, *names: str) -> str:
    """An address below another."""
    return "/".join([root.rstrip("/"), *names]) if protocol_of(root) else str(local_path(root).joinpath(*names))


def absolute(address: str) -> str:
    """The address as any worker may use it: paths of this machine from the root, others as they are."""
    return address.rstrip("/") if protocol_of(address) else str(local_path(address).expanduser().absolute())


def path_of(address: str) -> str:
    """The path of a remote address. On the web ``?`` and ``#`` end it; in a bucket they are letters like others."""
    if protocol_of(address) in READ_ONLY:
        return unquote(urlsplit(address).path)
    return address.partition("://")[2] or address


def name_of(address: str) -> str:
    """The last part of an address, for people."""
    if protocol_of(address):
        return path_of(address).rstrip("/").rpartition("/")[2] or address
    return local_path(address).name
