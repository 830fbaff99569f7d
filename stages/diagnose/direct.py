"""Direct checks: what the stamps and the values of the sub-IMU say by themselves, before any model.

What they explain is reported, and repaired where it can be: jittered stamps are set on the line they scatter about,
clipped samples are left out. Both units are looked at: what the main IMU shows too comes from the recorder, not from
the sub-IMU, and is no finding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schemas.diagnosis import Finding
from schemas.trial import Trial
from stages.diagnose.direct_stamps import dropout, even, hidden_jitter, interval_of, jitter
from stages.diagnose.direct_values import clipped, quantization, saturation
from twin import effects
from twin.config import Twin

EFFECTS = ("timestamp_jitter", "sample_dropout", "gyro_quantization", "gyro_saturation")
FEWEST = 500  # samples below which statistics of stamps and values say nothing


@dataclass(frozen=True)
class DirectChecks:
    """findings: with evidence. masked: the trial, repaired. untestable: effect to reason. notes: what was repaired."""

    findings: tuple[Finding, ...]
    masked: Trial
    untestable: dict[str, str]
    notes: tuple[str, ...] = ()


def check(trial: Trial, twin: Twin) -> DirectChecks:
    """All direct checks of a trial. What the twin says of these effects itself is not found again."""
    if len(trial.sub) < FEWEST:
        return DirectChecks((), trial, dict.fromkeys(EFFECTS, f"fewer than {FEWEST} samples of the sub-IMU"))
    known = {spec.name for spec in twin.effect}
    found = [dropout(trial), jitter(trial), quantization(trial), saturation(trial)]
    if found[1] is None and found[3] is None:  # clipping leaves no noise where the rate is large
        found[1] = hidden_jitter(trial)
    findings = tuple(finding for finding in found if finding is not None and finding.name not in known)
    names = {finding.name for finding in findings}
    masked, notes = _repaired(trial, names)
    return DirectChecks(tuple(sorted(map(_advised, findings), key=lambda finding: -finding.evidence_nats)), masked,
                        _untestable(trial, names), notes)  # fmt: skip


def _advised(finding: Finding) -> Finding:
    return replace(finding, advice=effects.get(finding.name).advice)


def _repaired(trial: Trial, names: set[str]) -> tuple[Trial, tuple[str, ...]]:
    sub, notes = trial.sub, []
    if "timestamp_jitter" in names:
        sub = replace(sub, stamp=even(sub.stamp, interval_of(trial.main)))
        notes.append("stamps of the sub-IMU set on the line they scatter about")
    if "gyro_saturation" in names:
        keep = ~clipped(sub.gyro)
        sub = replace(sub, stamp=sub.stamp[keep], gyro=sub.gyro[keep], accel=sub.accel[keep],
                      attitude=None if sub.attitude is None else sub.attitude[keep])  # fmt: skip
        notes.append(f"{int(np.count_nonzero(~keep))} clipped samples of the sub-IMU's gyros left out")
    return replace(trial, sub=sub), tuple(notes)


def _untestable(trial: Trial, names: set[str]) -> dict[str, str]:
    """What this log cannot show."""
    if "gyro_saturation" in names:
        return {}
    top = np.abs(trial.sub.gyro).max() / np.pi * 180.0
    return {"gyro_saturation": f"rates stay below {top:.2f} deg/s: a range beyond that cannot show"}
