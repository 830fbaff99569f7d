"""Bending of the deck that is known beforehand: taken out of a log before estimating, put back into the answer.

R_m_s = Exp(b) R'_m_s D with D = Exp(-Phi) Exp(Phi + e): b the bending that effects foretell, e what they add to the
mounting. The sub-IMU, and the PHINS beside it, are turned by the inverse of K = D Exp(R_s_m b); b moves the lever arm,
e does not. Exact for the mounting, to first order in b and the flexure that is not foretold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from physics import quaternions, rotations
from physics.units import ARCMIN
from schemas.products import Alignment, Deformation
from schemas.trial import ImuSeries, Trial
from twin import sampling
from twin.config import Twin
from twin.effects import Effect
from twin.scene import Scene
from twin.sensors import installation

FloatArray = NDArray[np.float64]

GRID_S = 0.05  # s, on which the bending is worked out: it follows the waves
SLAB = 1 << 16


@dataclass(frozen=True)
class Bending:
    """What effects say of the deck; epoch: ns. before, after: (3,) rad, static angle without and with them.

    bent: spline of b (rad) over time (s), None for no bending; known: (2,) s, where it is, held beyond.
    """

    epoch: int
    scene: Scene
    effects: tuple[Effect, ...]
    before: FloatArray
    after: FloatArray
    bent: BSpline | None
    known: tuple[float, float] = (-np.inf, np.inf)

    def mounting(self, t: FloatArray) -> FloatArray:
        """D (n, 4) at times t (n,) s."""
        phi = np.broadcast_to(self.after, (len(t), 3))
        for effect in self.effects:
            phi = effect.mount(t, phi, self.scene)
        return quaternions.multiply(quaternions.exp(-self.before)[None, :], quaternions.exp(phi))

    def bending(self, t: FloatArray, order: int = 0) -> FloatArray:
        """b (n, 3) rad or one of its derivatives."""
        if self.bent is None:
            return np.zeros((len(t), 3))
        out = np.asarray(self.bent(np.clip(t, *self.known), order))
        if order:
            out[(t < self.known[0]) | (t > self.known[1])] = 0.0
        return out

    def turn(self, t: FloatArray) -> FloatArray:
        """K (n, 4)."""
        return quaternions.multiply(self.mounting(t), quaternions.exp(self.bending(t) @ rotations.exp(self.after)))

    def taken_from(self, series: ImuSeries, delay: float, arm: FloatArray, R_s_unit: FloatArray) -> ImuSeries:
        """A unit at the sub-IMU's place, (3, 3) to its axes, as it were without the bending.

        delay: s, what its stamps are late. arm: (3,) m, main to sub.
        """
        t = np.asarray((series.stamp - self.epoch) * 1e-9 - delay, dtype=np.float64)
        step = np.diff(t, prepend=2.0 * t[0] - t[1])
        usual = np.median(step)
        begin = t - np.where(step > 1.5 * usual, usual, step)
        parts = [self._slab(series, slice(k, k + SLAB), begin, t, R_s_unit, arm) for k in range(0, len(t), SLAB)]
        gyro, accel, end = (np.concatenate(column) for column in zip(*parts))
        attitude = series.attitude
        if attitude is not None:
            attitude = quaternions.multiply(attitude, quaternions.conjugate(end))
        return replace(series, gyro=gyro, accel=accel, attitude=attitude)

    def _slab(
        self, series: ImuSeries, part: slice, begin: FloatArray, end: FloatArray, R_s_unit: FloatArray, arm: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rates, forces and the turn (n, 4) at the ends of a slab."""
        begin, end = begin[part], end[part]
        first, middle, last = (self._seen(t, R_s_unit) for t in (begin, 0.5 * (begin + end), end))
        length = (end - begin)[:, None]
        step = quaternions.multiply(quaternions.exp(series.gyro[part] * length), quaternions.conjugate(last))
        gyro = quaternions.log(quaternions.multiply(first, step)) / length
        accel = quaternions.rotate(middle, series.accel[part])
        if self.bent is not None:
            accel = accel - self._lever(begin, end, arm) @ rotations.exp(self.before) @ R_s_unit
        return gyro, accel, last

    def _seen(self, t: FloatArray, R_s_unit: FloatArray) -> FloatArray:
        """R_unit_s K R_s_unit (n, 4)."""
        K = self.turn(t)
        return np.concatenate([K[:, :3] @ R_s_unit, K[:, 3:]], axis=1)

    def _lever(self, begin: FloatArray, end: FloatArray, arm: FloatArray) -> FloatArray:
        """Mean force (n, 3), m-axes, by which the bending moves the lever arm: Simpson's rule over each interval."""
        at = lambda t: self._lever_at(t, arm)  # noqa: E731
        return (at(begin) + 4.0 * at(0.5 * (begin + end)) + at(end)) / 6.0

    def _lever_at(self, t: FloatArray, arm: FloatArray) -> FloatArray:
        motion, r = self.scene.motion(t), np.broadcast_to(arm, (len(t), 3))
        shift, velocity, acceleration = (quaternions.cross(self.bending(t, order), r) for order in range(3))
        return sampling.force_at(motion, shift, velocity, acceleration) - motion.specific_force

    def restored(self, deformation: Deformation) -> Deformation:
        """The deformation of the deck as it is, from that of the deck without the bending."""
        t = np.asarray((deformation.stamp - self.epoch) * 1e-9, dtype=np.float64)
        mounting, bending = self.mounting(t), self.bending(t)
        static = quaternions.multiply(quaternions.exp(deformation.static_part), mounting)
        total = quaternions.multiply(quaternions.exp(deformation.total), mounting)
        total = quaternions.multiply(quaternions.exp(bending), total)
        matrix = rotations.exp(bending)
        return replace(
            deformation,
            total=quaternions.log(total),
            static_part=quaternions.log(static),
            dynamic_part=quaternions.log(quaternions.multiply(total, quaternions.conjugate(static))),
            covariance=matrix @ deformation.covariance @ np.swapaxes(matrix, 1, 2),
            alignment=self._aligned(deformation.alignment, t[len(t) // 2 : len(t) // 2 + 1]),
        )

    def _aligned(self, alignment: Alignment, t: FloatArray) -> Alignment:
        """The alignment with the mounting's change at mid-record."""
        rotation = alignment.rotation @ rotations.exp(quaternions.log(self.mounting(t))[0])
        return replace(alignment, rotation=rotation, static=replace(alignment.static, value=rotations.log(rotation)))


def foretold(
    epoch: int, span: tuple[float, float], scene: Scene, effects: Sequence[Effect], before: Twin, after: Twin
) -> Bending | None:
    """The bending that effects foretell over a span (s) in which the scene is known; None when they foretell none.

    before, after: the twin without and with what the effects change in it.
    """
    acting = tuple(effect for effect in effects if effect.foretold)
    mounted = tuple(effect for effect in effects if type(effect).mount is not Effect.mount)
    if not acting and not mounted and before.mount.static_arcmin == after.mount.static_arcmin:
        return None
    static = [np.array(twin.mount.static_arcmin) * ARCMIN for twin in (before, after)]
    spline = _spline(acting, scene, span) if acting else None
    return Bending(epoch, scene, mounted, static[0], static[1], spline, span)


def _spline(effects: Sequence[Effect], scene: Scene, span: tuple[float, float]) -> BSpline:
    t = np.arange(span[0], span[1] + GRID_S, GRID_S)
    theta = np.zeros((len(t), 3))
    for effect in effects:
        theta = effect.flexure(t, theta, scene, np.random.default_rng(0))
    return make_interp_spline(t, theta, k=5)


def without(trial: Trial, bending: Bending, twin: Twin, delay: float) -> Trial:
    """The trial as it were without the bending: sub-IMU, its stamps late by a delay (s), and the PHINS beside it."""
    arm = np.array(twin.mount.lever_arm)
    sub, phins = bending.taken_from(trial.sub, delay, arm, np.eye(3)), trial.phins_sub
    if phins is not None:
        phins = bending.taken_from(phins, 0.0, arm, installation(twin.phins.installation_sub_deg))
    return replace(trial, sub=sub, phins_sub=phins)
