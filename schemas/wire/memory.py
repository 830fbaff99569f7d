"""Memory for columns that are filled once, from front to back.

Having the kernel hand out a page at each first touch takes longer than decoding what goes into it. Asking for many at
a time takes two thirds of that, and huge pages a sixth, but many times more where memory has become fragmented or a
virtual machine's host must find it first. So huge pages are asked for one by one, as long as they are worth it. Large
columns lie in a file (:mod:`schemas.scratch`) and give back what is filled.
"""

from __future__ import annotations

import math
import mmap
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas import scratch

_LARGE = 1 << 20
_STEP = 1 << 21  # bytes of a huge page, and of what is asked for at a time
_KEPT = 1 << 22  # bytes behind what is filled now that stay in memory
_WORTH = 5e-4  # s of CPU for a huge page on average; plain pages of that size take twice as long
_PATIENCE = 0.01  # s beyond that before plain pages are taken instead
_HUGE, _PLAIN, _POPULATE = 14, 15, 23  # MADV_HUGEPAGE, MADV_NOHUGEPAGE, MADV_POPULATE_WRITE of Linux


class Supply:
    """Pages for several arrays; remembers what huge ones have cost."""

    def __init__(self) -> None:
        self._spent = 0.0
        self._taken = 0
        self.helps = sys.platform == "linux"

    def provide(self, pages: mmap.mmap, start: int, size: int) -> None:
        """Have the kernel hand out the bytes start..start + size of pages now."""
        filed = isinstance(pages, scratch.Pages)
        huge = not filed and size == _STEP and self._spent <= _PATIENCE + _WORTH * self._taken
        before = time.thread_time()
        if filed and start >= _KEPT:
            pages.madvise(mmap.MADV_DONTNEED, 0, start - _KEPT)
        try:
            if not filed:
                pages.madvise(_HUGE if huge else _PLAIN, start, size)
            if self.helps:
                pages.madvise(_POPULATE, start, size)
        except OSError:
            self.helps = False  # an older kernel: pages come when they are touched
        if huge:
            self._spent += time.thread_time() - before
            self._taken += 1


class Room:
    """An array of undefined content, like np.empty, whose pages come ahead of the writing."""

    def __init__(self, supply: Supply, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self._supply = supply
        self._size = math.prod(shape) * dtype.itemsize
        self._row = self._size // shape[0] if shape[0] else 0
        self._pages: mmap.mmap | None = None
        self._start = self._ready = 0
        if self._size >= scratch.LARGE and not dtype.hasobject:
            self._pages = scratch.mapped(self._size)
        if self._pages is None and (self._size < _LARGE or dtype.hasobject or not supply.helps):
            self.values: NDArray[Any] = np.empty(shape, dtype)
            return
        if self._pages is None:
            self._pages = mmap.mmap(-1, self._size + _STEP, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        whole = np.frombuffer(self._pages, np.uint8)
        self._start = 0 if isinstance(self._pages, scratch.Pages) else -whole.ctypes.data % _STEP
        self.values = whole[self._start : self._start + self._size].view(dtype).reshape(shape)

    @property
    def _comes(self) -> bool:
        """Whether anything is to be done about pages: files give theirs back."""
        return self._supply.helps or isinstance(self._pages, scratch.Pages)

    def ready(self, rows: int) -> int:
        """The first rows are about to be written; how many may be before it is asked again."""
        if self._pages is None or not self._comes:
            return len(self.values)
        while self._ready < rows * self._row:
            step = min(_STEP, self._size - self._ready)
            self._supply.provide(self._pages, self._start + self._ready, step)
            self._ready += step
        return self._ready // self._row
