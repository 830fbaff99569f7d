"""Twins from and to TOML."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from schemas.errors import DataError
from twin import effects
from twin.config import Twin


def built_in() -> tuple[str, ...]:
    """Names of the twins that come with the project, sorted."""
    folder = resources.files("twin") / "twins"
    return tuple(sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_twin(name_or_path: str | Path) -> Twin:
    """A built-in twin by name, or a TOML file; raises ``DataError`` that names the key or the line at fault."""
    path = Path(name_or_path)
    if str(name_or_path) in built_in():
        return parse_twin((resources.files("twin") / "twins" / f"{name_or_path}.toml").read_text("utf-8"))
    if path.suffix != ".toml" and not path.exists():
        raise DataError(f"there is no built-in twin named '{name_or_path}' (there are {', '.join(built_in())})")
    try:
        text = path.read_text("utf-8")
    except OSError as problem:
        raise DataError(f"the twin cannot be read: {problem.strerror}", file=path) from problem
    except UnicodeDecodeError as problem:
        raise DataError("the twin is not a text file in UTF-8", file=path) from problem
    return parse_twin(text, file=path)


def parse_twin(text: str, *, file: Path | str | None = None) -> Twin:
    """A twin from TOML text; ``file`` is for messages only."""
    try:
        table = tomllib.loads(text)
    except ValueError as problem:  # TOMLDecodeError is one, a number of thousands of digits another
        raise DataError(f"not valid TOML: {problem}", file=file) from problem
    except RecursionError as problem:
        raise DataError("not valid TOML: nested too deeply", file=file) from problem
    return make_twin(table, file=file)


def make_twin(table: Mapping[str, Any], *, file: Path | str | None = None) -> Twin:
    """A twin from nested tables; unknown keys, wrong values and unknown effects are a ``DataError``."""
    try:
        twin = Twin.model_validate(table)
        for effect in twin.effect:
            effects.build(effect.name, effect.parameters)
    except ValidationError as problem:
        raise DataError(_told(problem), file=file) from problem
    except DataError as problem:
        raise problem.located(file=file) from problem
    return twin


def with_run(twin: Twin, **values: Any) -> Twin:
    """The twin with other values in its [run] table (duration, rate, seed, start), checked as a file's would be."""
    return make_twin({**twin.model_dump(), "run": {**twin.run.model_dump(), **values}})


def dump_twin(twin: Twin) -> str:
    """TOML text that :func:`parse_twin` reads back as the same twin."""
    tables = twin.model_dump(exclude_none=True)
    return "\n".join(_table("", tables)) + "\n"


def _told(problem: ValidationError) -> str:
    """The first fault as a sentence, the key as it would be written in the file."""
    error = problem.errors()[0]
    key = ".".join(str(part) for part in error["loc"]) or "twin"
    more = f" (and {problem.error_count() - 1} more)" if problem.error_count() > 1 else ""
    if error["type"] == "extra_forbidden":
        return f"unknown key '{key}'{more}"
    message = error["msg"].removeprefix("Value error, ")
    return f"'{key}': {message[0].lower()}{message[1:]}, not {error['input']!r:.80}{more}"


def _table(path: str, table: Mapping[str, Any]) -> list[str]:
    """Lines of one table: its plain values first, then its tables and arrays of tables."""
    plain = {k: v for k, v in table.items() if not isinstance(v, dict) and not _is_tables(v)}
    lines = [f"{_key(key)} = {_value(value)}" for key, value in plain.items()]
    for key, value in table.items():
        name = f"{path}.{_key(key)}" if path else _key(key)
        if isinstance(value, dict):
            lines += ["", f"[{name}]", *_table(name, value)]
        elif _is_tables(value):
            for entry in value:
                lines += ["", f"[[{name}]]", *_table(name, entry)]
    return lines


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _is_tables(value: object) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(isinstance(entry, dict) for entry in value)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(entry) for entry in value) + "]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
    return repr(float(value) if isinstance(value, float) else value)
