"""What is locked away, and how anyone can check later that it was not touched."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from pathlib import Path
from typing import Any

from schemas.errors import DataError

BLOCK = 65536  # bytes, to a whole number of which the answers are filled up: their length tells nothing


def new_key(path: Path) -> bytes:
    """A fresh key, written to a file that only its owner can read; DataError if there is one already."""
    from cryptography.fernet import Fernet

    key = Fernet.generate_key()
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as error:
        raise DataError("exists already; a key is never overwritten", file=path) from error
    except OSError as error:
        raise DataError(f"cannot be written: {error.strerror}", file=path) from error
    with os.fdopen(handle, "wb") as file:
        file.write(key + b"\n")
    return key


def read_key(path: Path) -> bytes:
    """The key in a file."""
    try:
        return path.read_bytes().strip()
    except OSError as error:
        raise DataError(f"the key cannot be read: {error.strerror}", file=path) from error


def lock(document: dict[str, Any], key: bytes) -> tuple[bytes, str]:
    """The document encrypted (AES-128-CBC with HMAC-SHA-256, Fernet), and the commitment to it.

    The commitment is the SHA-256 of the salted text: it binds the answers without letting anyone try them out.
    """
    from cryptography.fernet import Fernet

    text = json.dumps({"salt": secrets.token_hex(32), **document}, allow_nan=False)
    text += " " * (-len(text.encode()) % BLOCK)
    return Fernet(key).encrypt(text.encode()), hashlib.sha256(text.encode()).hexdigest()


def unlock(path: Path, key: bytes, commitment: str) -> dict[str, Any]:
    """The document behind the lock; DataError for another key, another file, or answers that were exchanged."""
    from cryptography.fernet import Fernet, InvalidToken

    try:
        text = Fernet(key).decrypt(path.read_bytes())
    except (InvalidToken, ValueError) as error:
        raise DataError("cannot be opened: the key is another, or the file was changed", file=path) from error
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", file=path) from error
    if hashlib.sha256(text).hexdigest() != commitment:
        raise DataError("does not hold the answers that were committed to when it was sealed", file=path)
    document: dict[str, Any] = json.loads(text)
    return document


def fingerprint(path: Path) -> str:
    """SHA-256 of a file; DataError when it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", file=path) from error
