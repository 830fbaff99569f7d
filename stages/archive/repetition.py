"""Evidence of an effect that repeats over the voyages of one installation.

Held-out evidence is a difference of log-likelihoods of data that voyages do not share, so it adds up:

    nats = sum_i nats_i   over the logs whose parameters p_i point the same way as the common ones p

    p = (sum_i p_i / s_i^2) / (sum_i 1 / s_i^2),   chi^2 = sum_i (p_i - p)^2 / s_i^2,   n - 1 degrees of freedom

A log points the same way when sum_k p_ik p_k / s_ik^2 > 0 over its parameters k. Where chi^2 says that the voyages
disagree by more than their standard deviations, the common one's is widened by sqrt(chi^2 / (n - 1)) (Birge, Phys. Rev.
40 (1932) 207, eq. 7). The evidence of each log is for parameters of its own: a common value would need less of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.stats import chi2 as chi_square

AGREE = 0.01  # probability of a larger chi-square below which voyages are said to disagree
FEWEST = 2  # logs that must name an effect before it is said to repeat


class Standing(StrEnum):
    """How an effect stands over the archive."""

    REPEATS = "repeats"
    VARIES = "repeats, but not with the same size"
    ONCE = "named in one log only"
    CONTRADICTED = "named, but outweighed by the logs that speak against it"
    HINT = "named in no log, but small evidence adds up"
    ABSENT = "not seen"


FIRM = (Standing.REPEATS, Standing.VARIES)
"""How an effect stands that is sure to be there in more than one voyage."""


@dataclass(frozen=True)
class Observation:
    """What one log says of an effect.

    nats: held-out evidence; None where the log could not tell. threshold: what it had to reach. parameters: name to
    (value, standard deviation), empty where the effect was not named.
    """

    log: str
    nats: float | None
    threshold: float
    named: bool
    parameters: Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Agreed:
    """A parameter over the logs. std: widened where they disagree. p_value: of a chi-square as large, 1 for one log."""

    value: float
    std: float
    chi2: float
    dof: int
    p_value: float

    @property
    def agrees(self) -> bool:
        """Whether the logs may have one common value."""
        return self.p_value >= AGREE


@dataclass(frozen=True)
class Repetition:
    """An effect over the archive. pointing, against, silent: names of logs. named: in how many logs it was named."""

    effect: str
    standing: Standing
    nats: float
    named: int
    pointing: tuple[str, ...]
    against: tuple[str, ...]
    silent: tuple[str, ...]
    parameters: Mapping[str, Agreed]


def repetition(effect: str, observations: Sequence[Observation]) -> Repetition:
    """What the logs say together of one effect."""
    named = [one for one in observations if one.named]
    agreed = common(named)
    opposed = [one for one in named if not same_way(one, agreed)]
    weak = [one for one in observations if not one.named and one.nats is not None]
    pointing = [one for one in named if one not in opposed]
    nats = sum(one.nats or 0.0 for one in (*pointing, *weak))
    against = [*opposed, *(one for one in weak if (one.nats or 0.0) < 0.0)]
    return Repetition(
        effect=effect,
        standing=_standing(nats, named, pointing, agreed, observations),
        nats=float(nats),
        named=len(named),
        pointing=tuple(one.log for one in pointing),
        against=tuple(one.log for one in against),
        silent=tuple(one.log for one in observations if one.nats is None),
        parameters=agreed,
    )


def common(observations: Sequence[Observation]) -> dict[str, Agreed]:
    """Parameters that all of the logs state, combined by inverse variance."""
    if not observations:
        return {}
    shared = [name for name in observations[0].parameters if all(name in one.parameters for one in observations)]
    return {name: combined([one.parameters[name] for one in observations]) for name in shared}


def combined(values: Sequence[tuple[float, float]]) -> Agreed:
    """(value, standard deviation) of several logs as one; standard deviations must be positive."""
    x, s = np.array(values, dtype=float).T
    weight = s**-2.0
    value = float(np.sum(weight * x) / np.sum(weight))
    chi2, dof = float(np.sum(weight * (x - value) ** 2)), len(x) - 1
    widened = np.sqrt(max(1.0, chi2 / dof)) if dof else 1.0
    p_value = float(chi_square.sf(chi2, dof)) if dof else 1.0
    return Agreed(value, float(widened / np.sqrt(np.sum(weight))), chi2, dof, p_value)


def same_way(one: Observation, agreed: Mapping[str, Agreed]) -> bool:
    """Whether the parameters of a log point the way of the common ones."""
    inner = sum(value * agreed[name].value / std**2 for name, (value, std) in one.parameters.items() if name in agreed)
    return not agreed or inner > 0.0


def _standing(
    nats: float,
    named: Sequence[Observation],
    pointing: Sequence[Observation],
    agreed: Mapping[str, Agreed],
    observations: Sequence[Observation],
) -> Standing:
    needed = max((one.threshold for one in observations), default=0.0)
    if not named:
        return Standing.HINT if nats >= needed > 0.0 else Standing.ABSENT
    if nats < needed:
        return Standing.CONTRADICTED
    if len(pointing) < FEWEST:
        return Standing.ONCE
    return Standing.REPEATS if all(one.agrees for one in agreed.values()) else Standing.VARIES
