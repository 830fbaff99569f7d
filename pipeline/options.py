"""What one run of the pipeline may be told."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

DEFAULT_ESTIMATOR = "smoother"
DEFAULT_IDENTIFIER = "whittle"


@dataclass(frozen=True)
class RunOptions:
    """Methods by their registered names, and the rig profile; ``shape`` None: the first one registered."""

    estimator: str = DEFAULT_ESTIMATOR
    identifier: str = DEFAULT_IDENTIFIER
    shape: str | None = None
    rig: Path | None = None

    def as_text(self) -> dict[str, str]:
        """Every option with its value as text, for the provenance of a result."""
        return {name: "" if value is None else str(value) for name, value in asdict(self).items()}
