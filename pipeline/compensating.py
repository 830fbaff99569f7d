"""``run --compensate``: the effects that a diagnosis report names, taken out of a log before estimating.

The report is the JSON document of ``deckflex diagnose``; effects are rebuilt from its parameters, and what they are
measured against is the twin it names, the augmented one without them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.files import reason
from schemas.errors import DataError
from schemas.trial import Trial
from twin import effects, load_twin, parse_twin
from twin.compensation import Compensated, compensate
from twin.config import Twin
from twin.effects import Effect


@dataclass(frozen=True)
class Remedy:
    """What a report says to take out. twin: what the effects are measured against."""

    path: Path
    effects: tuple[Effect, ...]
    twin: Twin

    def applied(self, trial: Trial) -> Compensated:
        """The log without the effects, and how to put real bending back."""
        freed = compensate(trial, self.effects, self.twin)
        return freed if self.effects else replace(freed, notes=("nothing: the report names no effect",))


def load_remedy(path: Path) -> Remedy:
    """From a diagnosis report; ``DataError`` in one line for one that cannot be used."""
    try:
        report = _document(path)
        found = tuple(_effect(entry) for entry in _list(report, "effects"))
        return Remedy(path, found, _base(_twin(report, path), found))
    except DataError as error:
        raise error.located(file=path) from error


def _document(path: Path) -> Mapping[str, Any]:
    try:
        report = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise DataError(f"the report cannot be read: {reason(error)}") from error
    except (ValueError, RecursionError) as error:
        raise DataError("the report is not a JSON document") from error
    if not isinstance(report, dict):
        raise DataError("the report is no diagnosis report: its JSON is not an object")
    return report


def _list(report: Mapping[str, Any], key: str) -> list[Any]:
    entries = report.get(key)
    if not isinstance(entries, list):
        raise DataError(f"the report is no diagnosis report: it has no list '{key}'")
    return entries


def _effect(entry: Any) -> Effect:
    """An effect from its name and parameters as ``{name: {"value", "std", "unit"}}``, vectors by axis."""
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise DataError("an effect of the report has no name")
    given = entry.get("parameters")
    if not isinstance(given, dict):
        raise DataError(f"effect '{entry['name']}' of the report has no parameters")
    values = {name: _value(item) for name, item in given.items()}
    return effects.build(entry["name"], {name: value for name, value in values.items() if value is not None})


def _value(item: Any) -> Any:
    """A number or word, or a table of them by axis; None where the report knows none."""
    if not isinstance(item, dict):
        return item
    if "value" in item:
        return item["value"]
    axes = {axis: _value(part) for axis, part in item.items()}
    return {axis: value for axis, value in axes.items() if value is not None} or None


def _twin(report: Mapping[str, Any], path: Path) -> Twin:
    """The augmented twin, inline or in a file beside the report, else the twin by its name."""
    text = report.get("augmented_twin")
    if isinstance(text, str) and "=" in text:
        return parse_twin(text)
    for name in (text, report.get("twin")):
        if not isinstance(name, str) or not name:
            continue
        beside = path.parent / name
        return load_twin(beside if beside.is_file() else name)
    raise DataError("the report names no twin that its effects are measured against")


def _base(twin: Twin, found: tuple[Effect, ...]) -> Twin:
    """The twin without the last effects of the names found."""
    kept, names = [], [effect.name for effect in found]
    for effect in reversed(twin.effect):
        if effect.name in names:
            names.remove(effect.name)
        else:
            kept.append(effect)
    return twin.model_copy(update={"effect": tuple(reversed(kept))})
