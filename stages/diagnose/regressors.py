"""Regressors of all mean effects on one baseline, whitened, with their Gram matrices.

An effect's columns form groups: one group for each shape (a period, a time) that it may have. Shapes are chosen by what
the log says: steps where the gyros' innovations jump, periods where the PHINS' innovations ring.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import czt

from schemas.rig import FloatArray
from stages.diagnose import stiffening, whitening
from stages.diagnose.baseline import Baseline
from stages.diagnose.evidence import Gram, gram
from stages.diagnose.latency import main_column, main_match
from stages.diagnose.nuisances import STIFFNESS_SHARE, seen_flexure, whole_window
from stages.diagnose.stiffening import Deck
from stages.diagnose.view import arw_of, log_view
from twin import effects
from twin.effects._prediction import Column, LogView, Signals

ComplexArray = NDArray[np.complex128]

PERIODS_TRIED = 4
PRIOR_REACH = 2.0  # sigma of an effect's parameter over the largest of its declared range
SHORTEST_DAY_S = 300.0  # of bending by the sun: half the shortest period that is declared
SHORTEST_PERIOD_S, LONGEST_PERIOD = 20.0, 4.0  # s; in lengths of the record


@dataclass(frozen=True)
class Group:
    """Columns of one effect with one shape. names: of the columns in the Gram; parameters: theirs, in this order. deck:
    of the effect whose parameter is told in units of the deck's own stiffness."""

    effect: str
    names: tuple[str, ...]
    parameters: tuple[str, ...]
    shape: Mapping[str, float] = field(default_factory=dict)
    deck: Deck | None = None

    @property
    def is_event(self) -> bool:
        """Whether it happens at one instant."""
        return "time" in self.shape

    @property
    def slope(self) -> str:
        """Name of the column of its period, where it is named and has one."""
        return f"{self.effect}|period"


@dataclass(frozen=True)
class Regressors:
    """All groups of one baseline, and the Gram matrices of their columns beside the nuisances'.

    values: (N, m) whitened innovations, the main PHINS's channels beside them where there are any. columns: (N, m, K).
    """

    groups: tuple[Group, ...]
    gram: Gram
    nuisances: tuple[str, ...]
    values: FloatArray
    columns: FloatArray
    untestable: Mapping[str, str]

    def of(self, effect: str) -> tuple[Group, ...]:
        """The groups of one effect."""
        return tuple(group for group in self.groups if group.effect == effect)


def view_of(base: Baseline) -> LogView:
    """The view from which effects predict."""
    theta = seen_flexure(base.obs, base.at.R_ref, whole_window(base.flexure, arw_of(base.source)))
    return log_view(base.source, base.obs, base.at.R_ref, theta, base.flexure)


def regressors(
    base: Baseline, view: LogView, names: Sequence[str], free: Sequence[tuple[Group, FloatArray]] = ()
) -> Regressors:
    """Columns of the named effects; free: groups that are already named, with their values (k,): they keep their own
    shape, and a period gets a column of its own, what a second of it changes."""
    groups: list[Group] = []
    untestable: dict[str, str] = {}
    match, on_main, first = main_match(base), {}, base.columns.shape[2]

    def told() -> Iterator[Signals]:
        """Signals of all columns, one at a time: together they would be larger than the log."""
        at = first
        for group, columns in _predicted(base, view, names, free, untestable):
            groups.append(group)
            for column in columns:
                if match is not None and column.signals.phins_main is not None:
                    on_main[at] = main_column(base, match, column.signals)
                at += 1
                yield column.signals

    raw = [base.response.many(told())]
    columns_of = [label for group in groups for label in group.names]
    for group, value in free:
        if "period" in group.shape:
            columns_of.append(group.slope)
            raw.append(_period_slope(base, view, group, value)[:, :, None])
    if stiffening.NAME in names:
        columns_of += stiffening.NAMES
        raw.append(base.response.many(stiffening.columns(view)))
    own = [nuisance.name for nuisance in base.nuisances]
    white = _side_by_side(base, raw, 0 if match is None else match.y.shape[1])
    raw.clear()
    whitening.whitened_in_place(base.whitened, white, first)
    rows = base.columns.shape[1]
    for at, column in on_main.items():
        white[:, rows:, at] = column
    values = base.whitened.values if match is None else np.hstack([base.whitened.values, match.y])
    precision = np.concatenate([base.precision, [_precision(label) for label in columns_of]])
    found = gram([*own, *columns_of], white, values, base.t, precision)
    return Regressors(tuple(groups), found, tuple(own), values, white, untestable)


def _predicted(
    base: Baseline, view: LogView, names: Sequence[str], free: Sequence[tuple[Group, FloatArray]],
    untestable: dict[str, str],
) -> Iterator[tuple[Group, Sequence[Column]]]:  # fmt: skip
    """Groups with their columns, one after the other; what cannot be tested, and why, goes into ``untestable``."""
    for name in names:
        kept = [group.shape for group, _ in free if group.effect == name]
        deck = _deck(name, view, free)
        about = view if deck is None else replace(view, stiffness=deck.found[1])
        why = _missing(name, base)
        if why:
            untestable[name] = why
            continue
        for shape in kept or _shapes(name, base, view):
            columns = effects.get(name).predict(about, **shape)
            if not columns:
                untestable.setdefault(name, "the log lacks what it follows (attitude, temperature)")
                continue
            labels = tuple(f"{name}|{column.parameter}|{_label(shape)}" for column in columns)
            yield Group(name, labels, tuple(column.parameter for column in columns), shape, deck), columns


