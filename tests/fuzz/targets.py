"""What is fuzzed: each target takes bytes and raises nothing, whatever they are."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from mcap import records as mcap

from schemas.errors import DataError
from schemas.wire import read_log, scan_log
from schemas.wire.records import MAGIC
from schemas.wire.section import record_bytes
from stages.decode import decode, health, load_rig
from twin import load_twin

Target = Callable[[bytes], None]
_TAIL = record_bytes(mcap.DataEnd(0)) + record_bytes(mcap.Footer(0, 0, 0)) + MAGIC


def log(data: bytes) -> None:
    """The bytes as a file."""
    _read(data)


def records(data: bytes) -> None:
    """The bytes as the records of a file that is otherwise sound."""
    _read(MAGIC + record_bytes(mcap.Header("ros2", "")) + data + _TAIL)


def message(data: bytes) -> None:
    """The bytes as definition and payload, parted by the first NUL, of both required channels."""
    text, _, payload = data.partition(b"\0")
    body = b""
    for number, topic in enumerate(("/imu/main", "/imu/sub"), start=1):
        body += record_bytes(mcap.Schema(number, text, "ros2msg", "sensor_msgs/msg/Imu"))
        body += record_bytes(mcap.Channel(number, topic, "cdr", {}, number))
        body += b"".join(record_bytes(mcap.Message(number, k, payload, k, 0)) for k in range(3))
    records(body)


def rig(data: bytes) -> None:
    """The bytes as a rig profile."""
    _with_file(data, ".toml", load_rig)


def twin(data: bytes) -> None:
    """The bytes as a twin."""
    _with_file(data, ".toml", lambda path: load_twin(str(path)))


TARGETS: dict[str, Target] = {"log": log, "records": records, "message": message, "rig": rig, "twin": twin}


def _read(data: bytes) -> None:
    _with_file(data, ".mcap", scan_log, read_log, health, decode)


def _with_file(data: bytes, suffix: str, *readers: Callable[[Path], object]) -> None:
    """Each reader on a file of these bytes; a refusal must be one line that names the file."""
    with tempfile.NamedTemporaryFile(suffix=suffix, dir=_memory()) as file:
        file.write(data)
        file.flush()
        for reader in readers:
            try:
                reader(Path(file.name))
            except DataError as error:
                if Path(file.name).name not in str(error) or "\n" in str(error):
                    raise


def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
