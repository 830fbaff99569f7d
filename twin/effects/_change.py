"""Twins with a section changed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from twin.config import Twin


def section(twin: Twin, name: str, **values: Any) -> Twin:
    """The twin with values of one of its tables replaced."""
    return twin.model_copy(update={name: getattr(twin, name).model_copy(update=values)})


def sub_imu(twin: Twin, **values: Any) -> Twin:
    """The twin with values of the sub-IMU replaced."""
    return section(twin, "imu", sub=twin.imu.sub.model_copy(update=values))


def added(values: Sequence[float], more: Iterable[float]) -> tuple[float, ...]:
    """Sums, one by one."""
    return tuple(float(a + b) for a, b in zip(values, more, strict=True))
