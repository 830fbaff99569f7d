"""Effects that a twin states and that neither its parameters can say nor a log be freed of (losses, a lattice, a second
mode): found again, they are no gap.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from schemas.diagnosis import Finding, ParameterEstimate
from twin import effects
from twin.config import Twin
from twin.effects import Effect

SIGMAS, SHARE = 3.0, 0.1  # of a parameter's standard deviation, and of itself, by which it may be off what is stated


def news(findings: Sequence[Finding], twin: Twin) -> tuple[Finding, ...]:
    """Those findings that are not of an effect that stays in the log and that the twin states with these parameters."""
    made = [effects.build(spec.name, spec.parameters) for spec in twin.effect]
    stated = {effect.name: effect.model_dump() for effect in made if effect.stays and type(effect).twin is Effect.twin}
    return tuple(f for f in findings if f.name not in stated or not _agrees(f, stated[f.name]))


def _agrees(finding: Finding, stated: Mapping[str, Any]) -> bool:
    return all(_alike(estimate, said) for estimate, said in _pairs(finding, stated) if said is not None)


def _alike(estimate: ParameterEstimate, said: float | str) -> bool:
    if isinstance(said, str) or isinstance(estimate.value, str):
        return estimate.value == said
    found = estimate.value
    # A size that the log hardly tells is still not a small part of itself.
    apart = abs(found * np.log(found / said)) if found * said > 0.0 else abs(found - said)
    return bool(apart <= SIGMAS * (estimate.std or 0.0) + SHARE * abs(found))


def _pairs(finding: Finding, stated: Mapping[str, Any]) -> Iterator[tuple[ParameterEstimate, Any]]:
    """Every number or word of a finding beside what is stated of it; None is the twin's own."""
    for name, estimate in finding.parameters.items():
        said = stated.get(name)
        if not isinstance(estimate, Mapping):
            yield estimate, said
            continue
        of_axis = said if isinstance(said, Mapping) else dict(zip("xyz", said or (None, None, None)))
        for axis, item in estimate.items():
            yield item, of_axis.get(axis)
