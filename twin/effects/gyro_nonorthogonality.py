"""Non-orthogonality of the sub-IMU's gyros."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from physics.units import ARCSEC
from twin.effects._change import added, sub_imu
from twin.effects._effect import Effect, LookAlike
from twin.effects._parameters import AXES, parameter
from twin.effects._prediction import Column, LogView, Signals, on_axis

if TYPE_CHECKING:
    from twin.config import Twin

SKEW = parameter("arcsec", "added to the twin's", prior=(5.0, 1000.0), most=36000.0, default=0.0, neutral=0.0)


class GyroNonorthogonality(Effect):
    """Axes of the sub-IMU's gyros not at right angles: xy is the y-rate seen on x, beyond the twin's."""

    name: ClassVar[str] = "gyro_nonorthogonality"
    xy: float = SKEW
    xz: float = SKEW
    yx: float = SKEW
    yz: float = SKEW
    zx: float = SKEW
    zy: float = SKEW
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike(
            "static_misalignment",
            1.0,
            "the accelerometers: the skew part (xy = -yx and so on) turns the gyros alone, a misalignment all",
            ("sub.accel",),
        ),
        LookAlike(
            "wave_forced_bending",
            0.95,
            "the accelerometers and PHINS, which see bending but no error of the gyros",
            ("sub.accel", "phins_sub.attitude"),
        ),
    )
    advice: ClassVar[str] = "Calibrate the axes of the sub-IMU's gyros against each other on a rate table."

    def twin(self, twin: Twin) -> Twin:
        """Non-orthogonality = the twin's + n."""
        skew = (self.xy, self.xz, self.yx, self.yz, self.zx, self.zy)
        return sub_imu(twin, gyro_nonorthogonality_arcsec=added(twin.imu.sub.gyro_nonorthogonality_arcsec, skew))

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """The rate of one axis seen on another, per arcsec."""
        pairs = ((seen, rate) for seen in range(3) for rate in range(3) if seen != rate)
        return tuple(
            Column(AXES[seen] + AXES[rate], Signals(gyro=on_axis(seen, ARCSEC * view.omega_s[:, rate])))
            for seen, rate in pairs
        )
