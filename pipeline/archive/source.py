"""One log of an archive, wherever it lies, and what was found of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

SUFFIX = ".mcap"
MARKED = "/deckflex-archive.json"  # what follows the folder of an archive's results


@dataclass(frozen=True)
class Source:
    """One log. name: for people, below what was asked for. size: bytes, None where unknown.

    stamp: changes whenever the content does (size, times, inode, ETag); empty where nothing tells.
    """

    address: str
    name: str
    size: int | None
    stamp: str


@dataclass(frozen=True)
class Found:
    """sources: logs. unreadable: (name, reason) of others. notes: what was passed over, a sentence each."""

    sources: tuple[Source, ...]
    unreadable: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """Whether nothing was found, not even something that cannot be read."""
        return not (self.sources or self.unreadable)


def gathered(parts: Iterable[Found]) -> Found:
    """All of several in one."""
    every = list(parts)
    return Found(
        tuple(source for one in every for source in one.sources),
        tuple(bad for one in every for bad in one.unreadable),
        tuple(note for one in every for note in one.notes),
    )
