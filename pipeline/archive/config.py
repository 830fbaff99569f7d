"""What is done to every log of an archive: plain data that goes to any machine, and its digest.

Rig profile, twin and report go along as texts, so that a worker needs no file of the machine that asks.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from pipeline.options import DEFAULT_ESTIMATOR, RunOptions
from pipeline.settings import parsed
from schemas.errors import DataError

KEY_LENGTH = 32  # hexadecimal digits: 128 bits


class Output(StrEnum):
    """What is kept of a log besides its figures."""

    ESTIMATES = "estimates"
    LOG = "log"
    RECORDING = "recording"
    PAGE = "page"
    TABLES = "tables"
    NOTHING = "nothing"


@dataclass(frozen=True)
class Text:
    """A file by its name and content."""

    name: str
    content: str

    def written(self, folder: Path) -> Path:
        """The file itself, in a folder."""
        path = folder / Path(self.name).name
        path.write_text(self.content, encoding="utf-8")
        return path


@dataclass(frozen=True)
class Config:
    """Options of ``run`` and, with a twin, of ``diagnose``. twin: a file, or a built-in name without content.

    outputs: what is kept of each log. version: of deckflex.
    """

    version: str
    estimator: str = DEFAULT_ESTIMATOR
    identifier: str | None = None
    shape: str | None = None
    settings: tuple[str, ...] = ()
    rig: Text | None = None
    compensate: Text | None = None
    twin: Text | None = None
    outputs: tuple[str, ...] = field(default=(str(Output.ESTIMATES),))
    rrd_rate: float | None = None

    def document(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)

    @property
    def digest(self) -> str:
        """Names the options and the version: equal for equal ones alone."""
        return _digest(self.document())

    def about(self) -> dict[str, str]:
        """The options in words, texts by name and digest."""
        return {name: _told(value) for name, value in self.document().items() if value not in (None, (), [])}

    def run_options(self, folder: Path) -> RunOptions:
        """Options of a run on this machine, texts as files in a folder."""
        rig, report = (text.written(folder) if text else None for text in (self.rig, self.compensate))
        return RunOptions(self.estimator, self.identifier, self.shape, rig, parsed(self.settings), report)


def config_of(document: dict[str, Any]) -> Config:
    """The inverse of :meth:`Config.document`."""
    texts = {name: Text(**document[name]) if document[name] else None for name in ("rig", "compensate", "twin")}
    lists = {name: tuple(document[name]) for name in ("settings", "outputs")}
    return Config(**{**document, **texts, **lists})


def read_text(path: Path) -> Text:
    """A file of this machine as text. Raises DataError."""
    try:
        return Text(path.name, path.read_text("utf-8"))
    except OSError as error:
        raise DataError(f"cannot be read: {error.strerror}", file=path) from error
    except UnicodeDecodeError as error:
        raise DataError("is no text in UTF-8", file=path) from error


def key_of(sha256: str, config: Config) -> str:
    """Names the result of a log's content under options and version."""
    return _digest({"sha256": sha256, "config": config.digest})


def _digest(document: dict[str, Any]) -> str:
    canonical = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(canonical.encode()).hexdigest()[:KEY_LENGTH]


def _told(value: Any) -> str:
    if isinstance(value, dict):
        content = value["content"]
        return f"{value['name']} ({hashlib.sha256(content.encode()).hexdigest()[:12]})" if content else value["name"]
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
