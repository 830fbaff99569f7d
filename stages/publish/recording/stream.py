"""Columns into a Rerun recording: sliced, on both timelines, lines broken at gaps.

Times go in as integer nanoseconds (timedelta64, datetime64): float seconds would lose them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from uuid import NAMESPACE_URL, uuid5

import numpy as np
import rerun as rr
from rerun.blueprint import Blueprint

from physics.interpolation import gap_starts, usual_interval
from schemas import scratch
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.publish.recording.scene import Colour
from stages.slabs import SLAB

SLICE = 65_536  # rows per chunk: smaller chunks cost space, larger ones cost the viewer
TRIAL, UTC = "trial_time", "utc"
ROOM = 1 << 20  # bytes, more than a layout takes


def record(path: Path, name: str, blueprint: Blueprint, log: Callable[[rr.RecordingStream], None]) -> None:
    """Write a recording, its layout first; it appears at path whole or not at all, its id follows from its name."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        recording = open_recording(partial, blueprint, name)
        recording.send_recording_name(name)
        log(recording)
        recording.flush()
        recording.disconnect()
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def open_recording(path: Path, blueprint: Blueprint, name: str) -> rr.RecordingStream:
    """A recording written to path, its layout first; its id follows from its name alone. OSError: no room for it."""
    path.write_bytes(bytes(ROOM))  # Rerun waits for ever where the layout does not fit on the disk
    recording = rr.RecordingStream("deckflex", recording_id=uuid5(NAMESPACE_URL, f"deckflex:{name}"))
    recording.save(path, default_blueprint=blueprint)
    return recording


def send_lines(
    rec: rr.RecordingStream,
    entity: str,
    stamp: IntArray,
    epoch: int | None,
    values: FloatArray,
    names: Sequence[str],
    colours: Sequence[Colour],
    width: float = 1.5,
) -> None:
    """k lines over time from values (n, k) at stamp (n,) ns, broken at gaps; extremes survive zooming out."""
    style = rr.SeriesLines(
        names=list(names),
        colors=list(colours),
        widths=[width] * len(names),
        aggregation_policy=rr.components.AggregationPolicy.MinMax,
    )
    rec.log(entity, style, static=True)
    for at, block in pieces(stamp, lambda part: values[part]):
        _send(rec, entity, at, epoch, rr.Scalars.columns(scalars=block.ravel()).partition([block.shape[1]] * len(at)))


def send_band(
    rec: rr.RecordingStream,
    entity: str,
    stamp: IntArray,
    epoch: int | None,
    values: FloatArray,
    sigma: FloatArray,
    names: Sequence[str],
    colours: Sequence[Colour],
    unit: str,
    scale: float = 1.0,
) -> None:
    """k lines values (n, k) within their bands of +-3 sigma (n, k), both over ``scale``; an unknown sigma draws no
    band."""
    style = rr.Measurements.from_fields(
        names=list(names),
        colors=list(colours),
        widths=[1.5] * len(names),
        units=[unit] * len(names),
        aggregation_policy=rr.components.AggregationPolicy.MinMax,
    )
    rec.log(entity, style, static=True)
    k = len(names)

    def rows(part: slice) -> FloatArray:
        return np.hstack([values[part], 3.0 * np.nan_to_num(sigma[part])]) / scale

    for at, block in pieces(stamp, rows):
        variance = np.nan_to_num(block[:, k:]) ** 2
        columns = rr.Measurements.columns(values=block[:, :k].ravel(), variances=variance.ravel())
        _send(rec, entity, at, epoch, columns.partition([k] * len(at)))
    scratch.release(values, sigma)


def send_axes(
    rec: rr.RecordingStream,
    entity: str,
    stamp: IntArray,
    epoch: int | None,
    values: FloatArray,
    name: str,
    colour: Colour,
    width: float = 1.0,
) -> None:
    """Values (n, 3) as one line each under entity/x, entity/y, entity/z, so that a view can show one axis."""
    for i, axis in enumerate("xyz"):
        send_lines(rec, f"{entity}/{axis}", stamp, epoch, values[:, i : i + 1], [name], [colour], width)


def send_bands(
    rec: rr.RecordingStream,
    entity: str,
    stamp: IntArray,
    epoch: int | None,
    values: FloatArray,
    sigma: FloatArray,
    name: str,
    colour: Colour,
    unit: str,
    scale: float = 1.0,
) -> None:
    """Values (n, 3) within +-3 sigma (n, 3), both over ``scale``, as one band each under entity/x, entity/y,
    entity/z."""
    for i, axis in enumerate("xyz"):
        one = slice(i, i + 1)
        send_band(rec, f"{entity}/{axis}", stamp, epoch, values[:, one], sigma[:, one], [name], [colour], unit, scale)


