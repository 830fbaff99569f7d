"""Effects over the logs of an archive: the diagnosis reports as observations, and what they say together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from stages.archive.repetition import Observation, Repetition, Standing, repetition

NOT_COMMON = frozenset({"time", "phase"})  # parameters that belong to a voyage, not to an installation


Reports = Sequence[tuple[str, Mapping[str, Any]]]
"""Names of logs, each with the effects and tested rows of its diagnosis report."""


def repeated(reports: Reports) -> tuple[Repetition, ...]:
    """Every effect that some log spoke for, the strongest evidence first."""
    labels = sorted({label for _, report in reports for label in _labels(report)})
    found = (repetition(label, [_observed(name, report, label) for name, report in reports]) for label in labels)
    seen = [one for one in found if one.standing is not Standing.ABSENT]
    return tuple(sorted(seen, key=lambda one: -one.nats))


def _labels(report: Mapping[str, Any]) -> Iterable[str]:
    """Effects by name, and by axis where one is stated: an effect about another axis is another effect."""
    yield from (label_of(effect) for effect in report["effects"])
    yield from (row["name"] for row in report["tested"] if not row["named"])


def label_of(effect: Mapping[str, Any]) -> str:
    """``narrowband_vibration z``; the name alone where there is no axis."""
    words = [str(value["value"]) for value in effect["parameters"].values() if isinstance(value.get("value"), str)]
    return " ".join([effect["name"], *words])


def _observed(log: str, report: Mapping[str, Any], label: str) -> Observation:
    """What one log says. Beside named effects, the evidence of others is theirs in part and says nothing."""
    tested = {row["name"]: row for row in report["tested"]}
    row = tested.get(label.partition(" ")[0], {})
    threshold = float(row.get("threshold_nats") or 0.0)
    for effect in report["effects"]:
        if label_of(effect) == label:
            return Observation(log, float(effect["evidence_nats"]), threshold, True, stated(report, label))
    nats = row.get("evidence_nats")
    if report["effects"] or nats is None or nats >= threshold:
        return Observation(log, None, threshold, False, {})
    return Observation(log, float(nats), threshold, False, {})


def stated(report: Mapping[str, Any], label: str) -> dict[str, tuple[float, float]]:
    """(value, standard deviation) of each parameter that a report states of an effect; nothing where it names none."""
    return {
        name: value
        for effect in report["effects"]
        if label_of(effect) == label
        for name, value in _flat(effect["parameters"])
    }


def _flat(parameters: Mapping[str, Any], of: str = "") -> Iterable[tuple[str, tuple[float, float]]]:
    """(name, (value, standard deviation)) of the parameters that have both and may be common."""
    for name, value in parameters.items():
        if "unit" not in value:
            yield from _flat(value, f"{name}.")
        elif name not in NOT_COMMON and isinstance(value["value"], float | int) and (value["std"] or 0.0) > 0.0:
            yield f"{of}{name}", (float(value["value"]), float(value["std"]))


def units_of(reports: Reports, label: str) -> dict[str, str]:
    """Unit of each parameter of an effect, as the reports state it."""
    for _, report in reports:
        for effect in report["effects"]:
            if label_of(effect) == label:
                return dict(_units(effect["parameters"]))
    return {}


def _units(parameters: Mapping[str, Any], of: str = "") -> Iterable[tuple[str, str]]:
    for name, value in parameters.items():
        if "unit" in value:
            yield f"{of}{name}", str(value["unit"])
        else:
            yield from _units(value, f"{name}.")
