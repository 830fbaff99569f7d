"""An axis of a figure: limits, round ticks, what stands at them, and where a value lies between the limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.rig import FloatArray

WANTED_TICKS = 6
CALENDAR = (("m", 1), ("m", 5), ("m", 15), ("h", 1), ("h", 2), ("h", 6), ("h", 12), ("D", 1), ("D", 2), ("W", 1),
            ("M", 1), ("M", 3), ("M", 6), ("Y", 1), ("Y", 2), ("Y", 5), ("Y", 10))  # fmt: skip
SECONDS = {"m": 60.0, "h": 3600.0, "D": 86400.0, "W": 7 * 86400.0, "M": 28 * 86400.0, "Y": 365 * 86400.0}
MOST_TICKS = 8
MARKS_APART = 8.0  # how many marks of a time view at most have room for their figures


@dataclass(frozen=True)
class Axis:
    """Limits in data units, or their powers of ten when log; label with unit; scale divides what ticks show."""

    low: float
    high: float
    label: str
    log: bool = False
    scale: float = 1.0

    def place(self, value: FloatArray) -> FloatArray:
        """0 at low, 1 at high; NaN for what a logarithm cannot show."""
        if self.log:
            value = np.log10(np.where(value > 0, value, np.nan))
            return (value - np.log10(self.low)) / (np.log10(self.high) - np.log10(self.low))
        return (value - self.low) / (self.high - self.low)

    def ticks(self) -> list[float]:
        """Round numbers within the limits."""
        if self.log:
            first, last = np.ceil(np.log10(self.low) - 1e-9), np.floor(np.log10(self.high) + 1e-9)
            step = max(1, round((last - first) / WANTED_TICKS))
            return [float(10.0**k) for k in np.arange(first, last + 0.5, step)]
        step = round_step((self.high - self.low) / self.scale / WANTED_TICKS) * self.scale
        first = np.ceil(self.low / step - 1e-9)
        return [float(k * step) for k in np.arange(first, np.floor(self.high / step + 1e-9) + 0.5)]

    def text(self, tick: float) -> str:
        """What stands at a tick."""
        shown = tick / self.scale
        return f"{0.0 if abs(shown) < 1e-12 else shown:.6g}"


@dataclass(frozen=True)
class DateAxis(Axis):
    """An axis of dates, limits in ns UTC: ticks stand at the starts of years, months, days or hours."""

    def ticks(self) -> list[float]:
        """Starts of whole calendar steps, the finest of which there are not too many."""
        low, high = (np.datetime64(int(end), "ns") for end in (self.low, self.high))
        for unit, step in CALENDAR:
            if (self.high - self.low) * 1e-9 > 2 * MOST_TICKS * step * SECONDS[unit]:
                continue
            starts = np.arange(low.astype(f"datetime64[{unit}]"), high.astype(f"datetime64[{unit}]") + 1)
            starts = starts[starts.astype(int) % step == 0].astype("datetime64[ns]")
            inside = starts[(starts >= low) & (starts <= high)]
            if len(inside) <= MOST_TICKS:
                return [float(value) for value in inside.astype(np.int64)]
        return [self.low, self.high]

    def text(self, tick: float) -> str:
        """Date, and the hour where days are too coarse."""
        when = np.datetime64(int(tick), "ns")
        if self.high - self.low < 3 * 86400e9:
            return str(when.astype("datetime64[m]")).replace("T", " ")
        return str(when.astype("datetime64[D]"))


def round_step(raw: float) -> float:
    """The round number 1, 2 or 5 times a power of ten next above raw."""
    if not np.isfinite(raw) or raw <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(raw))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= raw * (1 - 1e-9)))


def span_of(values: Sequence[FloatArray], margin: float = 0.06, zero: bool = True) -> tuple[float, float]:
    """Limits that hold all finite values, zero included unless told, with a margin."""
    finite = np.concatenate([np.ravel(v)[np.isfinite(np.ravel(v))] for v in values] + [np.zeros(int(zero))])
    if not len(finite):
        return -1.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    pad = margin * (high - low) or 0.5 * abs(low) or 1.0
    return low - pad, high + pad


def legible(low: float, high: float) -> tuple[float, float]:
    """The limits, moved outwards until two of the marks are within them that Rerun writes: powers of ten, far apart.

    Its time views take no other marks, so a range of 2 to 9 would show none.
    """
    step = 10.0 ** np.ceil(np.log10(max(high - low, 1e-12) / MARKS_APART) - 1e-9)
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    while last - first < 1:
        if low - step * (first - 1) < step * (last + 1) - high:
            first, low = first - 1, step * (first - 1.05)
        else:
            last, high = last + 1, step * (last + 1.05)
    return float(low), float(high)


def decades_of(values: Sequence[FloatArray], most: float = 9.0) -> tuple[float, float]:
    """Whole powers of ten that hold all positive values, at most so many of them below the largest."""
    flat = np.concatenate([np.ravel(v) for v in values]) if values else np.zeros(0)
    good = flat[np.isfinite(flat) & (flat > 0)]
    if not len(good):
        return 0.1, 10.0
    high = float(10.0 ** np.ceil(np.log10(good.max()) - 1e-9))
    low = float(10.0 ** np.floor(np.log10(good.min()) + 1e-9))
    high = high if high > low else 10.0 * low
    return max(low, high * 10.0**-most), high


def date_axis(start: int, end: int) -> DateAxis:
    """Dates from start to end, ns UTC, with room at both ends."""
    room = max(0.02 * (end - start), 60e9)
    return DateAxis(start - room, end + room, "date (UTC)")


def time_axis(start: float, end: float) -> Axis:
    """Seconds since the start of the trial, shown in s, min or h."""
    length = end - start
    unit, scale = ("s", 1.0) if length < 600 else ("min", 60.0) if length < 4 * 3600 else ("h", 3600.0)
    return Axis(start, end if length > 0 else start + 1.0, f"time since the start of the trial [{unit}]", scale=scale)
