"""Options of methods from the command line: ``--set KEY=VALUE`` or ``--set METHOD.KEY=VALUE``.

A key without a method is the estimator's. Values are written as in TOML; a bare word is text. Wrong ones are a
ValueError with what there is.
"""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

STAGES = ("estimate", "identify", "shape")


@dataclass(frozen=True)
class Setting:
    """One option; method empty: the estimator's."""

    method: str
    key: str
    value: Any
    text: str


@dataclass(frozen=True)
class Settings:
    """All options that were given."""

    given: tuple[Setting, ...] = ()

    def __str__(self) -> str:
        return " ".join(setting.text for setting in self.given)

    def made(self, stage: str, name: str) -> Any:
        """A method of a stage, with those of the options that are its own."""
        method = import_module(f"stages.{stage}").get(name)
        own = {s.key: _fitting(name, method, s) for s in self.given if _meant(s, stage, name, method)}
        try:
            return method(**own)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error

    def check(self, chosen: Sequence[tuple[str, str]]) -> None:
        """Raise ValueError unless each option is one of the chosen methods', (stage, name) each."""
        for stage, name in chosen:
            self.made(stage, name)
        methods = [(stage, name, import_module(f"stages.{stage}").get(name)) for stage, name in chosen]
        for setting in self.given:
            if not any(_meant(setting, *method) for method in methods):
                known = "; ".join(f"{name}: {', '.join(method.options) or 'none'}" for _, name, method in methods)
                raise ValueError(f"'{setting.text}' is an option of no method that runs here; there are: {known}")


def parsed(words: Sequence[str]) -> Settings:
    """Settings from the words of the command line."""
    return Settings(tuple(_setting(word) for word in words))


def _setting(word: str) -> Setting:
    target, equals, text = word.partition("=")
    method, _, key = target.strip().rpartition(".")
    if not equals or not key:
        raise ValueError(f"'{word}' is not KEY=VALUE or METHOD.KEY=VALUE")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    return Setting(method, key, value, word)


def _meant(setting: Setting, stage: str, name: str, method: Any) -> bool:
    whose = setting.method == name if setting.method else stage == STAGES[0]
    return whose and setting.key in method.options


def _fitting(name: str, method: Any, setting: Setting) -> Any:
    """The value, if it is of the kind that the option's default is of."""
    default, value = inspect.signature(method).parameters[setting.key].default, setting.value
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    kinds = (list,) if isinstance(default, tuple) else (str,) if isinstance(default, str) else (type(default),)
    if default is not None and not (isinstance(value, kinds) and isinstance(value, bool) == isinstance(default, bool)):
        wanted = {bool: "true or false", list: "a list"}.get(kinds[0], f"like {default}")
        raise ValueError(f"'{setting.text}': {setting.key} of {name} is {wanted}")
    return value
