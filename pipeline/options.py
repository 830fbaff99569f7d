"""What one run of the pipeline may be told."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path

from pipeline.settings import Settings

DEFAULT_ESTIMATOR = "smoother"
DEFAULT_IDENTIFIER = "whittle"


@dataclass(frozen=True)
class RunOptions:
    """Methods by their registered names, and the rig profile; ``shape`` None: the first one registered.

    identifier None: the one that goes with the estimator. settings: options of the methods.
    compensate: a diagnosis report whose effects are taken out first.
    """

    estimator: str = DEFAULT_ESTIMATOR
    identifier: str | None = None
    shape: str | None = None
    rig: Path | None = None
    settings: Settings = field(default_factory=Settings)
    compensate: Path | None = None

    def as_text(self) -> dict[str, str]:
        """Every option with its value as text, for the provenance of a result."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: "" if value is None else str(value) for name, value in values.items()}