def send_states(
    rec: rr.RecordingStream,
    entity: str,
    stamp: IntArray,
    epoch: int | None,
    states: Sequence[str],
    colours: dict[str, Colour],
) -> None:
    """One lane of states, each from its stamp until the next; an empty string ends the lane."""
    known = list(colours)
    style = rr.StateConfiguration(values=known, labels=known, colors=[colours[name] for name in known])
    rec.log(entity, style, static=True)
    _send(rec, entity, stamp, epoch, rr.StateChange.columns(state=list(states)))


def _send(rec: rr.RecordingStream, entity: str, stamp: IntArray, epoch: int | None, columns: object) -> None:
    rr.send_columns(entity, times_of(stamp, epoch), columns, recording=rec)  # type: ignore[arg-type]


def times_of(stamp: IntArray, epoch: int | None) -> list[rr.TimeColumn]:
    """Time since the epoch of the trial, and UTC; where the epoch is None, stamps count from it and UTC is unknown."""
    if epoch is None:
        return [rr.TimeColumn(TRIAL, duration=stamp.view("timedelta64[ns]"))]
    return [
        rr.TimeColumn(TRIAL, duration=(stamp - epoch).view("timedelta64[ns]")),
        rr.TimeColumn(UTC, timestamp=stamp.view("datetime64[ns]")),
    ]


def pieces(stamp: IntArray, rows: Callable[[slice], FloatArray]) -> Iterator[tuple[IntArray, FloatArray]]:
    """Stamps and values of about SLICE rows at a time, with a row of NaN just after the last sample before each gap, so
    that lines break there. rows: (m, k) of a slice, made when they are sent: all at once would be as large as the log.

    Values come to the seven digits of single precision: the file compresses better and no eye sees the rest.
    """
    gaps = gap_starts(stamp)
    after = round(usual_interval(stamp)) if len(gaps) else 0
    for start in range(0, len(stamp), SLICE):
        part = slice(start, min(start + SLICE, len(stamp)))
        at, values = stamp[part], np.asarray(rows(part)).astype(np.float32)
        inner = gaps[(gaps >= part.start) & (gaps < part.stop)] - part.start
        if len(inner):
            at, values = np.insert(at, inner + 1, at[inner] + after), np.insert(values, inner + 1, np.nan, axis=0)
        yield np.ascontiguousarray(at), values.astype(float)


def thin_extremes(stamp: IntArray, values: FloatArray, factor: int) -> tuple[IntArray, FloatArray]:
    """Fewer rows by ``factor`` with no peak lost: of each bucket of 2 factor rows, per column, minimum and maximum.

    They keep their order in time within the bucket; a bucket never reaches across a gap. stamp (n,) ns, values (n, k).
    """
    if factor <= 1:
        return stamp, values
    edges = np.concatenate([[0], gap_starts(stamp) + 1, [len(stamp)]])
    parts = [_thin_run(stamp[a:b], values[a:b], 2 * factor) for a, b in pairwise(edges)]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _thin_run(stamp: IntArray, values: FloatArray, bucket: int) -> tuple[IntArray, FloatArray]:
    whole = len(stamp) // bucket * bucket
    if not whole:
        return stamp, values
    slab = SLAB // bucket * bucket or bucket
    picked = [_extremes(values[k : min(k + slab, whole)], bucket) for k in range(0, whole, slab)]
    scratch.release(values)
    times = stamp[:whole].reshape(-1, bucket)[:, [0, bucket // 2]].ravel()
    return np.concatenate([times, stamp[whole:]]), np.concatenate([*picked, values[whole:]])


def _extremes(values: FloatArray, bucket: int) -> FloatArray:
    """(2 n / bucket, k) least and largest of each bucket, in the order in which they came."""
    cube = values.reshape(-1, bucket, values.shape[1])
    unknown = np.isnan(cube)
    holes = bool(unknown.any())  # a copy is made only then
    low = (np.where(unknown, np.inf, cube) if holes else cube).argmin(axis=1)
    high = (np.where(unknown, -np.inf, cube) if holes else cube).argmax(axis=1)
    pair = np.stack([np.minimum(low, high), np.maximum(low, high)], axis=1)
    return np.take_along_axis(cube, pair, axis=1).reshape(-1, values.shape[1])
