"""Attitude error of the PHINS at the sub-IMU."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from physics import quaternions
from physics.units import ARCMIN
from twin.effects._effect import GYROS, PHINS, PerAxis
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

ANGLE = parameter("arcmin", "in m-axes", prior=(0.05, 30.0), most=600.0, default=0.0, neutral=0.0)


class PhinsAttitudeError(PerAxis):
    """A slow sine in the attitude of the sub-IMU's PHINS: R_n_m Exp(e sin(2 pi t / period)) R_m_n R_n_phins."""

    name: ClassVar[str] = "phins_attitude_error"
    x: float = ANGLE
    y: float = ANGLE
    z: float = ANGLE
    period: float = parameter("s", "of the sine", prior=(30.0, 5400.0), least=0.1, most=1e7, default=300.0)
    needs: ClassVar[tuple[str, ...]] = (*GYROS, *PHINS)
    advice: ClassVar[str] = "Check the alignment and the aiding of the sub-IMU's PHINS; do not score against it alone."

    def attitude(
        self, unit: str, t: FloatArray, attitude: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """The error turns the attitude from the left, from m-axes carried to ENU."""
        if unit != "phins_sub" or not self.size().any():
            return attitude
        pitch, roll, heading = scene.angles(t).T
        error = np.outer(np.sin(2.0 * np.pi * t / self.period), self.size(ARCMIN))
        turned = quaternions.rotate(quaternions.from_euler(heading, pitch, roll), error)
        return quaternions.multiply(quaternions.exp(turned), attitude)

    @classmethod
    def predict(cls, view: LogView, *, period: float = 300.0) -> tuple[Column, ...]:
        """A sine of attitude error that is zero at the start, per arcmin about each m-axis."""
        sine = ARCMIN * np.sin(2.0 * np.pi * view.t / period)
        return tuple(
            Column(name, Signals(phins=on_axis(axis, sine)), {"period": period}) for axis, name in enumerate(AXES)
        )

    def compensate(self, repair: Repair) -> Repair:
        """Turned back, the log's own attitude in place of the scene's."""
        phins, back = repair.trial.phins_sub, self.model_copy(update={"x": -self.x, "y": -self.y, "z": -self.z})
        if phins is None or phins.attitude is None:
            return repair.noted(f"{self.name}: left in; the log has no PHINS at the sub-IMU")
        t = repair.trial.seconds(phins.stamp)
        attitude = back.attitude("phins_sub", t, phins.attitude, repair.scene, np.random.default_rng(0))
        return replace(repair, trial=replace(repair.trial, phins_sub=replace(phins, attitude=attitude)))
