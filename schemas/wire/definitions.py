"""ROS 2 message definitions (``ros2msg``): parsed from the text in a log, or read from ``schemas/msg``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from schemas.errors import DataError

SEPARATOR = "=" * 80
MAX_DEPTH = 32
_FOLDER = Path(__file__).parent.parent / "msg"

# IDL calls them octet and char; both are eight bits wide on the wire.
PRIMITIVES = {
    "bool": "?",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
_TIME_FIELDS = {TIMES[0]: "int32 sec\nuint32 nanosec", TIMES[1]: "int32 sec\nuint32 nanosec"}
# A message without fields still takes one byte, a member of this name.
EMPTY_MEMBER = "structure_needs_at_least_one_member"

_TYPE = re.compile(r"^(?P<base>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?:(?P<bound><=)?(?P<size>\d+))?\])?$")


@dataclass(frozen=True)
class Field:
    """One member. base: primitive, ``string``, ``wstring`` or a full message name. size: of a fixed array."""

    name: str
    base: str
    size: int | None = None
    sequence: bool = False


@dataclass(frozen=True)
class MessageType:
    """A message type with all it depends on. fields: by full name, e.g. ``std_msgs/msg/Header``."""

    name: str
    fields: Mapping[str, tuple[Field, ...]]

    @property
    def root(self) -> tuple[Field, ...]:
        """The members of the type itself."""
        return self.fields[self.name]


def full_name(name: str, package: str = "") -> str:
    """``pkg/msg/Name`` of ``pkg/Name``, ``pkg/msg/Name`` or a bare ``Name`` seen from a package."""
    parts = name.split("/")
    if len(parts) == 1:
        return "std_msgs/msg/Header" if name == "Header" else f"{package}/msg/{name}"
    return f"{parts[0]}/msg/{parts[-1]}"


def parse(name: str, text: str) -> MessageType:
    """The type that a ros2msg text defines (root first, dependencies after separator lines).

    Raises DataError naming the line or the type that is wrong, missing, recursive or nested too deeply.
    """
    root = full_name(name)
    sections = re.split(r"^={3,}[ \t]*\r?$", text, flags=re.MULTILINE)
    fields = {root: _parse_fields(root, sections[0])}
    for section in sections[1:]:
        head, _, body = section.strip().partition("\n")
        if not head.startswith("MSG:"):
            raise DataError(f"definition of {root}: a section does not start with 'MSG:' but with '{head[:60]}'")
        section_name = full_name(head[4:].strip())
        fields.setdefault(section_name, _parse_fields(section_name, body))
    for time in TIMES:
        fields.setdefault(time, _parse_fields(time, _TIME_FIELDS[time]))
    _check(root, fields)
    return MessageType(root, fields)


def _parse_fields(owner: str, text: str) -> tuple[Field, ...]:
    fields = [found for line in text.splitlines() if (found := _parse_line(owner, line)) is not None]
    names = [found.name for found in fields]
    if len(set(names)) != len(names):
        raise DataError(f"definition of {owner}: a field is named twice")
    return tuple(fields) or (Field(EMPTY_MEMBER, "uint8"),)


def _parse_line(owner: str, line: str) -> Field | None:
    """The field of one line; None for constants, comments and blank lines (defaults do not travel on the wire)."""
    words = line.split("#", 1)[0].split(None, 2)
    if not words:
        return None
    match = _TYPE.match(words[0])
    if match is None or len(words) < 2:
        raise DataError(f"definition of {owner}: cannot read the line '{line.strip()[:80]}'")
    name, rest = words[1], "".join(words[2:])
    if "=" in name or rest.startswith("="):
        return None
    if not re.fullmatch(r"[A-Za-z]\w*", name):
        raise DataError(f"definition of {owner}: '{name[:60]}' is no field name")
    base = match["base"]
    if base not in PRIMITIVES and base not in ("string", "wstring"):
        base = full_name(base, owner.split("/")[0])
    fixed = match["size"] is not None and match["bound"] is None
    sequence = match["array"] is not None and not fixed
    return Field(name, base, int(match["size"]) if fixed else None, sequence)


def _check(name: str, fields: Mapping[str, tuple[Field, ...]], above: tuple[str, ...] = ()) -> None:
    if name in above:
        raise DataError(f"definition of {above[0]}: {name} contains itself")
    if name not in fields:
        raise DataError(f"definition of {above[0] if above else name}: {name} is not defined")
    if len(above) >= MAX_DEPTH:
        raise DataError(f"definition of {above[0]}: nested more than {MAX_DEPTH} deep")
    for base in {field.base for field in fields[name]}:
        if base == "wstring":
            raise DataError(f"definition of {(*above, name)[0]}: {name} holds a wstring, which is not supported")
        if base not in PRIMITIVES and base != "string":
            _check(base, fields, (*above, name))


@cache
def definition(name: str) -> str:
    """Full ros2msg text of a type in ``schemas/msg``, its dependencies after separator lines.

    Raises KeyError for a type that is not there.
    """
    root = full_name(name)
    sections = [_own_text(root)]
    for needed in _dependencies(root):
        package, _, short = needed.split("/")
        sections.append(f"MSG: {package}/{short}\n{_own_text(needed)}")
    return f"{SEPARATOR}\n".join(sections)


def defined() -> tuple[str, ...]:
    """Full names of the types in ``schemas/msg``."""
    return tuple(sorted(path.stem.replace(".", "/msg/") for path in _FOLDER.glob("*.msg")))


@cache
def message_type(name: str) -> MessageType:
    """The parsed type of a definition in ``schemas/msg``. Raises KeyError if unknown."""
    return parse(name, definition(name))


def _own_text(name: str) -> str:
    package, _, short = name.split("/")
    if name not in defined():
        raise KeyError(f"no definition of {name}; there are: {', '.join(defined())}")
    return (_FOLDER / f"{package}.{short}.msg").read_text(encoding="utf-8")


def _dependencies(name: str) -> list[str]:
    """Every other type that a type needs, in the order in which it is first met."""
    found: list[str] = []
    for field in _parse_fields(name, _own_text(name)):
        if field.base not in PRIMITIVES and field.base not in ("string", "wstring"):
            found += [needed for needed in (field.base, *_dependencies(field.base)) if needed not in found]
    return list(dict.fromkeys(found))
