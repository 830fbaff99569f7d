"""What there is: every list of names an engineer can choose from."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module, resources
from itertools import takewhile


class Kind(StrEnum):
    """The things that can be listed."""

    ESTIMATORS = "estimators"
    IDENTIFIERS = "identifiers"
    SHAPES = "shapes"
    EFFECTS = "effects"
    TWINS = "twins"
    EXPERIMENTS = "experiments"


@dataclass(frozen=True)
class Entry:
    """One thing on a list: its name and what it is, in a line."""

    name: str
    about: str


def listing(kind: Kind) -> tuple[Entry, ...]:
    """All entries of a kind, in the order they were registered."""
    return LISTINGS[kind]()


def check_name(stage: str, name: str | None) -> None:
    """Raise ValueError with the list of names unless the stage has a method of that name (None: its default)."""
    module = import_module(f"stages.{stage}")
    if name is not None and name not in module.names():  # one that is there need not be loaded to know it
        module.get(name)


def _methods(stage: str) -> tuple[Entry, ...]:
    module = import_module(f"stages.{stage}")
    return tuple(Entry(name, _about(module.get(name))) for name in module.names())


def _effects() -> tuple[Entry, ...]:
    effects = import_module("twin.effects")
    return tuple(Entry(name, effects.get(name).about()) for name in effects.names())


def _about(method: type) -> str:
    """First line of a method's docstring, and where it comes from."""
    line = (method.__doc__ or "").strip().split("\n")[0]
    source = str(getattr(method, "source", ""))
    return f"{line} [{source}]" if source else line


def _twins() -> tuple[Entry, ...]:
    names = import_module("twin").built_in()
    texts = ((resources.files("twin") / "twins" / f"{name}.toml").read_text("utf-8") for name in names)
    return tuple(Entry(name, _opening(text)) for name, text in zip(names, texts))


def _opening(toml: str) -> str:
    """First sentence of the comment a twin's file opens with."""
    comment = takewhile(lambda line: line.startswith("#"), toml.splitlines())
    return re.split(r"\. (?=[A-Z])", " ".join(line.lstrip("# ") for line in comment))[0].rstrip(".")


def _experiments() -> tuple[Entry, ...]:
    experiments = import_module("pipeline.experiments")
    found = ((name, experiments.get(name)) for name in experiments.names())
    return tuple(Entry(name, f"{experiment.about} [{experiment.source}]") for name, experiment in found)


LISTINGS: Mapping[Kind, Callable[[], tuple[Entry, ...]]] = {
    Kind.ESTIMATORS: lambda: _methods("estimate"),
    Kind.IDENTIFIERS: lambda: _methods("identify"),
    Kind.SHAPES: lambda: _methods("shape"),
    Kind.EFFECTS: _effects,
    Kind.TWINS: _twins,
    Kind.EXPERIMENTS: _experiments,
}
