"""What is done: one small file a log, whose name says all that a later run must know to do nothing.

    manifest/<key>.done.json        the result is whole; the file holds its figures and names its files
    manifest/<key>.aside.json       the data do not allow a result; the file holds the reason
    inputs/<address>-<stamp>-<sha256>.json     the content that an address had when it was last looked at

key: of content, options and version. The entry is written last, so a result without one was never finished. Equal work
writes equal names: several batches may work into one archive at once, and nothing has to be locked.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.archive.source import MARKED, Source
from pipeline.archive.stores import PARTIAL, Store
from schemas.errors import DataError

ENTRIES, INPUTS, RESULTS = "manifest", "inputs", "results"
DONE, ASIDE = "done", "aside"
CATALOGUE = "catalogue.parquet"
OWN_FOLDERS, OWN_FILES = frozenset({ENTRIES, INPUTS, RESULTS, PARTIAL}), frozenset({CATALOGUE, MARKED.lstrip("/")})
FORMAT = 1
SHORT = 24  # hexadecimal digits of an address and its stamp


@dataclass
class Manifest:
    """The names in an archive, read once. states: key to done or aside. contents: address and stamp to sha256."""

    states: dict[str, str] = field(default_factory=dict)
    contents: dict[tuple[str, str], str] = field(default_factory=dict)
    marks: dict[str, list[str]] = field(default_factory=dict)

    def sha256_of(self, source: Source) -> str | None:
        """The content of a log, if it is known and nothing tells that it changed since."""
        return self.contents.get((_short(source.address), _short(source.stamp))) if source.stamp else None


def load_manifest(store: Store) -> Manifest:
    """Two listings, no file opened. Raises DataError."""
    found = Manifest()
    for name in store.names(ENTRIES):
        key, state, suffix = (*name.split("."), "", "")[:3]
        if suffix == "json" and state in (DONE, ASIDE) and found.states.get(key) != DONE:
            found.states[key] = state
    for name in store.names(INPUTS):
        parts = name.removesuffix(".json").split("-")
        if len(parts) == 3:
            found.contents[parts[0], parts[1]] = parts[2]
            found.marks.setdefault(parts[0], []).append(name)
    return found


def spare_own_files(store: Store, targets: Iterable[Path]) -> None:
    """Raise DataError for a file to write that would take the place of one of the archive's own."""
    for target in targets:
        place = store.place_of(target)
        if place is not None and (place.parts[0] in OWN_FOLDERS or str(place) in OWN_FILES):
            raise DataError("is a file of the archive itself; name another file to write", file=target)


def open_archive(store: Store, *, writing: bool = True) -> None:
    """Mark the store as an archive; writing: even where it is one, which shows before the work that it can be written.

    Raises DataError where it is one of a later version, StoreError where it takes no file.
    """
    name = MARKED.lstrip("/")
    if not store.exists(name):
        writing = True
    elif (stated := decoded(store.read(name), name).get("format")) != FORMAT:
        raise DataError(f"is an archive of format {stated}; this version knows format {FORMAT}", file=store.root)
    if writing:
        about = "results of deckflex batch; manifest/ says what is done, catalogue.parquet holds the figures"
        store.write(name, encoded({"format": FORMAT, "about": about}))


def note_content(store: Store, source: Source, sha256: str, earlier: Collection[str] = ()) -> None:
    """Remember what an address holds; earlier: names of marks that no longer hold."""
    name = f"{_short(source.address)}-{_short(source.stamp)}-{sha256}.json"
    if name not in earlier:
        store.write(f"{INPUTS}/{name}", encoded({"address": source.address, "name": source.name, "sha256": sha256}))
    for old in earlier:
        if old != name:
            store.remove(f"{INPUTS}/{old}")


def marks_of(manifest: Manifest, source: Source) -> list[str]:
    """Names of the marks of an address."""
    return manifest.marks.get(_short(source.address), [])


def entry_name(key: str, state: str) -> str:
    """Where the entry of a result is."""
    return f"{ENTRIES}/{key}.{state}.json"


def state_of(store: Store, key: str) -> str | None:
    """done, aside or None, asked afresh."""
    return next((state for state in (DONE, ASIDE) if store.exists(entry_name(key, state))), None)


def write_entry(store: Store, key: str, state: str, document: dict[str, Any]) -> None:
    """The last step of a log: from now on it is finished."""
    store.write(entry_name(key, state), encoded({"format": FORMAT, "key": key, "state": state, **document}))
    if state == DONE:
        store.remove(entry_name(key, ASIDE))


def read_entry(store: Store, key: str, state: str) -> dict[str, Any]:
    """An entry as it was written. Raises DataError."""
    return decoded(store.read(entry_name(key, state)), f"{store.root}/{entry_name(key, state)}")


def encoded(document: dict[str, Any]) -> bytes:
    """JSON, one line."""
    return (json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n").encode("utf-8", "backslashreplace")


def decoded(data: bytes, name: str) -> dict[str, Any]:
    """JSON back to plain data. Raises DataError for what is none."""
    try:
        document = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise DataError("is not JSON; remove it, and the next batch makes it anew", file=name) from error
    if not isinstance(document, dict):
        raise DataError("is not a JSON object; remove it, and the next batch makes it anew", file=name)
    return document


def _short(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:SHORT]
