"""Faults of logs from end to end: each a mutation of a sound log, with the outcome it must have beside it."""
