"""A column in the making: it grows by rows, and takes no memory while these are all alike."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from schemas.wire.layout import items, rows_alike
from schemas.wire.memory import Room, Supply


class GrowingColumn:
    """A column that grows by rows, in any order. As long as all rows are alike, one of them is all that is kept."""

    def __init__(self, first: NDArray[Any], supply: Supply) -> None:
        self.shape, self.dtype = first.shape[1:], first.dtype.newbyteorder("=")
        self._supply = supply
        self._same: NDArray[Any] | None = np.array(first[:1], self.dtype)
        self._room = self._larger(0)

    def write(self, where: Any, values: NDArray[Any], filled: int, capacity: int) -> None:
        """Put values at the rows where; the first filled rows may have been written, those of this batch included."""
        if self._same is not None:
            if _alike(values, self._same):
                return
            self._room = self._larger(capacity)
            self._room.ready(filled)
            self._room.values[:filled] = self._same  # rows of this batch that came before included
            self._same = None
        self._room.ready(filled)
        if len(self.shape) == 1 and _is_plain(values, self.dtype):
            items(self._room.values)[where] = items(values)
        else:
            self._room.values[where] = values

    def reserve(self, filled: int, capacity: int) -> None:
        """Make room for capacity rows."""
        if self._same is None and capacity > len(self._room.values):
            larger = self._larger(capacity)
            larger.ready(filled)
            larger.values[:filled] = self._room.values[:filled]
            self._room = larger

    @property
    def alike(self) -> bool:
        """Whether all rows so far have the same bits."""
        return self._same is not None

    @property
    def address(self) -> int:
        """Where the first row is in memory, until more room is reserved."""
        return int(self._room.values.ctypes.data)

    def ready(self, rows: int) -> int:
        """The first rows are about to be written; how many may be."""
        return self._room.ready(rows)

    def finished(self, count: int) -> NDArray[Any]:
        """(count, ...) values; a read-only broadcast where all rows are alike."""
        if self._same is not None:
            return np.broadcast_to(self._same, (count, *self.shape))
        return self._room.values[:count]

    def _larger(self, capacity: int) -> Room:
        return Room(self._supply, (capacity, *self.shape), self.dtype)


def _alike(values: NDArray[Any], same: NDArray[Any]) -> bool:
    """Every row has the bits (the value, of objects) of the one in same."""
    if len(values) == 0:
        return True
    if values.dtype == object:
        if values.strides[0] == 0:
            values = values[:1]
        return values.ndim == 1 and isinstance(same[0], str) and bool((values == same).all())
    if not _is_one(values[-1], same[0]) or not _is_one(values[0], same[0]):
        return False
    if values.ndim == 2 and _is_plain(values, same.dtype):
        return rows_alike(values)
    if values.dtype.kind == "f":
        bits = np.dtype(f"u{values.dtype.itemsize}").newbyteorder(values.dtype.byteorder)
        values = values.view(bits)
    return bool((values == values[0]).all())


def _is_one(row: NDArray[Any], same: NDArray[Any]) -> bool:
    """Whether a row has the bits of another."""
    return np.asarray(row, same.dtype).tobytes() == same.tobytes()


def _is_plain(values: NDArray[Any], dtype: np.dtype[Any]) -> bool:
    """Whether values (n, k) are rows of adjacent elements of the dtype, which may be moved as bytes."""
    adjacent = values.shape[1] > 0 and values.strides[1] == dtype.itemsize
    return adjacent and values.dtype == dtype and not dtype.hasobject
