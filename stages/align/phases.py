"""Static phases: stretches in which the ship lay still, by the local spread of its rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physics.units import DEG
from schemas.rig import FloatArray
from stages.align.tracks import Track

CELL = 0.5  # s, rates are averaged over it: sensor noise is no motion
WINDOW = 10.0  # s, length over which the spread is taken (about one swell)
STILL_RATE = 0.3 * DEG  # rad/s, rms of the rate vector about its median below which the ship lies still
STILL_SHORTEST = 30.0  # s


def static_phases(tracks: Sequence[Track]) -> FloatArray:
    """Intervals (k, 2) in s since the epoch, each at least STILL_SHORTEST, in which the rates stay below STILL_RATE."""
    found = [interval for track in tracks for interval in _still(track)]
    return np.array(found, dtype=float).reshape(-1, 2)


def _still(track: Track) -> list[tuple[float, float]]:
    count = int((track.end - track.start) / CELL)
    width = round(WINDOW / CELL)
    if count < width:
        return []
    rate, edges = track.rate(track.start, CELL, count), track.start + CELL * np.arange(count + 1)
    power = np.cumsum(np.concatenate(([0.0], np.sum((rate - np.median(rate, axis=0)) ** 2, axis=1))))
    calm = (power[width:] - power[:-width]) / width < STILL_RATE**2
    flips = np.flatnonzero(np.diff(np.concatenate(([0], calm.astype(int), [0]))))
    # Window k spans cells k..k+width, so a run of calm windows covers from its first cell to its last one's end.
    runs = [(edges[a], edges[min(b - 1 + width, len(edges) - 1)]) for a, b in zip(flips[::2], flips[1::2])]
    return [(a, b) for a, b in runs if b - a >= STILL_SHORTEST]
