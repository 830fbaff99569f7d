"""What is wrong with a rig profile, in one line with the key's path."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError


def first_error(error: ValidationError, model: type[BaseModel]) -> str:
    """One sentence on the first problem, and how many more there are."""
    problems = error.errors(include_url=False, include_context=False)
    more = len({_key(problem["loc"]) for problem in problems}) - 1
    text = _sentence(problems[0], model)
    return f"{text} (and {more} more)" if more > 0 else text


def _sentence(problem: Any, model: type[BaseModel]) -> str:
    key = _key(problem["loc"])
    if problem["type"] == "extra_forbidden":
        return f"unknown key {key}{_suggestion(problem['loc'], model)}"
    message = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"].startswith(("model_", "dict_")):
        message = "should be a table"
    given = problem["input"]
    shown = f", not {given!r}" if isinstance(given, str | int | float) and problem["type"] != "value_error" else ""
    return f"{key}: {_lowered(message)}{shown}" if key else message


def _key(location: Iterable[Any]) -> str:
    """Dotted path of the key; pydantic's names of union branches are no part of it."""
    return ".".join(str(part) for part in location if not _is_branch(part))


def _is_branch(part: Any) -> bool:
    return isinstance(part, str) and (part == "str" or "[" in part)


def _lowered(text: str) -> str:
    return text[:1].lower() + text[1:]


def _suggestion(location: tuple[Any, ...], model: type[BaseModel]) -> str:
    known = list(_keys_at(model, location[:-1]))
    close = get_close_matches(str(location[-1]), known, n=1)
    return f"; did you mean {close[0]}?" if close else f"; known there: {', '.join(known)}"


def _keys_at(model: type[BaseModel], path: tuple[Any, ...]) -> Iterable[str]:
    for part in path:
        inner = model.model_fields[str(part)].annotation
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return ()
        model = inner
    return model.model_fields.keys()