def _side_by_side(base: Baseline, raw: Sequence[FloatArray], more: int) -> FloatArray:
    """(N, m + more, K) the baseline's columns (N, m, k) and further ones; rows beyond theirs are zero."""
    rows, at = base.columns.shape[1], 0
    out = np.zeros((len(base.t), rows + more, sum(part.shape[2] for part in (base.columns, *raw))))
    for part in (base.columns, *raw):
        out[:, :rows, at : at + part.shape[2]] = part[:, :rows]
        at += part.shape[2]
    return out


def _deck(name: str, view: LogView, free: Sequence[tuple[Group, FloatArray]]) -> Deck | None:
    """The deck of an effect that asks for one: as its twin has it, or as found beside the effect."""
    if name != stiffening.NAME:
        return None
    found = [group.deck.found for group, _ in free if group.effect == name and group.deck is not None]
    deck = stiffening.deck_of(view)
    return replace(deck, found=found[0]) if found else deck


def _precision(label: str) -> float:
    """Of the prior that no parameter is far beyond its declared range; none for the column of a period. A deck's own
    columns are as free as the model's stiffness and damping."""
    name, parameter = label.split("|")[:2]
    if label in stiffening.NAMES:
        return 1.0 / STIFFNESS_SHARE**2
    if parameter == "period":
        return 0.0
    declared = {item.name: item for item in effects.get(name).parameters()}
    return 1.0 / (PRIOR_REACH * declared[parameter.partition(".")[0]].prior[1]) ** 2


def _period_slope(base: Baseline, view: LogView, group: Group, value: FloatArray) -> FloatArray:
    """(N, 9) per second of period, by central differences."""
    period = group.shape["period"]
    step = 1e-3 * period
    cls = effects.get(group.effect)

    def answer(at: float) -> FloatArray:
        columns = cls.predict(view, **{**group.shape, "period": at})
        return sum((v * base.response(c.signals) for v, c in zip(value, columns)), np.zeros((len(base.t), 9)))

    return np.asarray((answer(period + step) - answer(period - step)) / (2.0 * step))


def _label(shape: Mapping[str, float]) -> str:
    return ",".join(f"{key}={value:.6g}" for key, value in shape.items())


def _missing(name: str, base: Baseline) -> str:
    """Why an effect cannot be tested on this baseline, empty where it can."""
    needs = " ".join(effects.get(name).needs)
    if "accel" in needs and not base.source.forces:
        return "there are no accelerometers in the log that show gravity"
    if "phins" in needs and base.match is None:
        return "there is no pair of PHINS with attitude in the log"
    if "temperature" in needs and base.source.trial.temperature_sub is None:
        return "there is no temperature of the sub-IMU in the log"
    return ""


def _shapes(name: str, base: Baseline, view: LogView) -> list[dict[str, float]]:
    if name == "misalignment_step":
        return [{"time": time - 0.5 * view.interval} for time in base.jumps]
    if name == "thermal_bending":
        length = view.t[-1] - view.t[0]
        return [{"period": float(p)} for p in np.geomspace(max(length / 4.0, SHORTEST_DAY_S), 8.0 * length, 6)]
    if name == "phins_attitude_error":
        return [{"period": period} for period in error_periods(base)]
    return [{}]


def _seconds(t: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means over pieces of a second or so, and their instants: enough for periods of SHORTEST_PERIOD_S and more."""
    starts = np.arange(0, len(t), max(1, int(1.0 / float(np.median(np.diff(t))))))
    count = np.diff(starts, append=len(t))
    return np.add.reduceat(t, starts) / count, np.add.reduceat(y, starts, axis=0)


def _spectrum(t: FloatArray, y: FloatArray, frequency: FloatArray) -> ComplexArray:
    """(f, 3) sum of y (n, 3) exp(-2 pi i f t) at even frequencies and times (n,), of which the last may lie closer."""
    every = (t[-2] - t[0]) / (len(t) - 2)
    turned = np.exp(-2j * np.pi * (frequency[1] - frequency[0]) * every)
    start = np.exp(2j * np.pi * frequency[0] * every)
    return np.asarray(czt(y, len(frequency), turned, start, axis=0))


def error_periods(base: Baseline) -> list[float]:
    """Periods at which the innovations of the PHINS ring most, any phase."""
    t, y = _seconds(base.t, np.nan_to_num(base.residual()[:, 6:9]))
    length = t[-1] - t[0]
    frequency = np.arange(1.0 / (LONGEST_PERIOD * length), 1.0 / SHORTEST_PERIOD_S, 0.25 / length)
    power = (np.abs(_spectrum(t, y, frequency)) ** 2).sum(axis=1)
    out: list[float] = []
    for k in np.argsort(power)[::-1]:
        period = float(1.0 / frequency[k])
        if all(abs(1.0 / period - 1.0 / other) > 0.5 / length for other in out):
            out.append(period)
        if len(out) == PERIODS_TRIED:
            break
    return out
