"""The logs of an archive: a directory, a pattern, a list, addresses; each with what tells that its content changed."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

from pipeline.archive.remote import absolute, joined, local_path, protocol_of, telling
from pipeline.archive.source import MARKED, SUFFIX, Found, Source, gathered
from pipeline.files import reason
from schemas.errors import DataError

LISTS = (".txt", ".lst", ".list")
MAGIC = "*?["
LONGEST_LIST = 64 << 20  # bytes
NONE_THERE = f"holds no log (*{SUFFIX})"


def found_in(words: Sequence[str], output: str) -> Found:
    """All logs that the words name, sorted by address, each once; nothing below the output or another archive.

    Raises DataError for a word that names no log.
    """
    every = gathered(_required(word, absolute(output), several=len(words) > 1) for word in words)
    single = {source.address: source for source in every.sources}
    ordered = told_apart(sorted(single.values(), key=lambda source: source.address))
    return Found(ordered, tuple(sorted(dict(every.unreadable).items())), tuple(dict.fromkeys(every.notes)))


def told_apart(sources: Sequence[Source]) -> tuple[Source, ...]:
    """The logs as they are; where two have one name, each by its address below the folder that all have in common."""
    if len({source.name for source in sources}) == len(sources):
        return tuple(sources)
    parts = [source.address.split("/") for source in sources]
    shared = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(min(parts), max(parts))))
    return tuple(replace(source, name="/".join(of[shared:])) for source, of in zip(sources, parts))


def _required(word: str, output: str, *, several: bool) -> Found:
    if not word.strip():
        raise DataError("an empty word names no logs")
    one = _of_word(word, output)
    if one.empty:
        raise DataError("; ".join([NONE_THERE, *one.notes]), file=word)
    return _as_written(word, one) if several else one


def _as_written(word: str, found: Found) -> Found:
    """Files that cannot be read, named so that those of several folders are not taken for one."""
    if any(c in word for c in MAGIC):
        return found

    def written(name: str) -> str:
        return word if name in (word, Path(word).name) else joined(word, name)

    return replace(found, unreadable=tuple((written(name), reason) for name, reason in found.unreadable))


def _of_word(word: str, output: str) -> Found:
    if protocol_of(word):
        from pipeline.archive.remote_sources import logs_at

        return logs_at(word)
    path = local_path(word).expanduser()
    if path.is_dir():
        return _of_directory(path, output)
    if path.suffix.lower() in LISTS and path.is_file():
        return _of_list(path, output)
    if path.exists() or path.is_symlink():
        return _of_files([path], path.parent)
    if any(c in word for c in MAGIC):
        return _of_pattern(str(path), output)
    raise DataError("there is no such file or directory", file=word)


def _of_directory(root: Path, output: str) -> Found:
    """Every log below a directory. Links to directories are followed, none twice."""
    inside = Path("/nowhere") if protocol_of(output) else Path(output).resolve()
    if root.resolve() == inside or inside in root.resolve().parents:
        raise DataError("is the output directory or inside it; name another one for the results", file=root)
    walk = Walk(inside)
    files = sorted(walk.files(root))
    return gathered([_of_files(files, root), Found((), tuple(walk.closed), tuple(walk.notes))])


class Walk:
    """A walk over directories that remembers where it has been and what it could not enter."""

    def __init__(self, output: Path) -> None:
        self.output = output
        self.seen: set[tuple[int, int]] = set()
        self.closed: list[tuple[str, str]] = []
        self.notes: list[str] = []

    def files(self, folder: Path) -> Iterator[Path]:
        """Logs below a folder, links that lead nowhere among them."""
        waiting = [folder]
        while waiting:
            here = waiting.pop()
            inside = self._entered(here)
            if any(f"/{entry.name}" == MARKED for entry in inside):
                self.notes.append(f"{here} holds results of an archive and is passed over")
                continue
            waiting += [Path(entry.path) for entry in inside if _is_folder(entry)]
            yield from (Path(entry.path) for entry in inside if _is_log(entry))

    def _entered(self, folder: Path) -> list[os.DirEntry[str]]:
        """What is in a folder; nothing where it was seen before, is the output, or is closed."""
        try:
            known = folder.stat()
            place = (known.st_dev, known.st_ino)
            if place in self.seen or folder.resolve() == self.output:
                return []
            self.seen.add(place)
            with os.scandir(folder) as entries:
                return list(entries)
        except OSError as error:
            self.closed.append((str(folder), f"cannot be read: {reason(error)}"))
            return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir() and not entry.name.startswith(".")
    except OSError:
        return False


def _is_log(entry: os.DirEntry[str]) -> bool:
    """A file, or a link that leads nowhere; hidden ones are somebody's unfinished business."""
    if not entry.name.lower().endswith(SUFFIX) or entry.name.startswith("."):
        return False
    try:
        return not entry.is_dir()
    except OSError:
        return True


