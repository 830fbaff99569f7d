"""Flexure with other parameters than the twin's."""

from __future__ import annotations

from math import nextafter
from typing import TYPE_CHECKING, ClassVar

from twin.effects._change import section
from twin.effects._effect import Effect, LookAlike
from twin.effects._parameters import FLEXURE_MOST, Override, parameter

if TYPE_CHECKING:
    from twin.config import Twin

TINY = nextafter(0.0, 1.0)
KEPT = (None, None, None)


class FlexureParameters(Effect):
    """Flexure with other damping, frequency or size than the twin's, per axis; what is left out stays."""

    name: ClassVar[str] = "flexure_parameters"
    damping: Override = parameter("1/s", "mu", prior=(0.02, 1.0), least=TINY, most=100.0, default=KEPT, neutral="twin")
    frequency: Override = parameter(
        "rad/s", "lambda", prior=(0.0, 6.0), least=0.0, most=100.0, default=KEPT, neutral="twin"
    )
    std_arcmin: Override = parameter(
        "arcmin", "sigma", prior=(0.5, 30.0), least=0.0, most=FLEXURE_MOST, default=KEPT, neutral="twin"
    )
    look_alikes: ClassVar[tuple[LookAlike, ...]] = (
        LookAlike("second_mode", 0.97, "a comparison of the two on data held out, in a longer log"),
        LookAlike("amplitude_stiffening", None, "a log with a calm and a rough part"),
    )
    advice: ClassVar[str] = "Take the identified flexure parameters over into the twin and the estimator."
    bends: ClassVar[bool] = True
    stays: ClassVar[str] = "the flexure is identified in the log itself"

    def twin(self, twin: Twin) -> Twin:
        """The stated values in place of the twin's."""
        names = ("damping", "frequency", "std_arcmin")
        values = {
            name: tuple(
                old if new is None else new for new, old in zip(getattr(self, name), getattr(twin.flexure, name))
            )
            for name in names
        }
        return section(twin, "flexure", **values)
