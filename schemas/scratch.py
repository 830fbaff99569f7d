"""Memory for arrays of long logs: in a file without a name, so that it need not be held while nobody looks at it.

What is large lives in such a file, mapped into memory: an array like any other, with the same values. Once a stage has
done with it, :func:`release` gives its pages back; whoever looks again has them read from the system's cache or, where
memory is short, from the disk. Small arrays are plain memory. Where no file can be had, all are.
"""

from __future__ import annotations

import math
import mmap
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

LARGE = 1 << 26  # bytes: the rates of an IMU at 100 Hz over eight hours
SPARE, RESERVE = 2, 1 << 30  # sizes of an array, and bytes, that the disk must have
FOLDER = Path("/var/tmp")  # on disk, where the system's usual folder may be memory itself


class Pages(mmap.mmap):
    """A file without a name, mapped whole."""


def empty(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """An array of undefined content, like np.empty; in a file where it is large."""
    kind = np.dtype(dtype)
    size = math.prod(shape) * kind.itemsize
    pages = None if size < LARGE or kind.hasobject else mapped(size)
    return np.empty(shape, kind) if pages is None else np.frombuffer(pages, kind).reshape(shape)


def mapped(size: int) -> Pages | None:
    """So many bytes of a file of their own, their space on the disk reserved where it can be; None where there is none
    to be had, or where the disk would have little left for results."""
    try:
        folder = _folder()
        if shutil.disk_usage(folder or tempfile.gettempdir()).free < SPARE * size + RESERVE:
            return None
        with tempfile.TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, size)
            return Pages(file.fileno(), size)
    except (OSError, AttributeError, ValueError):
        return None


def _folder() -> str | None:
    return None if "TMPDIR" in os.environ or not os.access(FOLDER, os.W_OK) else str(FOLDER)


def shelved(values: NDArray[Any]) -> NDArray[Any]:
    """The values, in a file where they are large, and nothing of them in memory."""
    if pages_of(values) is None and values.nbytes >= LARGE and 0 not in values.strides:
        place = empty(values.shape, values.dtype)
        if pages_of(place) is not None:
            step = max(1, LARGE // 4 * len(values) // values.nbytes)
            for first in range(0, len(values), step):
                place[first : first + step] = values[first : first + step]
                release(place)
            values = place
    release(values)
    return values


def release(*arrays: NDArray[Any] | None) -> None:
    """Give back the memory of arrays, or of what they are parts of, as far as it is in files; values stay."""
    for pages in {id(pages): pages for pages in map(pages_of, arrays) if pages is not None}.values():
        pages.madvise(mmap.MADV_DONTNEED)


def pages_of(array: Any) -> Pages | None:
    """The file that an array, or what it is a view of, lies in."""
    while not isinstance(array, Pages):
        if isinstance(array, memoryview):
            array = array.obj
        elif isinstance(array, np.ndarray) or type(array).__module__.startswith("numpy."):
            array = getattr(array, "base", None)
        else:  # nothing, or memory that belongs to someone else
            return None
    return array