def _of_pattern(pattern: str, output: str) -> Found:
    """What a pattern matches; of directories that it matches, all that lies below."""
    first = next(k for k, c in enumerate(pattern) if c in MAGIC)
    root = pattern[:first].rpartition("/")[0]
    rest = pattern[len(root) :].lstrip("/")
    base = Path(root or ("/" if pattern.startswith("/") else "."))
    with telling(pattern):
        matches = sorted(path for path in base.glob(rest) if not _is_hidden(path.relative_to(base)))
    folders = [path for path in matches if path.is_dir() and "**" not in rest]
    files = [path for path in matches if path.name.lower().endswith(SUFFIX) and not path.is_dir()]
    kept = [path for path in files if not _within(path, output)]
    return gathered([_of_files(kept, base), *(_of_directory(path, output) for path in folders)])


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") and part != ".." for part in path.parts)


def _within(path: Path, output: str) -> bool:
    return not protocol_of(output) and Path(output).resolve() in path.resolve().parents


def _of_files(paths: Iterable[Path], root: Path) -> Found:
    sources, bad = [], []
    for path in paths:
        name = os.path.relpath(path, root)
        try:
            sources.append(local_source(path, name))
        except DataError as error:
            bad.append((name, error.problem))
    return Found(tuple(sources), tuple(bad))


def local_source(path: Path, name: str) -> Source:
    """A file of this machine. Raises DataError where it is none that can be read."""
    try:
        known = path.stat()
    except OSError as error:
        raise DataError(f"cannot be read: {reason(error)}", file=path) from error
    if not stat.S_ISREG(known.st_mode):
        raise DataError("is not an ordinary file", file=path)
    stamp = f"{known.st_size}.{known.st_mtime_ns}.{known.st_ctime_ns}.{known.st_ino}"
    return Source(str(path.absolute()), name, known.st_size, stamp)


def _of_list(path: Path, output: str) -> Found:
    """One path or address a line; blank lines and those that begin with # say nothing."""
    with telling(path):
        if path.stat().st_size > LONGEST_LIST:
            raise DataError("is too long for a list of logs", file=path)
        text = path.read_bytes()
    try:
        lines = [line.strip() for line in text.decode("utf-8-sig").splitlines()]
    except UnicodeDecodeError as error:
        raise DataError("is no list: it is not text in UTF-8", file=path) from error
    return gathered(_of_line(line, path, output) for line in lines if line and not line.startswith("#"))


def _of_line(line: str, path: Path, output: str) -> Found:
    """What a line of a list names; paths count from the list's own directory."""
    try:
        address = line if protocol_of(line) else str(path.parent / local_path(line).expanduser())
        if Path(address).suffix.lower() in LISTS:
            raise DataError("a list names logs, not lists")
        one = _of_word(address, output)
        return Found((), ((line, NONE_THERE),), one.notes) if one.empty else _as_written(line, one)
    except DataError as error:
        return Found((), ((line, error.problem),))
