"""Where a result comes from: the log's hash, the version, the options, the rig."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pipeline.options import RunOptions


def deckflex_version() -> str:
    """Version of the installed package."""
    try:
        return version("deckflex")
    except PackageNotFoundError:
        return "unknown"


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, read as a stream (about 1 GB/s)."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def provenance(log: Path, sha256: str, options: RunOptions, rig_name: str) -> Mapping[str, str]:
    """All that a second run needs to give the same figures. No clock: the same input gives the same bytes."""
    stated = {name: value for name, value in options.as_text().items() if name != "rig"}
    rig = {"rig": rig_name, "rig.sha256": sha256_of(options.rig)} if options.rig else {"rig": rig_name}
    libraries = {name: version(name) for name in ("numpy", "scipy", "numba")}
    return {
        "deckflex": deckflex_version(),
        "python": platform.python_version(),
        **libraries,
        "log": log.name.encode("utf-8", "backslashreplace").decode(),  # a name need not be text
        "log.sha256": sha256,
        **stated,
        **rig,
    }
