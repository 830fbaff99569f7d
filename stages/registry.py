"""Methods by name: each stage with several methods lists them once, and loads only the one that is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any


class Registry:
    """Names to classes, written ``"module:Class"``; the first is the default."""

    def __init__(self, kind: str, entries: Mapping[str, str]) -> None:
        self.kind = kind
        self.entries = dict(entries)

    @property
    def names(self) -> tuple[str, ...]:
        """All names, the default first."""
        return tuple(self.entries)

    def get(self, name: str) -> Any:
        """The class of that name; ValueError, with the names there are, when there is none."""
        if name not in self.entries:
            raise ValueError(f"no {self.kind} named {name!r}; there are: {', '.join(self.entries)}")
        module, _, attribute = self.entries[name].partition(":")
        return getattr(import_module(module), attribute)
