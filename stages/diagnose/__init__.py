"""Diagnose: where a log departs from its twin, which effect causes it, and how far the gap shrinks."""

from stages.diagnose.sections import diagnose

__all__ = ["diagnose"]
