"""Long paths piece by piece: what is worked out on the way is that of a piece, and what is done with leaves memory.

The same numbers come out as from :mod:`physics.matching` in one go.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from physics import matching, quaternions
from schemas import scratch
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages import slabs as size
from stages.slabs import slabs

NODES = 4  # of interpolation, on either side


def empty_path(t: FloatArray) -> matching.Strapdown:
    """Room for a path at the stamps t (n,) s."""
    return matching.Strapdown(t, scratch.empty((len(t), 4)), scratch.empty((len(t), 3)))


def let_go(path: matching.Strapdown) -> None:
    """Give back the memory of a path."""
    scratch.release(path.attitude, path.velocity)


def integrated(
    unit: matching.Unit, gyro_bias: FloatArray | None = None, scale: FloatArray | None = None
) -> matching.Strapdown:
    """:func:`physics.matching.strapdown` of a unit, known errors of its gyro, (3,) rad/s and (3, 3), taken out."""
    path = empty_path(unit.t)
    path.attitude[0], path.velocity[0] = (0.0, 0.0, 0.0, 1.0), 0.0

    def gyro(rows: slice) -> FloatArray:
        seen = unit.gyro[rows]
        return seen if gyro_bias is None or scale is None else seen - gyro_bias - seen @ scale.T

    before = matching.first_increments(unit.t[:2], gyro(slice(0, 2)), unit.accel[:2])
    for part in slabs(len(unit.t)):
        rows = slice(max(part.start - 1, 0), part.stop)
        matching.carry_on(unit.t[rows], gyro(rows), unit.accel[rows], before, path.attitude[rows], path.velocity[rows])
        scratch.release(unit.gyro, unit.accel)
        let_go(path)
    return path


def interpolated(path: matching.Strapdown, at: FloatArray, start: FloatArray) -> matching.Strapdown:
    """The path at sorted instants (m,), s, with attitude ``start`` (3, 3) and zero velocity at the first of them."""
    found = empty_path(at)
    first: matching.Strapdown | None = None
    for part in slabs(len(at)):
        before, after = np.searchsorted(path.t, at[[part.start, part.stop - 1]])
        near = slice(max(before - NODES, 0), after + NODES)
        seen = matching.interpolate(
            matching.Strapdown(path.t[near], path.attitude[near], path.velocity[near]), at[part]
        )
        first = first or matching.Strapdown(at[:1], seen.attitude[:1].copy(), seen.velocity[:1].copy())
        found.attitude[part], found.velocity[part] = _turned(seen, first, start)
        let_go(found)
        let_go(path)
    return found


def restarted(path: matching.Strapdown, start: FloatArray) -> matching.Strapdown:
    """The same path with attitude ``start`` (3, 3) and zero velocity at its first instant; itself if it has them."""
    if not path.velocity[0].any() and np.array_equal(_quaternion(start), path.attitude[0]):
        return path
    found = empty_path(path.t)
    for part in slabs(len(path.t)):
        seen = matching.Strapdown(path.t[part], path.attitude[part], path.velocity[part])
        found.attitude[part], found.velocity[part] = _turned(seen, path, start)
        let_go(found)
        let_go(path)
    return found


def _turned(path: matching.Strapdown, first: matching.Strapdown, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Attitude and velocity of a part of a path that is to begin at ``start``; first: how it begins now."""
    turn = quaternions.multiply(_quaternion(start), quaternions.conjugate(first.attitude[0]))
    attitude = path.attitude @ quaternions.multiply(turn, np.eye(4))
    return attitude, (path.velocity - first.velocity[0]) @ Rotation.from_quat(turn).as_matrix().T


def _quaternion(matrix: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(matrix).as_quat())


def step_means(
    main: matching.Strapdown, sub: matching.Strapdown, index: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """:func:`physics.matching.step_means`."""
    A_end, A_mean, u = np.empty((len(index), 3, 3)), np.empty((len(index), 3, 3)), np.empty((len(index), 3))
    for part, rows, ends in steps(index):
        one, other = (matching.Strapdown(p.t[rows], p.attitude[rows], p.velocity[rows]) for p in (main, sub))
        skip = part.start - max(part.start - 1, 0)
        for whole, found in zip((A_end, A_mean, u), matching.step_means(one, other, ends)):
            whole[part] = found[skip:]
        let_go(main)
        let_go(sub)
    return A_end, A_mean, u


def steps(index: IntArray) -> Iterator[tuple[slice, slice, IntArray]]:
    """Pieces of steps that end at samples index (N,): the steps, their samples with the end of the step before, and
    the ends among these."""
    count = max(1, size.SLAB * len(index) // max(int(index[-1]), 1))
    for k in range(0, len(index), count):
        part = slice(k, min(k + count, len(index)))
        ends = index[max(k - 1, 0) : part.stop]
        yield part, slice(int(ends[0]), int(ends[-1]) + 1), ends - ends[0]
