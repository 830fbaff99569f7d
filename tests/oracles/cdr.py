"""Slow, obvious CDR (XCDR1): one value at a time, by the rule of alignment alone."""

from __future__ import annotations

import struct
from typing import Any

CODES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip


class Encoder:
    """Appends values to a message; order is '<' or '>'."""

    def __init__(self, order: str = "<") -> None:
        self.order = order
        self.body = bytearray()

    def bytes(self) -> bytes:
        return bytes([0, 1 if self.order == "<" else 0, 0, 0]) + bytes(self.body)

    def primitive(self, kind: str, value: Any) -> None:
        code = CODES[kind]
        self.body += bytes(-len(self.body) % struct.calcsize(code))
        self.body += struct.pack(self.order + code, value)

    def string(self, value: str) -> None:
        text = value.encode() + b"\0"
        self.primitive("uint32", len(text))
        self.body += text

    def value(self, kind: Any, value: Any) -> None:
        """kind: a primitive's name, 'string', ('array', kind), ('sequence', kind) or a list of (name, kind)."""
        if isinstance(kind, list):
            for name, inner in kind:
                self.value(inner, value[name])
        elif isinstance(kind, tuple):
            if kind[0] == "sequence":
                self.primitive("uint32", len(value))
            for item in value:
                self.value(kind[1], item)
        elif kind == "string":
            self.string(value)
        else:
            self.primitive(kind, value)
