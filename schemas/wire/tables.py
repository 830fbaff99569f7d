"""Batches of messages sorted into the tables of their topics, each by the decoder of its encoding."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from mcap import records as mcap
from numpy.typing import NDArray

from schemas.errors import DataError
from schemas.wire.builder import CdrDecoder, MessageDecoder, Messages, TableBuilder
from schemas.wire.cdr import Decoder
from schemas.wire.definitions import full_name, parse
from schemas.wire.memory import Supply
from schemas.wire.one_pass import Pass
from schemas.wire.plan import Plan
from schemas.wire.table import Table


class Tables:
    """Sorts batches into the tables of their topics."""

    def __init__(self, topics: Collection[str] | None, columns: Mapping[str, Collection[str]]) -> None:
        self.topics, self.columns = topics, columns
        self.problems: list[str] = []
        self._builders: dict[str, TableBuilder | None] = {}
        self._announced: dict[int, int] = {}
        self._foreign: set[int] = set()
        self._owners: dict[str, int] = {}
        self._supply = Supply()

    def expect(self, counts: dict[int, int]) -> None:
        """Take note of how many messages each channel announces."""
        self._announced = counts

    def add(self, channel: mcap.Channel, schema: mcap.Schema | None, batch: Messages) -> None:
        """Append a batch to the table of its topic."""
        builder = self._builder(channel, schema)
        if builder is None:
            return
        if builder.schema == schema_name(schema):
            builder.add(batch)
        elif channel.id not in self._foreign:
            self._foreign.add(channel.id)
            self.problems.append(
                f"{channel.topic}: carries {builder.schema} and also {schema_name(schema)}; the latter is left out"
            )

    def plan(self, channel: mcap.Channel, record: NDArray[np.uint8]) -> tuple[Plan | None, TableBuilder | None]:
        """How to take messages of a channel like record, the last one added, and the builder they belong to."""
        builder = self._builders.get(channel.topic)
        alone = self._owners.setdefault(channel.topic, channel.id) == channel.id
        if builder is None or not alone:
            return None, builder
        return builder.plan(record), builder

    def tables(self, pass_: Pass) -> dict[str, Table]:
        """The finished tables in the order of their channels, empty ones for channels without messages."""
        done: dict[str, Table] = {}
        for channel in pass_.channels.values():
            if channel.topic in done or (self.topics is not None and channel.topic not in self.topics):
                continue
            builder = self._builder(channel, pass_.schemas.get(channel.schema_id))
            if builder is not None:
                done[channel.topic] = builder.table()
                self.problems += builder.problems()
        return done

    def _builder(self, channel: mcap.Channel, schema: mcap.Schema | None) -> TableBuilder | None:
        if channel.topic not in self._builders:
            expected = self._announced.get(channel.id, 0)
            try:
                decoder = make_decoder(channel, schema, self.columns.get(channel.topic))
                self._builders[channel.topic] = TableBuilder(
                    channel.topic, schema_name(schema), decoder, expected, supply=self._supply
                )
            except DataError as error:
                self._builders[channel.topic] = None
                self.problems.append(f"{channel.topic}: not decoded: {error.problem}")
        return self._builders[channel.topic]


def make_decoder(channel: mcap.Channel, schema: mcap.Schema | None, wanted: Collection[str] | None) -> MessageDecoder:
    """The decoder of a channel's encoding, for the columns wanted (None: all). Raises DataError when there is none."""
    encoding = (channel.message_encoding, schema.encoding if schema is not None else "")
    if schema is not None and encoding == ("cdr", "ros2msg"):
        return CdrDecoder(Decoder(parse(schema.name, schema.data.decode("utf-8", errors="replace")), wanted))
    if schema is not None and encoding == ("protobuf", "protobuf"):
        from schemas.wire.protobuf import ProtobufDecoder  # slow to import and rarely needed

        return ProtobufDecoder(schema.name, schema.data)
    if encoding[0] == "json" and encoding[1] in ("", "jsonschema"):
        from schemas.wire.json_messages import JsonDecoder

        return JsonDecoder()
    raise DataError(f"message encoding '{encoding[0]}' with schema encoding '{encoding[1]}' is not supported")


def schema_name(schema: mcap.Schema | None) -> str:
    """The full name of a schema; empty where there is none."""
    if schema is None:
        return ""
    return full_name(schema.name) if schema.encoding == "ros2msg" else schema.name
