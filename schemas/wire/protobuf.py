"""Protobuf messages, one at a time, into columns, by the FileDescriptorSet that the log carries as schema."""

from __future__ import annotations

from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory  # type: ignore[import-untyped]
from google.protobuf.message import DecodeError, Message  # type: ignore[import-untyped]

from schemas.errors import DataError
from schemas.wire.builder import Messages
from schemas.wire.cdr import Bad, Columns, Part
from schemas.wire.rows import MAX_DEPTH, Record, UndecodableError, bad_schema, decode_rows, expand

_TIMES = ("google.protobuf.Timestamp", "google.protobuf.Duration")


class ProtobufDecoder:
    """Decodes the messages of one channel. Raises DataError for a descriptor set that does not define the type."""

    def __init__(self, name: str, descriptors: bytes) -> None:
        pool = descriptor_pool.DescriptorPool()
        try:
            for file in _sorted_files(descriptor_pb2.FileDescriptorSet.FromString(descriptors)):
                pool.Add(file)
            self._type: Any = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
        except DataError:
            raise
        except Exception as error:
            raise bad_schema("protobuf", error) from error

    def fields(self) -> tuple[str, ...]:
        """Nothing: the columns are those that occur."""
        return ()

    def finish(self, columns: Columns) -> Columns:
        """The columns of the table; none where there was no message."""
        return expand(columns)

    def decode(self, messages: Messages) -> list[Part | Bad]:
        """Parts that together cover every row once."""
        return decode_rows(messages, self._decode)

    def _decode(self, payload: bytes) -> Record:
        try:
            return _values(self._type.FromString(payload), ())
        except DecodeError as error:
            raise UndecodableError("not a message of its schema") from error


def _sorted_files(descriptors: descriptor_pb2.FileDescriptorSet) -> list[descriptor_pb2.FileDescriptorProto]:
    """Files after those they import."""
    waiting = {file.name: file for file in descriptors.file}
    done: list[descriptor_pb2.FileDescriptorProto] = []
    while waiting:
        ready = [name for name, file in waiting.items() if not set(file.dependency) & set(waiting)]
        if not ready:
            raise DataError("its protobuf schema imports in a circle")
        done += [waiting.pop(name) for name in ready]
    return done


def _values(message: Message, above: tuple[str, ...]) -> dict[str, Any]:
    """Every field by name; submessages that are not set as their defaults, Timestamp and Duration as int ns.

    above: types of the messages this one is part of. A type that holds itself ends where it is not set.
    """
    if len(above) > MAX_DEPTH:
        raise UndecodableError(f"nested more than {MAX_DEPTH} deep")
    above = (*above, message.DESCRIPTOR.full_name)
    out: dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.message_type is None:
            out[field.name] = list(value) if _repeated(field) else value
        elif field.message_type.GetOptions().map_entry:
            out[field.name] = repr(dict(value))
        elif _repeated(field):
            out[field.name] = [_submessage(item, above) for item in value]
        elif field.message_type.full_name not in above or message.HasField(field.name):
            out[field.name] = _submessage(value, above)
    return out


def _repeated(field: Any) -> bool:
    return bool(field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED)


def _submessage(value: Any, above: tuple[str, ...]) -> Any:
    if value.DESCRIPTOR.full_name in _TIMES:
        return int(value.seconds) * 1_000_000_000 + int(value.nanos)
    return _values(value, above)
