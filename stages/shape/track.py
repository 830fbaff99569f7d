"""The sled on its path: arc length against time from odometry, and the runs (passes) found in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import solveh_banded

from schemas.errors import DataError
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import IntArray, OdometrySeries
from stages.shape.robust import hampel, spread

FEWEST = 10  # positions
ODOMETRY_GAP = 0.5  # s: a longer hole in the odometry is not bridged
JUMP = 0.5  # m beyond three times what the sled's speed explains: the odometer was reset or the sled carried
ACCELERATION_PSD = 10.0  # (m/s^2)^2/Hz: how freely the sled may change its speed
MOVING_SHARE = 0.05  # of the cruising speed: below it the sled stands
CRUISE_SHARE = 0.4  # of a pass's cruising speed: slower samples are its start and stop transients
SPEED_FLOOR = 0.1  # m/s: no pass is slower than this
SHORTEST_SHARE = 0.2  # of the longest pass's length: shorter movements are not passes
SHORTEST_PASS = 2.0  # m


@dataclass(frozen=True)
class Pass:
    """One run. begin, end: s, from standstill to standstill. forward: towards growing arc length. cruise: m/s."""

    index: int
    forward: bool
    begin: float
    end: float
    cruise: float


@dataclass(frozen=True)
class Track:
    """Arc length of the sled against time.

    t: (n,) s. s: (n,) m, smoothed, from the path's start (where the first pass starts, or further out where another
    pass went further). piece: (n,) counts the holes in time or jumps in place before each sample. origin: (3,) m and
    direction: (3,) unit vector of the path's chord in the deck frame. lateral: (k, 3) m, mean departure from the chord
    at arc lengths lateral_s (k,). passes: the runs, in time.
    """

    t: FloatArray
    s: FloatArray
    piece: IntArray
    origin: FloatArray
    direction: FloatArray
    lateral_s: FloatArray
    lateral: FloatArray
    passes: tuple[Pass, ...]

    def arc_length(self, t: FloatArray) -> FloatArray:
        """Arc length (m) at times t (s); meaningless where :meth:`covered` is False."""
        slope = _speed(self.t, self.s, self.piece, 1)
        return np.asarray(CubicHermiteSpline(self.t, self.s, slope)(np.clip(t, self.t[0], self.t[-1])))

    def covered(self, t0: FloatArray, t1: FloatArray) -> BoolArray:
        """Whether odometry surrounds the interval [t0, t1] without a gap."""
        before = np.searchsorted(self.t, t0, side="right") - 1
        after = np.searchsorted(self.t, t1, side="left")
        inside = (before >= 0) & (after < len(self.t))
        a, b = np.clip(before, 0, None), np.clip(after, None, len(self.t) - 1)
        return np.asarray(inside & (self.piece[a] == self.piece[b]))

    def position(self, s: FloatArray) -> FloatArray:
        """Deck-frame position (n, 3) m of the path at arc lengths s."""
        aside = np.stack([np.interp(s, self.lateral_s, self.lateral[:, i]) for i in range(3)], axis=-1)
        return self.origin + s[:, None] * self.direction + aside


def track(odometry: OdometrySeries, seconds: FloatArray) -> Track:
    """Track of the sled and its passes; seconds: (n,) the odometry's stamps in s.

    The path is its chord: arc length is the projection on the principal direction of the positions. Positions and
    velocities off their local spread are left out. DataError when the sled never makes a run.
    """
    t, position, velocity = _usable(odometry, seconds)
    centre, direction = _chord(position)
    along = (position - centre) @ direction
    piece = _pieces(t, along)
    u = smooth_arc(t, along, velocity @ direction, piece)
    speed = _speed(t, u, piece, max(1, round(0.1 / float(np.median(np.diff(t))))))
    runs = _runs(u, speed, piece)
    if not runs:
        fastest = float(np.max(np.abs(speed)))
        raise DataError(
            f"no run of the sled along a path was found: it moves over {np.ptp(u):.2f} m "
            f"at up to {fastest:.2f} m/s (a run needs {SHORTEST_PASS:g} m at {SPEED_FLOOR:g} m/s or more)"
        )
    a, b = runs[0]
    sign = 1.0 if u[b] > u[a] else -1.0
    u, direction = sign * u, sign * direction
    start = min(min(u[a], u[b]) for a, b in runs)
    s, origin = u - start, centre + start * direction
    lateral_s, lateral = _lateral(s, position - origin - s[:, None] * direction)
    passes = tuple(_pass(i, t, s, sign * speed, a, b) for i, (a, b) in enumerate(runs))
    return Track(t, s, piece, origin, direction, lateral_s, lateral, passes)


def _usable(odometry: OdometrySeries, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, positions and velocities (NaN where unknown) without rows that are missing or off their local spread."""
    finite = np.isfinite(odometry.position).all(axis=1)
    t, position, velocity = t[finite], odometry.position[finite], odometry.velocity[finite]
    if len(t) < FEWEST:
        raise DataError(f"the sled's odometry holds {len(t)} usable positions, too few for a run")
    velocity = np.nan_to_num(velocity, nan=0.0, posinf=0.0, neginf=0.0)
    known = np.asarray(np.isfinite(odometry.velocity[finite]).all(axis=1)) & bool(np.any(velocity))
    known &= ~hampel(velocity).any(axis=1)
    velocity = np.where(known[:, None], velocity, np.nan)
    keep = np.asarray(~hampel(position).any(axis=1))
    return t[keep], position[keep], velocity[keep]


