"""What a log holds, as columns: Table, Log, ChannelInfo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.errors import DataError

Column = NDArray[Any]


@dataclass(frozen=True)
class Table:
    """All messages of one topic, a row each, in the order of the log.

    columns: keyed by dotted leaf path. Scalars are (n,), fixed arrays (n, k), stamps and durations (n,) int64 ns,
    strings and sequences of varying length (n,) objects. A column whose rows are all alike may be a read-only broadcast
    of one row. log_time, publish_time: (n,) int64 ns. sequence: (n,) uint32. fields: paths of all columns the messages
    have, which may be more than were asked for.
    """

    topic: str
    schema: str
    columns: dict[str, Column]
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    sequence: NDArray[np.uint32]
    fields: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.log_time)

    def vector(self, path: str) -> NDArray[np.float64]:
        """(n, 3) x, y, z of a geometry_msgs Vector3 or Point. Raises DataError when the channel has none there."""
        return self._stack(path, "xyz")

    def quaternion(self, path: str) -> NDArray[np.float64]:
        """(n, 4) x, y, z, w of a geometry_msgs Quaternion. Raises DataError when the channel has none there."""
        return self._stack(path, "xyzw")

    def _stack(self, path: str, parts: str) -> NDArray[np.float64]:
        names = [f"{path}.{part}" for part in parts]
        missing = [name for name in names if name not in self.columns]
        if missing:
            raise DataError(f"{self.schema} has no field {missing[0]}", channel=self.topic)
        out = np.empty((len(self), len(parts)))
        for k, name in enumerate(names):
            out[:, k] = self.columns[name]
        return out


@dataclass(frozen=True)
class ChannelInfo:
    """One channel of a log; count is None when only reading all of it would tell."""

    topic: str
    schema: str
    schema_encoding: str
    message_encoding: str
    count: int | None = None


@dataclass(frozen=True)
class Attachment:
    """A file stored in a log. The name is only a label, never a path to write to."""

    name: str
    media_type: str
    size: int
    log_time: int


@dataclass(frozen=True)
class Log:
    """A log read from disk. problems: what was lost or odd, a sentence each; empty for a sound log.

    metadata: name -> key -> value. start, end: first and last log time, ns, when known.
    """

    path: Path
    channels: tuple[ChannelInfo, ...]
    tables: dict[str, Table]
    problems: tuple[str, ...] = ()
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: tuple[Attachment, ...] = ()
    start: int | None = None
    end: int | None = None
