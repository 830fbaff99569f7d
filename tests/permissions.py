"""Permissions that hold for the superuser too, for tests of files that may not be read or written."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager

VERSION_3 = 0x20080522
OVERRIDES = 1 << 1 | 1 << 2  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH


class _Header(ctypes.Structure):
    _fields_ = [("version", ctypes.c_uint32), ("pid", ctypes.c_int)]


class _Data(ctypes.Structure):
    _fields_ = [(name, ctypes.c_uint32) for name in ("effective", "permitted", "inheritable")]


@contextmanager
def permissions_that_hold() -> Iterator[None]:
    """Without what lets the superuser (on Linux, this thread) read and write everything; others have no such thing."""
    if os.geteuid() != 0:
        yield
        return
    kept = _effective()
    _set_effective(kept & ~OVERRIDES)
    try:
        yield
    finally:
        _set_effective(kept)


def _effective() -> int:
    return int(_read()[0].effective)


def _read() -> ctypes.Array[_Data]:
    data = (_Data * 2)()
    _call("capget", data)
    return data


def _set_effective(value: int) -> None:
    data = _read()
    data[0].effective = value
    _call("capset", data)


def _call(name: str, data: ctypes.Array[_Data]) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if getattr(libc, name)(ctypes.byref(_Header(VERSION_3, 0)), data) != 0:
        raise OSError(ctypes.get_errno(), f"{name} failed")
