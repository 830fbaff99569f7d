"""From the dotted columns of a table to the standard fields of a channel, through the profile's field map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schemas.errors import DataError
from schemas.rig import FloatArray
from schemas.trial import IntArray
from schemas.wire import Table
from stages.decode.profile import Channel

STANDARD: dict[str, tuple[str, ...]] = {
    "angular_velocity": ("x", "y", "z"),
    "linear_acceleration": ("x", "y", "z"),
    "orientation": ("x", "y", "z", "w"),
    "position": ("x", "y", "z"),
    "velocity": ("x", "y", "z"),
    "total": ("x", "y", "z"),
    "static_part": ("x", "y", "z"),
    "dynamic_part": ("x", "y", "z"),
}
"""Parts of the standard fields that are vectors; every other field is a single number (or a covariance)."""
ABSURD = 1e15
_DEFAULT_PATH = {
    "stamp": "header.stamp",
    "position": "pose.pose.position",
    "velocity": "twist.twist.linear",
    "status": "status.status",
}
_STAMP_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
_LARGEST_NS = 2**62
_STAMP_FACTOR = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}


def needed(channel: Channel, extra: Sequence[str] = ()) -> frozenset[str]:
    """Paths (of columns or of messages that hold them) of the stamp, the channel's standard fields and extra ones."""
    given = [channel.fields.get(f, _DEFAULT_PATH.get(f, f)) for f in ("stamp", *channel.standard, *extra)]
    return frozenset(path for one in given for path in ((one,) if isinstance(one, str) else one))


def has(table: Table, channel: Channel, field: str) -> bool:
    """Whether the messages carry the standard field (under the name the profile gives it)."""
    return all(name in table.columns for name in _names(table, channel, field))


def vector(table: Table, channel: Channel, field: str) -> FloatArray:
    """(n, k) float64 of a vector field, perhaps a view of the table. Raises DataError where the messages lack it."""
    names = _names(table, channel, field)
    values = _stacked(table, names)
    width = len(STANDARD[field])
    if values.shape[1] != width:
        raise DataError(f"{field} needs {width} columns; {', '.join(names)} give {values.shape[1]}")
    return values


def scalar(table: Table, channel: Channel, field: str) -> FloatArray:
    """(n,) float64 of a single number, a copy."""
    values = _stacked(table, _names(table, channel, field))
    if values.shape[1] != 1:
        raise DataError(f"{field} needs one column, not {values.shape[1]}")
    return values[:, 0]


def array(table: Table, channel: Channel, field: str, width: int) -> FloatArray | None:
    """(n, width) of a fixed array such as a covariance; None where the messages have none."""
    column = table.columns.get(_path(channel, field))
    if column is None or column.ndim != 2 or column.shape[1] != width or column.dtype == object:
        return None
    return np.asarray(column, dtype=np.float64)


def stamps(table: Table, channel: Channel) -> IntArray:
    """(n,) ns, int64, a copy: the stamps that the profile says count."""
    if channel.stamp == "log_time":
        return np.array(table.log_time, dtype=np.int64)
    path = _path(channel, "stamp")
    for seconds, nanoseconds in _STAMP_PARTS:
        parts = (f"{path}.{seconds}", f"{path}.{nanoseconds}")
        if all(part in table.columns for part in parts):
            whole, rest = (_number(table, part) for part in parts)
            from_seconds = _as_nanoseconds(whole, _STAMP_FACTOR["s"])
            lost = (from_seconds == 0) & (whole != 0)
            return np.where(lost, 0, from_seconds + _as_nanoseconds(rest, _STAMP_FACTOR["ns"]))
    if path in table.columns and table.columns[path].dtype.kind in "OU":
        return _from_text(table.columns[path], path)
    return _as_nanoseconds(_number(table, path), _STAMP_FACTOR[channel.stamp_unit])


def _from_text(column: np.ndarray, path: str) -> IntArray:
    """ISO 8601 in UTC, as protobuf's JSON writes times."""
    try:
        return np.array([str(text).removesuffix("Z") for text in column], dtype="datetime64[ns]").astype(np.int64)
    except ValueError as error:
        raise DataError(f"field {path} is neither a number nor a time in ISO 8601") from error


def _as_nanoseconds(column: np.ndarray, factor: int) -> IntArray:
    """ns, int64; 0 (no stamp) where that cannot hold the number."""
    if column.dtype.kind in "iub":
        known = (column <= _LARGEST_NS // factor) & (column >= -(_LARGEST_NS // factor))
        return np.where(known, column, 0).astype(np.int64) * factor
    known = np.where(np.isfinite(column) & (np.abs(column) < 2**62 / factor), column, 0.0)
    whole = np.floor(known)
    return whole.astype(np.int64) * factor + np.rint((known - whole) * factor).astype(np.int64)


def _path(channel: Channel, field: str) -> str:
    given = channel.fields.get(field, _DEFAULT_PATH.get(field, field))
    return given if isinstance(given, str) else given[0]


def _names(table: Table, channel: Channel, field: str) -> Sequence[str]:
    """Columns of the field: as listed, one (array) column, or a prefix with the field's parts."""
    given = channel.fields.get(field, _DEFAULT_PATH.get(field, field))
    if not isinstance(given, str):
        return given
    if given in table.columns or field not in STANDARD:
        return (given,)
    return [f"{given}.{part}" for part in STANDARD[field]]


def _stacked(table: Table, names: Sequence[str]) -> FloatArray:
    """(n, k) float64; what is infinite or beyond any physical quantity is NaN, so that nothing overflows later."""
    columns = [_number(table, name) for name in names]
    values = _together(columns)
    if values is None:
        parts = [column if column.ndim == 2 else column[:, None] for column in columns]
        values = np.empty((len(table), sum(part.shape[1] for part in parts)))
        np.concatenate(parts, axis=1, out=values, casting="unsafe")
    if values.size and not (values.min() > -ABSURD and values.max() < ABSURD):  # false for NaN too
        values = np.where(np.abs(values) < ABSURD, values, np.nan)
    return values


def _together(columns: Sequence[np.ndarray]) -> FloatArray | None:
    """(n, k) view of columns that lie side by side in memory, as neighbouring fields are decoded; else None."""
    whole = columns[0].base
    if whole is None or not len(columns[0]):
        return None
    stride, first = 8 * len(columns), columns[0].ctypes.data
    for k, column in enumerate(columns):
        beside = column.ctypes.data == first + 8 * k and column.strides == (stride,)
        if column.dtype != np.float64 or column.base is not whole or not beside:
            return None
    return np.lib.stride_tricks.as_strided(columns[0], (len(columns[0]), len(columns)), (stride, 8))


def _number(table: Table, name: str) -> np.ndarray:
    column = table.columns.get(name)
    if column is None:
        raise DataError(f"messages of type {table.schema} have no field {name}; they have {_listed(table)}")
    if column.dtype.kind not in "fiub":
        raise DataError(f"field {name} of {table.schema} is not a number")
    return np.asarray(column)


def _listed(table: Table) -> str:
    names = table.fields or tuple(table.columns)
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
