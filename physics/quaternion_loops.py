"""Products, rotations and cross products of many quaternions and vectors, compiled; they broadcast as numpy does.

Sums are in the order of :mod:`physics.quaternions`: the same bits come out, compiled or not.
"""

from __future__ import annotations

from numba import float64, guvectorize


@guvectorize([(float64[:], float64[:], float64[:])], "(n),(n)->(n)", cache=True)
def multiply(a, b, out):  # type: ignore[no-untyped-def]
    """Product of quaternions x, y, z, w."""
    ax, ay, az, aw = a[0], a[1], a[2], a[3]
    bx, by, bz, bw = b[0], b[1], b[2], b[3]
    out[0] = aw * bx + ax * bw + ay * bz - az * by
    out[1] = aw * by - ax * bz + ay * bw + az * bx
    out[2] = aw * bz + ax * by - ay * bx + az * bw
    out[3] = aw * bw - ax * bx - ay * by - az * bz


@guvectorize([(float64[:], float64[:], float64[:])], "(n),(n)->(n)", cache=True)
def cross(a, b, out):  # type: ignore[no-untyped-def]
    """a x b of vectors."""
    a0, a1, a2, b0, b1, b2 = a[0], a[1], a[2], b[0], b[1], b[2]
    out[0], out[1], out[2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@guvectorize([(float64[:], float64[:], float64[:])], "(n),(m)->(m)", cache=True)
def rotate(q, v, out):  # type: ignore[no-untyped-def]
    """Vectors carried by the rotations: v + 2 s (u x v) + 2 u x (u x v), u and s the quaternion's parts."""
    x, y, z, s = q[0], q[1], q[2], q[3]
    v0, v1, v2 = v[0], v[1], v[2]
    t0, t1, t2 = 2.0 * (y * v2 - z * v1), 2.0 * (z * v0 - x * v2), 2.0 * (x * v1 - y * v0)
    out[0] = v0 + s * t0 + (y * t2 - z * t1)
    out[1] = v1 + s * t1 + (z * t0 - x * t2)
    out[2] = v2 + s * t2 + (x * t1 - y * t0)
