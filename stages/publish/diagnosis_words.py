"""A diagnosis in words: the verdict in a sentence, parameters, places, shrinkage. For terminal, page and recording."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from schemas.diagnosis import Diagnosis, Finding, Gap, ParameterEstimate, Place, Tested, Transfer, Verdict

HEADLINES = {
    Verdict.NO_GAP: "The log behaves as its twin foretells.",
    Verdict.EXPLAINED: "The log departs from its twin, and the cause is found.",
    Verdict.PARTLY_EXPLAINED: "The log departs from its twin, and part of the cause is found.",
    Verdict.UNKNOWN_EFFECT: "The log departs from its twin, and nothing known explains it.",
}
GRADES = {
    Verdict.NO_GAP: "good",
    Verdict.EXPLAINED: "good",
    Verdict.PARTLY_EXPLAINED: "care",
    Verdict.UNKNOWN_EFFECT: "bad",
}
UNITS_OF_CHANNELS = {
    "main": "main IMU",
    "sub": "sub-IMU",
    "phins_main": "PHINS at main",
    "phins_sub": "PHINS at sub",
    "gnss": "GNSS",
    "sliding": "sliding SINS",
}
SURE_NATS = 14.0  # held out, below which what has no name is not said to follow a motion
IN_A_SENTENCE = 3  # parameters of an effect: the table has them all
QUANTITIES = {"accel": "accelerometer", "stamp": "stamps"}


def sentence(diagnosis: Diagnosis) -> str:
    """What causes the gap, how far it shrinks, and how sure that is, in one sentence."""
    if diagnosis.verdict is Verdict.NO_GAP:
        return f"Over {_length(diagnosis)}, none of {_count(diagnosis)} tested reaches its threshold."
    if not diagnosis.effects:
        return f"None of {_count(diagnosis)} tested explains it{_strongest(diagnosis)}."
    named = "; ".join(effect_text(finding) for finding in diagnosis.effects)
    return f"{named}: with {'it' if len(diagnosis.effects) == 1 else 'them'} {closed_text(diagnosis.gap)}."


def _length(diagnosis: Diagnosis) -> str:
    return f"{diagnosis.duration_s / 60:.0f} min" if diagnosis.duration_s >= 600 else f"{diagnosis.duration_s:.0f} s"


def _count(diagnosis: Diagnosis) -> str:
    tested = sum(1 for row in diagnosis.tested if row.evidence_nats is not None)
    return f"{tested} effect{'' if tested == 1 else 's'}"


def _strongest(diagnosis: Diagnosis) -> str:
    return f"; it is strongest in {place_text(diagnosis.where[0])}" if diagnosis.where else ""


def effect_text(finding: Finding) -> str:
    """``time_delay (delay_s 0.0153 ± 2.1e-05 s)``."""
    stated = ", ".join(f"{name} {value}" for name, value in islice(parameters(finding), IN_A_SENTENCE))
    return f"{finding.name} ({stated})" if stated else finding.name


def parameters(finding: Finding) -> Iterator[tuple[str, str]]:
    """Name and value of every parameter, a vector's axes one by one."""
    for name, value in finding.parameters.items():
        if isinstance(value, ParameterEstimate):
            yield name, value_text(value)
        else:
            yield from ((f"{name} {axis}", value_text(part)) for axis, part in value.items())


def value_text(parameter: ParameterEstimate) -> str:
    """Value ± standard deviation with its unit, the value to the digits that its uncertainty leaves it."""
    unit = f" {parameter.unit}" if parameter.unit and parameter.unit != "1" else ""
    if isinstance(parameter.value, str):
        return f"{parameter.value}{unit}"
    if parameter.std is None or not np.isfinite(parameter.std) or parameter.std <= 0:
        return f"{parameter.value:.4g}{unit}"
    digits = max(2, round(np.log10(max(abs(parameter.value), parameter.std) / parameter.std)) + 2)
    return f"{parameter.value:.{digits}g} ± {parameter.std:.2g}{unit}"


def closed_text(gap: Gap) -> str:
    """The gap shrinks by 98 % (95 to 99 %)."""
    low, high = (percent(share) for share in gap.closed_ci95)
    return f"the gap shrinks by {percent(gap.closed)} % (95 % interval {low} to {high} %)"


def percent(share: float) -> str:
    """A share in per cent; what is almost all of it, but not quite, says so."""
    value = 100 * share
    return f"{value:.2f}" if 99.5 <= value < 99.995 else f"{value:.0f}"


