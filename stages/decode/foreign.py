"""JSON and Protobuf channels as tables: every number of a message a column, keyed by its dotted path.

CDR is decoded in batches by schemas.wire; these encodings vary from message to message and are read one by one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader

from schemas.errors import DataError
from schemas.wire import Log, Table

ENCODINGS = ("json", "protobuf")
MAX_DEPTH = 20
MAX_COLUMNS = 500
"""Numbers per message beyond which it is no sensor message."""

Flat = dict[str, Any]
Reader = Callable[[bytes], Flat]


def with_foreign(log: Log, topics: Collection[str]) -> Log:
    """The log with the tables of those JSON and Protobuf channels among the topics that have none yet."""
    lacking = {
        info.topic
        for info in log.channels
        if info.topic in topics and info.topic not in log.tables and info.message_encoding in ENCODINGS
    }
    if not lacking:
        return log
    refused = tuple(f"{topic}: not decoded" for topic in lacking)
    problems = tuple(problem for problem in log.problems if not problem.startswith(refused))
    return replace(log, tables=log.tables | read_foreign(log.path, lacking), problems=problems)


def read_foreign(path: Path | str, topics: Collection[str]) -> dict[str, Table]:
    """Tables of the JSON and Protobuf channels among the topics, in the order of the log.

    Raises DataError where a message does not follow its schema, or the file ends before it should.
    """
    rows: dict[str, list[tuple[Flat, int, int, int]]] = {}
    schemas: dict[str, str] = {}
    readers: dict[int, Reader] = {}
    with Path(path).open("rb") as file:
        for schema, channel, message in _messages(make_reader(file, validate_crcs=True), topics, path):
            if channel.message_encoding not in ENCODINGS:
                continue
            if channel.id not in readers:
                readers[channel.id] = _reader(channel.message_encoding, schema, channel.topic)
                schemas[channel.topic] = schema.name if schema is not None else ""
            flat = _read(readers[channel.id], message.data, channel.topic)
            times = (message.log_time, message.publish_time, message.sequence)
            rows.setdefault(channel.topic, []).append((flat, *times))
    return {topic: _table(topic, schemas[topic], found) for topic, found in rows.items()}


def _messages(reader: Any, topics: Collection[str], path: Path | str) -> Iterator[tuple[Any, Any, Any]]:
    try:
        yield from reader.iter_messages(topics=list(topics), log_time_order=False)
    except (McapError, EOFError, OSError, ValueError) as error:
        raise DataError(f"its JSON or Protobuf channels cannot be read: {error or type(error).__name__}") from error


def _read(reader: Reader, data: bytes, topic: str) -> Flat:
    try:
        return reader(data)
    except (ValueError, RecursionError) as error:
        raise DataError(f"a message does not follow its encoding: {error}", channel=topic) from error


def _reader(encoding: str, schema: Any, topic: str) -> Reader:
    if encoding == "json":
        return _read_json
    try:
        return _protobuf_reader(schema)
    except Exception as error:
        raise DataError(f"its Protobuf schema cannot be used: {error}", channel=topic) from error


def _read_json(data: bytes) -> Flat:
    message = json.loads(data)
    if not isinstance(message, dict):
        raise ValueError("the message is no JSON object")
    return dict(_flattened("", message, 0))


def _protobuf_reader(schema: Any) -> Reader:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory  # type: ignore[import-untyped]
    from google.protobuf.message import DecodeError  # type: ignore[import-untyped]

    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    waiting = {file.name: file for file in files.file}

    def add(name: str) -> None:
        file = waiting.pop(name, None)
        if file is not None:
            for needed in file.dependency:
                add(needed)
            pool.Add(file)

    for name in list(waiting):
        add(name)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))

    def read(data: bytes) -> Flat:
        try:
            return dict(_flattened("", _as_mapping(kind.FromString(data), 0), 0))
        except DecodeError as error:
            raise ValueError(str(error)) from error

    return read


def _as_mapping(message: Any, depth: int) -> dict[str, Any]:
    """All singular fields, set or not (proto3 leaves zeros out), and the repeated numbers."""
    if depth > MAX_DEPTH:
        raise ValueError("the message is nested too deeply")
    found: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        is_message = field.message_type is not None
        if hasattr(value, "append") or hasattr(value, "items"):
            found[field.name] = [] if is_message else list(value)
        elif is_message:
            found[field.name] = _as_mapping(value, depth + 1)
        else:
            found[field.name] = value
    return found


def _flattened(prefix: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    if depth > MAX_DEPTH:
        raise ValueError("the message is nested too deeply")
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _flattened(f"{prefix}.{name}" if prefix else str(name), part, depth + 1)
    elif isinstance(value, list):
        numbers = bool(value) and len(value) <= MAX_COLUMNS and all(isinstance(one, int | float) for one in value)
        if numbers:
            yield prefix, tuple(float(one) for one in value)
    elif value is None or isinstance(value, bool | int | float | str):
        yield prefix, value


def _table(topic: str, schema: str, rows: list[tuple[Flat, int, int, int]]) -> Table:
    names = dict.fromkeys(name for flat, *_ in rows for name in flat)
    if len(names) > MAX_COLUMNS:
        raise DataError(f"its messages have {len(names)} different fields", channel=topic)
    log_time, publish_time, sequence = (np.array(column) for column in list(zip(*rows))[1:])
    return Table(
        topic=topic,
        schema=schema,
        columns={name: _column([flat.get(name) for flat, *_ in rows]) for name in names},
        log_time=log_time.astype(np.int64),
        publish_time=publish_time.astype(np.int64),
        sequence=sequence.astype(np.uint32),
    )


def _column(cells: list[Any]) -> np.ndarray:
    """int64 where all are whole numbers, float64 where all are numbers (NaN where missing), else objects."""
    kinds = {type(cell) for cell in cells}
    if kinds <= {int, bool} and all(-(2**63) <= cell < 2**63 for cell in cells):
        return np.array(cells, dtype=np.int64)
    if kinds <= {int, float, bool, type(None)}:
        return np.array([np.nan if cell is None else cell for cell in cells], dtype=np.float64)
    if kinds == {tuple} and len({len(cell) for cell in cells}) == 1:
        return np.array(cells, dtype=np.float64)
    column = np.empty(len(cells), dtype=object)
    column[:] = cells
    return column
