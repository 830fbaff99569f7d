"""The base of all effects: its declaration, and hooks that hand back what they were given."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator, model_validator

from twin.effects import _parameters
from twin.effects._parameters import Parameter

if TYPE_CHECKING:
    from schemas.trial import ImuSeries
    from twin.config import Twin
    from twin.effects._prediction import Column, LogView
    from twin.effects._repair import Repair
    from twin.scene import Scene

FloatArray = NDArray[np.float64]

GYROS = ("main.gyro", "sub.gyro")
ACCELEROMETERS = ("main.accel", "sub.accel")
PHINS = ("phins_main.attitude", "phins_sub.attitude")
STAMPS = ("sub.stamp",)
TEMPERATURE = ("sub.temperature",)


@dataclass(frozen=True)
class LookAlike:
    """Another effect that leaves nearly the same trace in a log that lacks the channels ``until``.

    share: of the whitened energy of one that the other explains (0..1), None where it was not measured. separated_by:
    what would tell the two apart, a phrase. until: empty where no channel alone does.
    """

    name: str
    share: float | None
    separated_by: str
    until: tuple[str, ...] = ()

    def holds(self, channels: Collection[str]) -> bool:
        """Whether the two look alike in a log of these channels."""
        return not self.until or not set(self.until) <= set(channels)


class Effect(BaseModel):
    """Base of all effects. Fields are the parameters of an ``[[effect]]`` table, declared by ``parameter``.

    name: as in twins and reports. needs: channels without which the effect cannot be tested. look_alikes: each pair is
    declared by one of the two. advice: what an engineer should do about it, a sentence. bends: it moves the deck, and
    so shows in the truth. foretold: its bending draws nothing, the ship's motion and time determine it. stays: why it
    cannot be taken out of a log, half a sentence; empty for one that can.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = GYROS
    look_alikes: ClassVar[tuple[LookAlike, ...]] = ()
    advice: ClassVar[str] = ""
    bends: ClassVar[bool] = False
    foretold: ClassVar[bool] = False
    stays: ClassVar[str] = ""

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The declared parameters in order."""
        found = (_parameters.declared(name, field) for name, field in cls.model_fields.items())
        return tuple(item for item in found if item is not None)

    @classmethod
    def about(cls) -> str:
        """First line of the description."""
        return (cls.__doc__ or "").strip().split("\n")[0]

    @field_validator("*", mode="after")
    @classmethod
    def _sensible(cls, value: Any, info: ValidationInfo) -> Any:
        item = _parameters.declared(info.field_name or "", cls.model_fields[info.field_name or ""])
        if item is not None:
            _parameters.check(item, value)
        return value

    @model_validator(mode="after")
    def _stated(self) -> Effect:
        severities = [item.name for item in self.parameters() if item.is_severity]
        if severities and not set(severities) & self.model_fields_set:
            raise ValueError(f"states none of its parameters {', '.join(severities)}")
        return self

    @classmethod
    def predict(cls, view: LogView) -> tuple[Column, ...]:
        """What a unit of each parameter adds to the signals of a log, to first order; nothing for effects that change
        statistics and not means. What else shapes the effect (a period, a time) are keyword arguments with defaults."""
        return ()

    def flexure_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """Spectrum (k,) of the flexure's rate about an m-axis as the sub's gyros sample it, (rad/s)^2 at omega (k,)
        rad/sample, white noise of variance v having v. interval: s. share: place in the log, 0 to 1."""
        return density

    def noise_density(
        self, axis: int, omega: FloatArray, interval: float, density: FloatArray, share: float
    ) -> FloatArray:
        """The same of what the sub's gyros add to it about that axis."""
        return density

    def twin(self, twin: Twin) -> Twin:
        """The twin with parameters changed."""
        return twin

    def sub_clock(self, t: FloatArray) -> FloatArray:
        """Instants (n,) s at which the sub-IMU measured, for the instants t (n,) it claims (nominal delay excluded)."""
        return t

    def phins_clock(self, unit: str, t: FloatArray) -> FloatArray:
        """Instants (n,) s of the attitudes of a PHINS for the stamps t (n,)."""
        return t

    def sea_flexure(self, t: FloatArray, theta: FloatArray, scene: Scene) -> FloatArray:
        """The random flexure (n, 3) rad of the sea at increasing times t (n,), before anything is added to it."""
        return theta

    def flexure(self, t: FloatArray, theta: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """theta (n, 3) rad in m-axes at increasing times t (n,)."""
        return theta

    def mount(self, t: FloatArray, phi: FloatArray, scene: Scene) -> FloatArray:
        """Phi (n, 3) rad in m-axes at times t (n,); a function of time alone."""
        return phi

    def gyro(
        self, unit: str, t: FloatArray, gyro: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """Ideal rates (n, 3) rad/s at the stamps t (n,); accel (n, 3) m/s^2 is the ideal force on the same unit."""
        return gyro

    def accel(self, unit: str, t: FloatArray, accel: FloatArray, scene: Scene, rng: np.random.Generator) -> FloatArray:
        """Ideal specific force (n, 3) m/s^2 at the stamps t (n,)."""
        return accel

    def attitude(
        self, unit: str, t: FloatArray, attitude: FloatArray, scene: Scene, rng: np.random.Generator
    ) -> FloatArray:
        """Quaternions (n, 4) of ``R_n_body`` of a PHINS at the stamps t (n,)."""
        return attitude

    def imu(self, unit: str, series: ImuSeries, scene: Scene, rng: np.random.Generator) -> ImuSeries:
        """The finished series of ``main``, ``sub``, ``phins_main``, ``phins_sub`` or ``sliding``."""
        return series

    def compensate(self, repair: Repair) -> Repair:
        """A log with this effect taken out of it: the inverse of ``gyro``, ``accel``, ``attitude`` and ``imu``.

        What ``twin``, the clocks, ``mount`` and foretold ``flexure`` do is undone without it.
        """
        return repair


class PerAxis(Effect):
    """An effect with a size for each axis."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    def size(self, unit: float = 1.0) -> FloatArray:
        """The three sizes (3,) in SI, unit being the factor."""
        return np.array([self.x, self.y, self.z]) * unit
