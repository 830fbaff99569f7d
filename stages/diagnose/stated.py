"""Effects that a twin states and that no log can be freed of (noise, losses, another flexure): found again, they are no
gap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from schemas.diagnosis import Finding, ParameterEstimate
from twin import effects
from twin.config import Twin

SIGMAS, SHARE = 3.0, 0.1  # of a parameter's standard deviation, and of itself, by which it may be off what is stated


def news(findings: Sequence[Finding], twin: Twin) -> tuple[Finding, ...]:
    """Those findings that the twin does not state, or states with other parameters."""
    stated = {spec.name: effects.build(spec.name, spec.parameters).model_dump() for spec in twin.effect}
    return tuple(f for f in findings if f.name not in stated or not _agrees(f, stated[f.name]))


def _agrees(finding: Finding, stated: Mapping[str, Any]) -> bool:
    return all(_alike(estimate, said) for estimate, said in _pairs(finding, stated) if said is not None)


def _alike(estimate: ParameterEstimate, said: float | str) -> bool:
    if isinstance(said, str) or isinstance(estimate.value, str):
        return estimate.value == said
    return abs(estimate.value - said) <= SIGMAS * (estimate.std or 0.0) + SHARE * abs(said)


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
