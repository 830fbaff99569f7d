"""Simulated logs of the random sea with effects, and what a diagnosis says of them."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from schemas.trial import ImuSeries, Trial
from stages.align import align
from stages.diagnose.baseline import Baseline, baseline
from stages.diagnose.shrinkage import augmented_twin
from stages.diagnose.view import believed
from twin import Twin, effects, load_twin, parse_twin, simulate, with_run

TWIN = with_run(load_twin("random-sea"), duration=330.0)

Parameters = dict[str, Any]


def log(*given: tuple[str, Parameters], seed: int = 7, of: Twin = TWIN) -> Trial:
    """A trial of the twin with effects; its truth is thrown away."""
    twin = parse_twin(augmented_twin(of, [effects.build(name, parameters) for name, parameters in given]))
    return simulate(twin, np.random.default_rng(seed)).trial


def baseline_of(trial: Trial) -> Baseline:
    return baseline(believed(trial, TWIN), align(trial))


def without_aids(trial: Trial) -> Trial:
    """Both IMUs alone."""
    return replace(trial, phins_main=None, phins_sub=None, temperature_main=None, temperature_sub=None)


def with_gap(trial: Trial, begin: float, end: float) -> Trial:
    """Both IMUs silent from begin to end, s."""
    return replace(trial, main=_cut(trial, trial.main, begin, end), sub=_cut(trial, trial.sub, begin, end))


def _cut(trial: Trial, series: ImuSeries, begin: float, end: float) -> ImuSeries:
    t = trial.seconds(series.stamp)
    keep = (t <= begin) | (t >= end)
    return part(series, keep)


def part(series: ImuSeries, keep: np.ndarray) -> ImuSeries:
    values = {field.name: getattr(series, field.name) for field in fields(series)}
    return replace(series, **{
        name: value[keep] for name, value in values.items()
        if isinstance(value, np.ndarray) and len(value) == len(keep)
    })  # fmt: skip
