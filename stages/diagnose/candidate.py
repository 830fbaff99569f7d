"""A candidate effect of one class of checks, before the selection over all classes."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.diagnosis import Finding

FLOOR_NATS = 14.0  # of evidence; below it nulls of an independent generator drew false names


@dataclass(frozen=True)
class Candidate:
    """What one check says of one effect, as if it were the only one.

    threshold_nats: what the evidence of the finding has to reach. reason: why it cannot be named all the same, empty
    where it can.
    """

    finding: Finding
    threshold_nats: float = FLOOR_NATS
    reason: str = ""

    @property
    def named(self) -> bool:
        """Whether the check would name it."""
        return not self.reason and self.finding.evidence_nats >= self.threshold_nats
