"""A report held against the truth: what was named, what it is worth, parameter by parameter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.blind.places import is_right
from pipeline.blind.plan import CHANNELS

NOT_SIZES = {"tau", "period", "time", "frequency", "damping", "rate", "length", "order", "knee", "yield_sigmas"}
FOREIGN_ALIKES = {  # what may be named beside "unknown" for a form that the library does not have
    "bouc_wen": {"flexure_parameters", "amplitude_stiffening", "second_mode"},
    "rate_nonlinearity": {"gyro_scale_factor", "gyro_nonorthogonality"},
    "fractional_flexure": {"flexure_parameters", "second_mode", "gyro_random_walk"},
    "sinusoidal_clock": {"time_delay", "clock_drift"},
}
CONFIDENT = "explained"


@dataclass(frozen=True)
class Parameter:
    """One estimated number of an effect that was named rightly. z: error over its standard deviation, or None."""

    effect: str
    key: str
    severity: float
    true: float
    value: float
    z: float | None


@dataclass(frozen=True)
class Case:
    """A log of the set with its truth (an entry of the answers) and the report on it."""

    truth: Mapping[str, Any]
    report: Mapping[str, Any]

    @property
    def kind(self) -> str:
        """null, single, pair, foreign, or removed: a single one whose effect the library was denied."""
        denied = set(self.report.get("without", ())) & set(self.true_names)
        return "removed" if denied and self.truth["kind"] == "single" else str(self.truth["kind"])

    @property
    def failed(self) -> bool:
        """There is no report."""
        return "failure" in self.report

    @property
    def true_names(self) -> list[str]:
        """Effects that are in the log."""
        return [effect["name"] for effect in self.truth["effects"]]

    @property
    def severity(self) -> float:
        """Multiple of the detectable severity, 0 for a null."""
        return float(self.truth.get("severity") or 0.0)

    @property
    def verdict(self) -> str:
        """Of the report; ``failure`` where there is none."""
        return "failure" if self.failed else str(self.report.get("verdict", ""))

    @property
    def named(self) -> list[str]:
        """Effects named, by evidence."""
        return [] if self.failed else [effect["name"] for effect in self.report.get("effects", ())]

    @property
    def first(self) -> str:
        """The first name, else the verdict."""
        return self.named[0] if self.named else self.verdict

    @property
    def candidates(self) -> set[str]:
        """Everything named, look-alikes stated with it included."""
        out: set[str] = set()
        if not self.failed:
            for effect in self.report.get("effects", ()):
                out |= {effect["name"], *effect.get("ambiguous_with", ())}
        return out

    @property
    def detected(self) -> bool:
        """The report says that something is there."""
        return not self.failed and (bool(self.named) or self.verdict not in ("no_gap", ""))

    @property
    def right_first(self) -> bool:
        """The first name is an effect of the log."""
        return bool(self.named) and self.named[0] in self.true_names

    @property
    def right_group(self) -> bool:
        """The first name or a look-alike stated with it is an effect of the log."""
        if not self.named:
            return False
        alike = self.report["effects"][0].get("ambiguous_with", ())
        return bool({self.named[0], *alike} & set(self.true_names))

    @property
    def spurious(self) -> list[str]:
        """Names of effects that are not in the log."""
        return [name for name in self.named if name not in self.true_names]

    @property
    def not_explained(self) -> bool:
        """The report admits that it cannot explain the log."""
        return self.verdict in ("unknown_effect", "partly_explained")

    @property
    def confidently_wrong(self) -> bool:
        """Explained, it says, by names none of which is the effect or one that may pass for it."""
        allowed = set(self.true_names).union(*(look_alike_names(name) for name in self.true_names))
        return self.verdict == CONFIDENT and not allowed & self.candidates

    def place_right(self, count: int = 1) -> bool:
        """One of the first ``count`` places is where an effect of the log shows."""
        places = [] if self.failed else self.report.get("where", ())[:count]
        return any(is_right(e, p["channel"], p.get("axis") or "") for e in self.truth["effects"] for p in places)

    def parameters(self) -> list[Parameter]:
        """Every number estimated for an effect of the log that was named."""
        out: list[Parameter] = []
        for effect in self.truth["effects"]:
            found = next((e for e in self.report.get("effects", ()) if e["name"] == effect["name"]), None)
            if found is not None and not self.failed:
                out += _compared(effect, found, self.severity)
        return out


def look_alike_names(name: str) -> set[str]:
    """What may pass for an effect: the library's stated look-alikes, or for a foreign form those stated here."""
    from twin import effects

    if name in FOREIGN_ALIKES:
        return FOREIGN_ALIKES[name]
    return {alike.name for alike in effects.look_alikes(name, CHANNELS)}


def relative_error(case: Case) -> float | None:
    """Length of the error of an effect's sizes over the length of the sizes; None where they were not estimated.

    Flexure parameters have different units: the root mean square of their relative errors.
    """
    found = case.parameters()
    if found and found[0].effect == "flexure_parameters":
        return float(np.sqrt(np.mean([(p.value / p.true - 1.0) ** 2 for p in found if p.true])))
    sizes = [p for p in found if p.key.split(".")[0] not in NOT_SIZES]
    true = np.array([p.true for p in sizes])
    if not len(sizes) or not np.linalg.norm(true):
        return None
    return float(np.linalg.norm(np.array([p.value for p in sizes]) - true) / np.linalg.norm(true))


def _compared(effect: Mapping[str, Any], found: Mapping[str, Any], severity: float) -> Iterable[Parameter]:
    truth = dict(_flat(effect.get("effective", effect["parameters"])))
    if effect["name"] == "flexure_parameters":  # only what was changed is the effect
        drawn = dict(_flat(effect["parameters"]))
        truth = {key: value for key, value in truth.items() if key in drawn}
    for key, (value, std) in _estimates(found.get("parameters", {})).items():
        if key in truth:
            z = (value - truth[key]) / std if std else None
            yield Parameter(effect["name"], key, severity, truth[key], value, z)


def _flat(values: Mapping[str, Any]) -> Iterable[tuple[str, float]]:
    """Numbers by dotted name: lists are per axis."""
    for key, value in values.items():
        if isinstance(value, list):
            yield from ((f"{key}.{axis}", float(v)) for axis, v in zip("xyz", value) if v is not None)
        elif isinstance(value, int | float):
            yield key, float(value)


def _estimates(values: Mapping[str, Any], prefix: str = "") -> dict[str, tuple[float, float | None]]:
    """Value and standard deviation by dotted name."""
    out: dict[str, tuple[float, float | None]] = {}
    for key, entry in values.items():
        if not isinstance(entry, dict):
            continue
        if "value" not in entry:
            out |= _estimates(entry, f"{prefix}{key}.")
        elif isinstance(entry["value"], int | float):
            out[f"{prefix}{key}"] = (float(entry["value"]), entry.get("std"))
    return out
