"""Long arrays a slab at a time: what is worked out of them on the way is many times as large as they are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from schemas.products import BoolArray

SLAB = 1 << 18  # rows
LONG = 1 << 21  # rows, from which on working on two units at a time would take too much memory
T = TypeVar("T", bound=np.generic)


def slabs(n: int) -> Iterator[slice]:
    """n rows by SLAB."""
    return (slice(k, min(k + SLAB, n)) for k in range(0, n, SLAB))


def beside(n: int) -> int:
    """How many units of n samples are worked on at a time."""
    return 1 if n > LONG else 2


def rows(values: NDArray[T], kept: BoolArray) -> NDArray[T]:
    """values[kept], without a copy where that is all of them (the usual case, and the arrays are large)."""
    return values if kept.all() else values[kept]
