"""What compiled loops share."""

from __future__ import annotations

from typing import Any

from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def put(target: NDArray[Any], source: NDArray[Any]) -> None:
    """target (n,) := source (n,). An assignment to a slice takes seconds to compile, for its error message alone."""
    for k in range(len(target)):
        target[k] = source[k]
