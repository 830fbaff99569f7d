"""Align: static misalignment, time delay, installation deviations and static phases of a trial."""

from stages.align.alignment import align

__all__ = ["align"]
