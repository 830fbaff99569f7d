"""Picks and processes as findings, and findings as effects of a twin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from schemas.diagnosis import Finding, ParameterEstimate, Parameters, Place
from stages.diagnose import instability, pictures
from stages.diagnose.evidence import combined
from stages.diagnose.instability import Wander
from stages.diagnose.pick import Pick
from stages.diagnose.regressors import view_of
from stages.diagnose.selection import Selection, nats_of
from twin import effects
from twin.effects import Effect
from twin.effects._prediction import Signals

ALIKE_NATS = 5.0  # by which another effect may fall short and still be a look-alike
ALIKE_SHARE = 0.9  # of the evidence
RELATIVE = {"amplitude_stiffening": 0.15}  # of a parameter: it is told in units of what the twin knows only so well


def of_pick(chosen: Selection, pick: Pick) -> Finding:
    """A mean effect as a finding."""
    name = pick.group.effect
    evidence = chosen.evidence[name]
    alike = _look_alikes(chosen, pick, evidence)
    told = {item.name: item.separated_by for item in effects.look_alikes(name, _channels(chosen))}
    return Finding(
        name=name,
        parameters=_parameters(pick, float(np.median(np.diff(chosen.base.obs.t)))),
        evidence_nats=float(evidence),
        ambiguous_with=alike,
        separated_by=tuple(told.get(other, "another sea state, or a manoeuvre") for other in alike),
        places=(_place(chosen, pick, evidence),),
        advice=effects.get(name).advice,
    )


def of_wander(found: Wander) -> Finding:
    """A wandering bias as a finding."""
    axis = "xyz"[int(np.argmax(found.by_axis))]
    band = (0.2 / (2.0 * np.pi * found.tau), 5.0 / (2.0 * np.pi * found.tau))
    return Finding(
        name=instability.NAME,
        parameters={
            "std": ParameterEstimate(found.std, found.std_error, "deg/h"),
            "tau": ParameterEstimate(found.tau, found.tau_error, "s"),
        },
        evidence_nats=found.evidence,
        places=(Place("sub.gyro", axis, band, None, found.evidence),),
        advice=effects.get(instability.NAME).advice,
    )


def _parameters(pick: Pick, interval: float) -> Parameters:
    """interval: s between samples of the log."""
    units = {item.name: item.unit for item in effects.get(pick.group.effect).parameters()}
    std = np.hypot(np.sqrt(np.diag(pick.covariance)), RELATIVE.get(pick.group.effect, 0.0) * pick.value)
    out: dict[str, Any] = {}
    for parameter, value, error in zip(pick.group.parameters, pick.value, std):
        owner, _, axis = parameter.partition(".")
        estimate = ParameterEstimate(float(value), float(error), units[owner])
        if axis:
            out.setdefault(owner, {})[axis] = estimate
        else:
            out[owner] = estimate
    for key, value in pick.group.shape.items():
        spread = pick.shape_std if key == "period" else 0.5 * interval  # a step is found to the sample
        out[key] = ParameterEstimate(float(value), float(spread), units[key])
    return out


def _look_alikes(chosen: Selection, pick: Pick, evidence: float) -> tuple[str, ...]:
    """Effects that would explain as much in the pick's place."""
    others = [other for other in chosen.picks if other is not pick]
    base = [k for k in chosen.explained if k not in chosen.columns(pick)]
    taken = {other.group.effect for other in others} | {pick.group.effect}
    found: dict[str, float] = {}
    for group in chosen.regressors.groups:
        if group.effect in taken or group.is_event or pick.group.is_event:
            continue
        nats = nats_of(chosen.gram, base, group)
        if nats >= max(ALIKE_SHARE * evidence, evidence - ALIKE_NATS) - 1e-9 and nats > 0.0:
            found[group.effect] = max(nats, found.get(group.effect, 0.0))
    return tuple(sorted(found, key=lambda name: -found[name]))


def _channels(chosen: Selection) -> tuple[str, ...]:
    trial = chosen.base.source.trial
    out = ["main.gyro", "main.accel", "sub.gyro", "sub.accel", "sub.stamp"]
    out += ["phins_main.attitude"] if trial.phins_main is not None else []
    out += ["phins_sub.attitude"] if trial.phins_sub is not None else []
    return tuple(out + (["sub.temperature"] if trial.temperature_sub is not None else []))


def _place(chosen: Selection, pick: Pick, score: float) -> Place:
    columns = effects.get(pick.group.effect).predict(view_of(chosen.base), **dict(pick.group.shape))
    worst = int(np.argmax(np.abs(pick.value) / np.sqrt(np.diag(pick.covariance))))
    channel = channel_of(columns[worst].signals)
    axis = pick.group.parameters[worst].rpartition(".")[2][:1]
    axis = axis if axis in "xyz" and len(pick.group.parameters) > 1 else ""
    places = [chosen.gram.index([name])[0] for name in (chosen.gram.names[k] for k in chosen.columns(pick))]
    band = pictures.band_of(combined(chosen.regressors.columns, places, pick.value), chosen.base.t)
    time = pick.group.shape.get("time")
    return Place(channel, axis, band, None if time is None else (time - 1.0, time + 1.0), float(score))


def channel_of(signals: Signals) -> str:
    """The channel that an effect sits in."""
    if signals.gyro is not None and signals.accel is not None:
        return "sub.stamp"
    if signals.accel is not None:
        return "sub.accel"
    if signals.phins_main is not None or signals.phins is not None:
        return "phins_sub.attitude"
    return "sub.gyro"


def as_effect(finding: Finding) -> Effect:
    """The effect of a twin that a finding speaks of."""
    parameters: dict[str, Any] = {}
    for name, value in finding.parameters.items():
        if isinstance(value, Mapping):
            parameters[name] = {axis: item.value for axis, item in value.items()}
        else:
            parameters[name] = value.value
    return effects.build(finding.name, parameters)
