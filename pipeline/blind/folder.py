"""The folder of a sealed set: what stands where, read and written whole."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.blind.vault import fingerprint
from schemas.errors import DataError

FORMAT = "deckflex blind check 1"
MANIFEST = "seal.json"
ANSWERS = "answers.sealed"
OPENED = "opened.json"
OWN = "deckflex"


@dataclass(frozen=True)
class SealedLog:
    """A log of the set; without: effects that the library is denied when it is answered."""

    name: str
    sha256: str
    twin_sha256: str
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sealed:
    """A sealed set. commitment: to the answers. secret: the seed was secret."""

    folder: Path
    logs: tuple[SealedLog, ...]
    commitment: str
    secret: bool

    def log(self, entry: SealedLog) -> Path:
        """Path of a log."""
        return self.folder / f"{entry.name}.mcap"

    def twin(self, entry: SealedLog) -> Path:
        """Path of the twin beside it."""
        return self.folder / f"{entry.name}.twin.toml"

    def answers(self, method: str = OWN) -> Path:
        """Folder of the answers of a method."""
        return self.folder / "answers" if method == OWN else self.folder / "baselines" / method

    def methods(self) -> Iterator[str]:
        """Methods that have answered, our own first."""
        if self.answers().is_dir():
            yield OWN
        if (self.folder / "baselines").is_dir():
            yield from sorted(path.name for path in (self.folder / "baselines").iterdir() if path.is_dir())

    def check(self) -> None:
        """Raise DataError unless every log and twin is as it was sealed."""
        for entry in self.logs:
            for path, sealed in ((self.log(entry), entry.sha256), (self.twin(entry), entry.twin_sha256)):
                if fingerprint(path) != sealed:
                    raise DataError("is not the file that was sealed", file=path)


def write_manifest(sealed: Sealed) -> None:
    """The public page of a set: files, their fingerprints, the commitment."""
    document = {
        "format": FORMAT,
        "seed": "secret" if sealed.secret else "given by the user, who can repeat the draw",
        "commitment": sealed.commitment,
        "logs": [
            {"name": e.name, "sha256": e.sha256, "twin_sha256": e.twin_sha256, "without": list(e.without)}
            for e in sealed.logs
        ],
    }
    write_json(sealed.folder / MANIFEST, document)


def read_manifest(folder: Path) -> Sealed:
    """The set in a folder; DataError when there is none."""
    page = read_json(folder / MANIFEST)
    if page.get("format") != FORMAT:
        raise DataError("is not the page of a sealed set", file=folder / MANIFEST)
    try:
        logs = tuple(SealedLog(e["name"], e["sha256"], e["twin_sha256"], tuple(e["without"])) for e in page["logs"])
        return Sealed(folder, logs, page["commitment"], page["seed"] == "secret")
    except (KeyError, TypeError) as error:
        raise DataError("is not the page of a sealed set", file=folder / MANIFEST) from error


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object from a file; DataError otherwise."""
    try:
        document = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", file=path) from error
    except ValueError as error:
        raise DataError(f"is not JSON: {error}", file=path) from error
    if not isinstance(document, dict):
        raise DataError("is not a JSON object", file=path)
    return document


def write_json(path: Path, document: dict[str, Any]) -> None:
    """Whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        temporary.write_text(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
