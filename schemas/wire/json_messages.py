"""JSON messages, one at a time, into columns. What the messages hold decides; a JSON schema is not needed."""

from __future__ import annotations

import json
from typing import Any

from schemas.wire.builder import Messages
from schemas.wire.cdr import Bad, Columns, Part
from schemas.wire.rows import Record, UndecodableError, decode_rows, expand


class JsonDecoder:
    """Decodes the JSON objects of one channel."""

    def fields(self) -> tuple[str, ...]:
        """Nothing: the columns are those that occur."""
        return ()

    def finish(self, columns: Columns) -> Columns:
        """The columns of the table; none where there was no message."""
        return expand(columns)

    def decode(self, messages: Messages) -> list[Part | Bad]:
        """Parts that together cover every row once."""
        return decode_rows(messages, _decode)


def _decode(payload: bytes) -> Record:
    try:
        value: Any = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise UndecodableError("not JSON") from error
    if not isinstance(value, dict):
        raise UndecodableError("not a JSON object")
    return value
