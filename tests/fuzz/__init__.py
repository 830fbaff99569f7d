"""Fuzzing: what strangers hand in may be refused, in one line, and do no more than that.

``python -m tests.fuzz`` searches, guided by coverage; ``corpus/`` keeps what it started from and what it found.
"""
