"""A named effect: the columns it was found in, its values, and the effect that they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schemas.rig import FloatArray
from stages.diagnose import whitening
from stages.diagnose.baseline import Baseline
from stages.diagnose.evidence import Gram, combined, solve
from stages.diagnose.regressors import Group, Regressors, view_of
from twin import effects
from twin.effects import Effect

PERIOD_ROUNDS = 4


@dataclass(frozen=True)
class Pick:
    """A named effect: its group's columns, values and covariance in the units of the declaration, taken-out part in.

    taken: (k,) of the values, what was taken out of the log; nothing of an effect that stays.
    """

    group: Group
    value: FloatArray
    covariance: FloatArray
    taken: FloatArray
    shape_std: float = 0.0

    @property
    def effect(self) -> Effect:
        """The effect with these parameters."""
        return built(self.group, self.value)


def built(group: Group, value: FloatArray) -> Effect:
    """An effect from the values of a group's columns, held to what makes sense."""
    parameters: dict[str, Any] = dict(group.shape)
    for name, number in zip(group.parameters, value):
        owner, _, axis = name.partition(".")
        if axis:
            parameters.setdefault(owner, {})[axis] = float(number)
        else:
            parameters[owner] = float(number)
    for item in effects.get(group.effect).parameters():  # a trial value may lie beyond what makes sense
        stated = parameters.get(item.name)
        if isinstance(stated, dict):
            parameters[item.name] = {axis: float(np.clip(v, item.least, item.most)) for axis, v in stated.items()}
        elif stated is not None:
            parameters[item.name] = float(np.clip(stated, item.least, item.most))
    return effects.build(group.effect, parameters)


def at_period(group: Group, period: float) -> Group:
    """The group with another period."""
    names = tuple(f"{group.effect}|{parameter}|period={period:.6g}" for parameter in group.parameters)
    return replace(group, names=names, shape={**group.shape, "period": period})


def with_period(base: Baseline, found: Regressors, gram: Gram, kept: Sequence[int], group: Group) -> Pick:
    """A sine with the period that fits best, from the one of its group on."""
    view, cls = view_of(base), effects.get(group.effect)
    own = found.columns[:, : base.whitened.values.shape[1]]
    frozen = base.whitened.values - combined(own, kept, solve(gram.total, gram.precision, kept).value)

    def tried(period: float) -> tuple[float, FloatArray, FloatArray]:
        raw = base.response.many(column.signals for column in cls.predict(view, **{"period": period}))
        X = np.concatenate([own[:, :, kept], whitening.whiten_columns(base.whitened, raw)], axis=2)
        ok = np.isfinite(frozen)
        Z = np.column_stack([X[ok], base.whitened.values[ok]])
        precision = np.concatenate([gram.precision[kept], np.zeros(raw.shape[2])])
        fit = solve(Z.T @ Z, precision, range(X.shape[2]))
        k = raw.shape[2]
        return fit.gain, fit.value[-k:], fit.covariance[-k:, -k:]

    log_period = np.log(group.shape["period"])
    width = 0.5 * np.exp(log_period) / (view.t[-1] - view.t[0])
    for _ in range(PERIOD_ROUNDS):
        offsets = np.linspace(-width, width, 5)
        gains = [tried(float(np.exp(log_period + offset)))[0] for offset in offsets]
        log_period += offsets[int(np.argmax(gains))]
        width *= 0.4
    period = float(np.exp(log_period))
    _, value, covariance = tried(period)
    return Pick(at_period(group, period), value, covariance, np.zeros(len(value)))
