"""Logs in a bucket or on the web."""

from __future__ import annotations

from typing import Any

from pipeline.archive.remote import file_system, name_of, path_of, protocol_of, said, telling
from pipeline.archive.source import MARKED, SUFFIX, Found, Source, gathered

GLOB = "*["  # a question mark belongs to a web address
TELLING = ("ETag", "etag", "md5Hash", "generation", "Last-Modified")


def logs_at(word: str) -> Found:
    """An object, a pattern, or all that lies below an address. Raises DataError."""
    fs = file_system(word)
    with telling(word):
        if name_of(word).lower().endswith(SUFFIX) and (not _is_pattern(word) or fs.isfile(word)):
            return Found((_source(word, name_of(word), fs.info(word)),))
        listed = _listed(word, fs)
    logs = {path: info for path, info in listed.items() if _is_log(path, info)}
    archives = tuple(sorted(path[: -len(MARKED)] + "/" for path in listed if path.endswith(MARKED)))
    kept = {path: info for path, info in logs.items() if not path.startswith(archives)}
    notes = tuple(f"{place} holds results of an archive and is passed over" for place in archives)
    return gathered([Found((), (), notes), _described(word, kept, fs)])


def _is_pattern(word: str) -> bool:
    return any(c in word for c in GLOB)


def _listed(word: str, fs: Any) -> dict[str, dict[str, Any]]:
    if _is_pattern(word):
        return dict(fs.glob(word, detail=True))
    if protocol_of(word) in ("http", "https"):
        return {entry["name"]: entry for entry in fs.ls(word.rstrip("/") + "/", detail=True)}
    return dict(fs.find(word, detail=True))


def _is_log(path: str, info: dict[str, Any]) -> bool:
    return info.get("type", "file") == "file" and path_of(path).lower().endswith(SUFFIX)


def _described(word: str, listed: dict[str, dict[str, Any]], fs: Any) -> Found:
    sources, bad = [], []
    prefix = "" if _is_pattern(word) else str(fs._strip_protocol(word)).rstrip("/") + "/"
    for path, info in listed.items():
        address = path if "://" in path else f"{protocol_of(word)}://{path}"
        name = path[len(prefix) :] if prefix and path.startswith(prefix) else name_of(address)
        try:
            known = fs.info(path) if info.get("size") is None else info
            sources.append(_source(address, name, known))
        except Exception as error:
            bad.append((name, f"cannot be read: {said(error)}"))
    return Found(tuple(sources), tuple(bad))


def _source(address: str, name: str, info: dict[str, Any]) -> Source:
    """What a store tells of an object; without ETag or time of change nothing says that it is still the same."""
    size = info.get("size")
    told = [str(info[key]).strip('"') for key in TELLING if info.get(key)]
    return Source(address, name, None if size is None else int(size), f"{size}.{'.'.join(told)}" if told else "")