def _chord(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre and principal direction of the positions, each visited place counting once."""
    centre = position.mean(axis=0)
    direction = np.linalg.svd(position[:: max(1, len(position) // 20000)] - centre, full_matrices=False)[2][0]
    return centre, direction


def _pieces(t: FloatArray, along: FloatArray) -> IntArray:
    """Number of holes in time or jumps in place before each sample, (n,)."""
    step, moved = np.diff(t), np.abs(np.diff(along))
    fast = 3.0 * float(np.percentile(moved / step, 99))
    return np.concatenate([[0], np.cumsum((step > ODOMETRY_GAP) | (moved > JUMP + fast * step))])


def smooth_arc(t: FloatArray, position: FloatArray, velocity: FloatArray, piece: IntArray) -> FloatArray:
    """Least-squares arc length (n,) m from positions (n,) m and velocities (n,) m/s, NaN where there is none.

    Minimises sum (s - p)^2/sp^2 + sum ((s_{i+1} - s_i)/dt - v)^2/sv^2 + sum (change of speed)^2/(q dt), the noise
    levels sp and sv being the local spreads of p and v; steps from one piece (n,) to the next are left free.
    """
    step = np.diff(t)
    sp = max(float(np.median(spread(np.diff(position, n=2)[:, None]))) / np.sqrt(6.0), 1e-4)
    between = 0.5 * (velocity[1:] + velocity[:-1])
    whole = np.diff(piece) == 0
    known = np.isfinite(between) & whole
    sv = 0.01
    if known.sum() > 10:
        sv = max(float(np.median(spread(np.diff(velocity[np.isfinite(velocity)], n=2)[:, None]))) / np.sqrt(6.0), 1e-3)
    rate_weight = np.where(known, 2.0 / sv**2, 0.0) / step**2
    kink_weight = np.where(whole[1:] & whole[:-1], 1.0, 1e-9)
    kink_weight = kink_weight / (ACCELERATION_PSD * 0.5 * (step[1:] + step[:-1]))
    bands, right = _normal_equations(step, 1.0 / sp**2, position, rate_weight, np.nan_to_num(between), kink_weight)
    return np.asarray(solveh_banded(bands, right, lower=True))


def _normal_equations(
    step: FloatArray, weight: float, position: FloatArray, rate: FloatArray, velocity: FloatArray, kink: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lower bands (3, n) and right-hand side (n,) of the smoothing problem of :func:`smooth_arc`."""
    n = len(position)
    bands, right = np.zeros((3, n)), weight * position
    bands[0] += weight
    bands[0, 1:] += rate
    bands[0, :-1] += rate
    bands[1, :-1] -= rate
    right[1:] += rate * velocity * step
    right[:-1] -= rate * velocity * step
    c = (1.0 / step[:-1], -1.0 / step[:-1] - 1.0 / step[1:], 1.0 / step[1:])
    for i in range(3):
        for j in range(i + 1):
            bands[i - j, j : n - 2 + j] += kink * c[i] * c[j]
    return bands, right


def _speed(t: FloatArray, u: FloatArray, piece: IntArray, half: int) -> FloatArray:
    """Speed (n,) m/s over half samples to either side, as far as they belong to the same piece."""
    i = np.arange(len(t))
    first, last = np.searchsorted(piece, piece), np.searchsorted(piece, piece, side="right") - 1
    a, b = np.maximum(i - half, first), np.minimum(i + half, last)
    return np.asarray((u[b] - u[a]) / np.where(b > a, t[b] - t[a], 1.0))


def _runs(u: FloatArray, speed: FloatArray, piece: IntArray) -> list[tuple[int, int]]:
    """First and last sample of every run: one direction, from standstill to standstill, long and fast enough."""
    fast = np.abs(speed)[np.abs(speed) > SPEED_FLOOR]
    if not len(fast):
        return []
    floor = max(MOVING_SHARE * float(np.median(fast)), 0.5 * SPEED_FLOOR)
    state = np.where(np.abs(speed) > floor, np.sign(speed), 0.0).astype(int)
    edges = np.flatnonzero((np.diff(state) != 0) | (np.diff(piece) != 0)) + 1
    stretches = np.split(np.arange(len(u)), edges)
    runs = [(int(p[0]), int(p[-1])) for p in stretches if state[p[0]] != 0]
    needed = max(SHORTEST_PASS, SHORTEST_SHARE * max((abs(u[b] - u[a]) for a, b in runs), default=0.0))
    return [(a, b) for a, b in runs if abs(u[b] - u[a]) >= needed and np.max(np.abs(speed[a : b + 1])) > SPEED_FLOOR]


def _pass(index: int, t: FloatArray, s: FloatArray, speed: FloatArray, a: int, b: int) -> Pass:
    v = np.abs(speed[a : b + 1])
    return Pass(index, bool(s[b] > s[a]), float(t[a]), float(t[b]), float(np.median(v)))


def _lateral(s: FloatArray, aside: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean departure from the chord in 50 bins of arc length: bin centres (k,) and means (k, 3)."""
    edges = np.linspace(s.min(), s.max() + 1e-9, 51)
    which = np.clip(np.searchsorted(edges, s, side="right") - 1, 0, 49)
    count = np.bincount(which, minlength=50)
    sums = np.stack([np.bincount(which, aside[:, i], minlength=50) for i in range(3)], axis=-1)
    centre = np.bincount(which, s, minlength=50)
    full = count > 0
    return centre[full] / count[full], sums[full] / count[full, None]
