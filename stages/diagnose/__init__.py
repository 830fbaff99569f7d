"""Diagnose: where a log departs from its twin, which effect causes it, and how far the gap shrinks."""
