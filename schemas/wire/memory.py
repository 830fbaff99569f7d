"""Memory for columns that are written once, from front to back."""

from __future__ import annotations

import math
import mmap
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LARGE = 1 << 20


def fresh(shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """An array of undefined content, like np.empty, but of plain pages where it is large.

    numpy asks the kernel for huge pages. Memory that is filled once gains nothing from them, and finding them costs
    several times what plain pages do where memory has become fragmented.
    """
    size = math.prod(shape) * dtype.itemsize
    if size < _LARGE or dtype.hasobject:
        return np.empty(shape, dtype)
    return np.frombuffer(_pages(size), dtype).reshape(shape)


def _pages(size: int) -> mmap.mmap:
    """Anonymous memory of this process alone (where the system knows the difference)."""
    if sys.platform == "win32":
        return mmap.mmap(-1, size)
    return mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
