"""The C library's heap, told to keep what is given back to it."""

from __future__ import annotations

import ctypes
import os

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # parameters of mallopt
LARGEST_KEPT = 1 << 25  # bytes: more than the C library takes as a threshold


def keep_freed() -> bool:
    """Arrays of up to 32 MB are made from memory that earlier ones left, and not from pages that the system clears anew
    for each: a sixth of the time of a diagnosis. Whether there is a C library that can be told so."""
    try:
        library = ctypes.CDLL(None)
        told = [library.mallopt(TRIM_THRESHOLD, 2**31 - 1), library.mallopt(MMAP_THRESHOLD, LARGEST_KEPT)]
    except (OSError, AttributeError, TypeError):
        return False
    return os.name == "posix" and all(told)
