"""Messages decoded one at a time into nested values, made into columns: the path of the slower encodings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.builder import Messages
from schemas.wire.cdr import Bad, Columns, Part

Record = Mapping[str, Any]
MAX_DEPTH = 32
_RECORD = "/record"  # no field can have this name
_TIME_KEYS = ({"sec", "nsec"}, {"sec", "nanosec"}, {"seconds", "nanos"}, {"secs", "nsecs"})


class UndecodableError(Exception):
    """One message that cannot be decoded, and why."""


def decode_rows(messages: Messages, decode: Callable[[bytes], Record]) -> list[Part | Bad]:
    """Parts that cover every message: decoded rows and, by reason, those that could not be decoded.

    The decoded rows have one column, of flattened records, for :func:`expand` to split when all of them are there.
    """
    records: list[dict[str, Any]] = []
    good: list[int] = []
    bad: dict[str, list[int]] = {}
    for row in range(len(messages)):
        try:
            records.append(dict(flatten(decode(messages.payload(row)))))
            good.append(row)
        except UndecodableError as error:
            bad.setdefault(str(error), []).append(row)
    parts: list[Part | Bad] = [Bad(np.array(rows), reason) for reason, rows in bad.items()]
    if good:
        column = np.empty(len(good), dtype=object)
        column[:] = records
        parts.append(Part(np.array(good), {(_RECORD,): column}))
    return parts


def flatten(record: Record, prefix: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """(dotted path, value) of every leaf; a pair of seconds and nanoseconds is one leaf, int ns."""
    if depth > MAX_DEPTH:
        raise UndecodableError(f"nested more than {MAX_DEPTH} deep")
    for key, value in record.items():
        path = f"{prefix}{key}"
        if not isinstance(value, Mapping):
            yield path, value
        elif set(value) in _TIME_KEYS and all(type(part) is int for part in value.values()):
            seconds, nanoseconds = value.values() if next(iter(value)).startswith("sec") else (*value.values(),)[::-1]
            yield path, seconds * 1_000_000_000 + nanoseconds
        else:
            yield from flatten(value, f"{path}.", depth + 1)


def expand(columns: Columns) -> Columns:
    """A column for every path that occurs in the records; a record without it has None there (NaN among numbers)."""
    records = columns.get(_RECORD, np.zeros(0, dtype=object))
    paths = dict.fromkeys(path for record in records for path in record)
    out: Columns = {}
    for path in paths:
        column = np.empty(len(records), dtype=object)
        for row, record in enumerate(records):
            column[row] = record.get(path)
        out[path] = settle(column)
    return out


def settle(values: NDArray[Any]) -> NDArray[Any]:
    """The column in the plainest type that holds all its values.

    Booleans (n,); integers (n,) int64; numbers (n,) float64, missing ones NaN; lists of numbers of one length (n, k)
    float64; anything else stays objects, lists as arrays.
    """
    kinds = {type(value) for value in values}
    if kinds == {bool}:
        return values.astype(np.bool_)
    if kinds == {int} and all(-(2**63) <= value < 2**63 for value in values):
        return values.astype(np.int64)
    if kinds and kinds <= {int, float, type(None)} and kinds != {type(None)}:
        return np.array([np.nan if value is None else float(value) for value in values])
    if kinds == {list} or kinds == {np.ndarray}:
        return _settle_lists(values)
    return values


def _settle_lists(values: NDArray[Any]) -> NDArray[Any]:
    lengths = {len(value) for value in values}
    numeric = all(isinstance(item, (int, float)) for value in values for item in value)
    if numeric and len(lengths) == 1:
        return np.array([[float(item) for item in value] for value in values]).reshape(len(values), -1)
    out = np.empty(len(values), dtype=object)
    for row, value in enumerate(values):
        out[row] = np.array(value, dtype=float if numeric else object)
    return out


def bad_schema(encoding: str, error: Exception) -> DataError:
    """The error for a schema that cannot be used."""
    return DataError(f"its {encoding} schema cannot be used ({str(error)[:120]})")