def channel_text(channel: str, axis: str = "") -> str:
    """``gyro of the sub-IMU, x``; a name that is none of the contract's as it stands."""
    unit, _, quantity = channel.partition(".")
    if unit not in UNITS_OF_CHANNELS:
        return f"{channel} {axis}".strip()
    return f"{QUANTITIES.get(quantity, quantity)} of the {UNITS_OF_CHANNELS[unit]}" + (f", {axis}" if axis else "")


def place_text(place: Place) -> str:
    """Channel, axis, band and stretch of time."""
    when = "the whole record" if place.window_s is None else f"{place.window_s[0]:.0f} to {place.window_s[1]:.0f} s"
    return f"the {channel_text(place.channel, place.axis)}, {band_text(*place.band_hz)}, {when}"


def transfer_text(found: Transfer) -> str:
    """How what has no name follows the ship's motion, at the frequency at which that is known best."""
    k = found.best
    into, source = channel_text(found.channel, found.axis), channel_text(found.source, found.source_axis)
    told = f"{nats(found.evidence_nats)} nats held out"
    if found.evidence_nats < SURE_NATS:
        return f"In the {into}, what has no name follows no motion of the ship: the {source} comes nearest ({told})."
    unit = "" if found.unit == "1" else f" {found.unit}"
    gain = f"gain {found.gain[k]:.3g} ± {found.gain_std[k]:.1g}{unit} at {found.frequency[k]:.2f} Hz"
    phase = f"phase {np.degrees(found.phase[k]):+.0f} ± {np.degrees(found.phase_std[k]):.0f}°"
    return f"Into the {into}, what has no name follows the {source} ({told}): {gain}, {phase}."


def band_text(low: float, high: float) -> str:
    """A band of frequencies."""
    if not np.isfinite(high):
        return f"above {low:.3g} Hz"
    return f"below {high:.3g} Hz" if low <= 0 else f"{low:.3g} to {high:.3g} Hz"


def band_short(low: float, high: float) -> str:
    """A band of frequencies in Hz, short enough to stand below a column."""
    return f"> {low:.2g}" if not np.isfinite(high) else f"< {high:.2g}" if low <= 0 else f"{low:.2g}–{high:.2g}"


def nats(value: float | None) -> str:
    """Evidence, a dash where it could not be tested."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value + 0.0 if abs(value) >= 0.05 else 0.0:.1f}"


def signed_log(value: float) -> float:
    """``sign(v) log10(1 + |v|)``."""
    return float(np.sign(value) * np.log10(1 + abs(value)))


def judged(row: Tested) -> str:
    """Whether an effect was named, and if not, why."""
    if row.named:
        return "named"
    return row.reason or ("not tested" if row.evidence_nats is None else "below its threshold")


def look_alikes(diagnosis: Diagnosis) -> list[str]:
    """One sentence for each effect that the log cannot tell from others."""
    return [_look_alike(finding) for finding in diagnosis.effects if finding.ambiguous_with]


def _look_alike(finding: Finding) -> str:
    pairs = zip(finding.ambiguous_with, (*finding.separated_by, *[""] * len(finding.ambiguous_with)))
    told = [f"{name} (told apart by {how})" if how else name for name, how in pairs]
    return f"{finding.name} looks the same in this log as {', '.join(told)}"


SECTION_HEADER = ("section", "verdict", "named [nats]")


def sections(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Times, verdict and named effects of every section of a long record."""
    rows = []
    for one in diagnosis.sections:
        when = f"{one.begin_s / 3600.0:.1f} to {one.end_s / 3600.0:.1f} h"
        verdict = "not diagnosed" if one.verdict is None else str(one.verdict).replace("_", " ")
        named = "; ".join(f"{name} {nats(evidence)}" for name, evidence in one.effects)
        rows.append((when, verdict, named or one.problem))
    return rows


def shrinkage(diagnosis: Diagnosis) -> list[tuple[str, Gap]]:
    """The answer's gap and those of what is not the answer, by what they are."""
    answer = ", ".join(finding.name for finding in diagnosis.effects) or "nothing named"
    others = [(f"{one.role}: {one.name}", one.gap) for one in diagnosis.comparisons]
    return [(f"answer: {answer}", diagnosis.gap), *others]


def error_rows(diagnosis: Diagnosis) -> list[tuple[str, np.ndarray]]:
    """The four RMSE by what they are of, arcmin."""
    e = diagnosis.rmse
    if e is None:
        return []
    return [
        ("log", e.log),
        ("twin", e.twin),
        ("twin with the effects", e.twin_with_effects),
        ("log, compensated", e.log_compensated),
    ]


def against(diagnosis: Diagnosis) -> str:
    """What the four RMSE are taken against, with the word before it; empty where that is not stated."""
    return f" against {diagnosis.rmse.reference}" if diagnosis.rmse and diagnosis.rmse.reference else ""
