"""Which mean effects a log speaks for: greedy selection by held-out evidence, relinearised after each.

A named effect is taken out of the log (:mod:`twin.compensation`), the baseline is made anew about what is left, and the
effect's columns stay in the regression with a flat prior: its parameters are what was taken out plus what is found now.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from physics.units import ARCMIN
from schemas.products import Alignment
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.diagnose import instability, slow, stiffening
from stages.diagnose.baseline import Baseline, baseline, extended
from stages.diagnose.candidate import FLOOR_NATS
from stages.diagnose.evidence import PROCESS, Gram, combined, gain, held_out_sum, null_evidence, shifted, solve
from stages.diagnose.instability import Path, Wander
from stages.diagnose.nuisances import TOLERANCES, second_order
from stages.diagnose.pick import Pick, at_period, with_period
from stages.diagnose.regressors import Group, Regressors, regressors, view_of
from stages.diagnose.view import arw_of, believed
from stages.diagnose.whitening import Levels
from twin import effects
from twin.compensation import compensate
from twin.config import Twin
from twin.effects import Effect
from twin.effects._change import section
from twin.effects._prediction import LogView

MEAN = tuple(name for name in effects.names() if effects.get(name).predict.__func__ is not Effect.predict.__func__)  # type: ignore[attr-defined]
TOLERATED = ("gyro_bias", "accel_bias", "static_misalignment", *TOLERANCES)
MOST = 4  # effects named in one log
NEGLIGIBLE = 5e-4  # of the first one's evidence: later picks below it are what linearisation leaves
NULL_DRAWS = 100
PARAMETRIC_SHARE = 0.8  # of a wandering bias's evidence: an effect that reaches it explains it with fewer numbers
FLOOR_S = 1800.0  # of record for which the floor holds; longer ones need more
KEPT_SHARE = 0.8  # of the threshold, below which a pick is dropped again beside the others
ROUNDS = 3  # of linearisation about the picks, before anything else is looked for
STRONG = 100.0  # nats of a named effect, beyond which the levels of noise are sought from the start
TURNED = 1.0 * ARCMIN  # rad by which a wandering bias may turn the units further without being taken out anew
SETTLED = 1.0  # standard deviations by which a pick may move without being taken out anew
EVENT_PENALTY = 3.0  # nats more for an event, on top of ln(steps) and half ln(steps) a parameter: its time was searched


@dataclass(frozen=True)
class Selection:
    """base, regressors: about the log with the picks taken out. gram: the same with y as the twin alone leaves it.

    evidence: name to held-out nats, of a pick beside the others, of
    another effect on top of all picks. thresholds: what each had to reach. alone: evidence of each as the only one.
    """

    picks: tuple[Pick, ...]
    base: Baseline
    regressors: Regressors
    gram: Gram
    evidence: Mapping[str, float]
    alone: Mapping[str, float]
    thresholds: Mapping[str, float]
    clean: Trial
    wandering: Wander | None

    @property
    def nuisances(self) -> list[int]:
        """Places of the nuisances but false samples in the Gram."""
        return _nuisances(self.regressors)

    @property
    def values(self) -> FloatArray:
        """(N, m) whitened innovations with the picks taken out of the log."""
        return self.regressors.values

    @property
    def _events(self) -> list[int]:
        """Places of false gyro samples and of steps: what blocks that do not hold them know nothing of."""
        found = self.regressors
        steps = [name for pick in self.picks if pick.group.is_event for name in _kept(found, pick).names]
        impulses = [k for k, name in enumerate(found.nuisances) if name.startswith("impulse")]
        return [*impulses, *found.gram.index(steps)]

    @property
    def steady(self) -> list[int]:
        """Places of nuisances and of all that the picks have, events left out."""
        return [k for k in self.explained if k not in self._events]

    @property
    def without_events(self) -> FloatArray:
        """(N, m) whitened innovations less the events, as fitted beside everything else."""
        G, fitted, events = self.regressors.gram, self.fitted, self._events
        value = dict(zip(fitted, solve(G.total, G.precision, fitted).value))
        taken = combined(self.regressors.columns, events, np.array([value[k] for k in events]))
        return np.asarray(self.values - taken)

    @property
    def fitted(self) -> list[int]:
        """Places of all that the last fit has: nuisances, false samples, picks."""
        return [
            *range(len(self.regressors.nuisances)),
            *self.regressors.gram.index(_named(self.regressors, self.picks)),
        ]

    @property
    def explained(self) -> list[int]:
        """Places of nuisances and of all that the picks have."""
        return _with(self.regressors, self.picks)

    def columns(self, pick: Pick) -> list[int]:
        """Places of a pick's columns in the Gram."""
        return self.gram.index(_kept(self.regressors, pick).names)

    @property
    def taken(self) -> FloatArray:
        """(N, m) whitened: what was taken off the log for the picks."""
        places = [k for pick in self.picks for k in self.columns(pick)]
        values = np.concatenate([pick.taken for pick in self.picks]) if self.picks else np.zeros(0)
        return combined(self.regressors.columns, places, values)


def select(
    trial: Trial, twin: Twin, coarse: Alignment, rng: np.random.Generator,
    library: Collection[str] = (*MEAN, instability.NAME), lagging: bool = False, flexure: FloatArray | None = None,
) -> Selection:  # fmt: skip
    """Name mean effects one after the other until the next one's held-out evidence does not beat its threshold.

    lagging, flexure: see :class:`stages.diagnose.view.Believed`.
    """
    names = [name for name in MEAN if name in library]
    about = partial(_about, trial, twin, coarse, names, lagging, flexure)
    picks: tuple[Pick, ...] = ()
    alone: dict[str, float] = {}
    levels: Levels | None = None
    wandering: Wander | None = None
    thresholds: dict[str, float] = {}
    doubts: dict[str, float] = {}
    for _ in range(MOST + 1):
        base, found, clean, gram, picks, wandering = _converged(about, picks, levels, wandering)
        thresholds = _thresholds(found, gram, picks, rng)
        scored = _scored(found, gram, picks)
        moved = _wander(base, found, picks) if instability.NAME in library and wandering is None else None
        if not alone:
            alone = {name: score for name, (score, _) in scored.items()}
            alone |= {instability.NAME: moved.evidence} if moved else {}
        doubted = _doubted(base, found, gram, picks, scored, thresholds)
        doubts |= doubted
        scored = _beside(found, gram, picks, scored, [n for n, nats in doubted.items() if nats >= thresholds[n]])
        scored = {name: (min(score, doubts.get(name, score)), group) for name, (score, group) in scored.items()}
        best = max(scored, key=lambda name: scored[name][0] - thresholds.get(name, FLOOR_NATS), default=None)
        told = scored[best][0] if best is not None else -np.inf
        if moved is not None and moved.evidence > max(told / PARAMETRIC_SHARE, FLOOR_NATS):
            wandering, told = moved, moved.evidence
        elif best is None or len(picks) == MOST or not _worth(told, thresholds[best], alone, picks):
            break
        else:
            picks = (*picks, _picked(base, found, gram, picks, scored[best][1]))
        # Noise that was found beside a strong effect is that effect's in part.
        levels = None if told > STRONG else base.levels
    chosen = _finished(picks, base, found, clean, alone, thresholds, wandering, doubts)
    while weakest := _unworthy(chosen):
        picks = tuple(pick for pick in chosen.picks if pick.group.effect != weakest)
        wandering = None if weakest == instability.NAME else chosen.wandering
        base, found, clean, _, picks, wandering = _converged(about, picks, chosen.base.levels, wandering)
        chosen = _finished(picks, base, found, clean, alone, thresholds, wandering, doubts)
    return chosen


def _converged(
    about: Callable[..., tuple[Baseline, Regressors, Trial]], picks: tuple[Pick, ...], levels: Levels | None,
    wandering: Wander | None,
) -> tuple[Baseline, Regressors, Trial, Gram, tuple[Pick, ...], Wander | None]:  # fmt: skip
    """Baseline, regressors, clean log, Gram, picks and wandering bias, linearised about them until they stay where they
    are."""
    for _ in range(ROUNDS):
        base, found, clean = about(picks, levels, wandering)
        taken = _fitted(found, picks)
        picks, levels = _refined(found, _frozen(found, taken), picks), base.levels
        path = _wandered(base, found, taken) if wandering else None
        if wandering and path and (wandering.path is None or path.turns_from(wandering.path) > TURNED):
            # Noise found beside the process was its in part, and so its size was found too small.
            wandering, levels = replace(_wander(base, found, picks), path=path), None
        elif _settled(picks):
            break
    return base, found, clean, _frozen(found, taken, picks), picks, wandering


def _wandered(base: Baseline, found: Regressors, value: FloatArray) -> Path:
    """The path of a wandering bias among the nuisances of a fit."""
    return instability.path_of(base, value[_process(found)])


def _process(found: Regressors) -> list[int]:
    """Places of a wandering bias in the Gram."""
    return [k for k, name in enumerate(found.nuisances) if name.startswith(PROCESS)]


def _settled(picks: Sequence[Pick]) -> bool:
    """Whether what was taken out for the picks is what they are found to be; what stays in the log always is."""
    moved = [np.abs(pick.value - pick.taken) / np.sqrt(np.diag(pick.covariance)) for pick in picks if pick.taken.any()]
    return all(float(m.max()) < SETTLED for m in moved)


def _wander(base: Baseline, found: Regressors, picks: Sequence[Pick]) -> Wander:
    """What a wandering bias of the gyros would gain on top of the picks."""
    kept = [k for k in _with(found, picks) if not found.gram.names[k].startswith(PROCESS)]
    kept += [k for k, name in enumerate(found.nuisances) if name.startswith("impulse")]
    width = base.whitened.values.shape[1]
    cosines = _process(found)[:-3]  # its means stand last
    made = instability.Basis.of(base, found.columns[:, :width, cosines]) if cosines else instability.basis(base)
    return instability.wander(base, made, found.columns[:, :width, kept], found.gram.precision[kept])


def _unworthy(chosen: Selection) -> str | None:
    """The pick that, beside the others, falls furthest short of its threshold."""
    named = [pick.group.effect for pick in chosen.picks] + ([instability.NAME] if chosen.wandering else [])
    short = {name: chosen.evidence[name] - KEPT_SHARE * chosen.thresholds.get(name, FLOOR_NATS) for name in named}
    name = min(short, key=lambda key: short[key], default=None)
    return name if name is not None and short[name] < 0.0 else None


def _worth(evidence: float, threshold: float, alone: Mapping[str, float], picks: Sequence[Pick]) -> bool:
    # An event leaves nothing beside its instant.
    first = max((alone[pick.group.effect] for pick in _lasting(picks)), default=0.0)
    return evidence >= max(threshold, NEGLIGIBLE * first)


def _about(
    trial: Trial, twin: Twin, coarse: Alignment, names: Sequence[str], lagging: bool, flexure: FloatArray | None,
    picks: Sequence[Pick], levels: Levels | None, wandering: Wander | None,
) -> tuple[Baseline, Regressors, Trial]:  # fmt: skip
    """Baseline, regressors and log with the picks taken out."""
    named = [pick.effect for pick in picks]
    clean = compensate(trial, named, twin).trial if picks else trial
    clean = wandering.taken_from(clean) if wandering else clean
    arm = reduce(lambda changed, effect: effect.twin(changed), named, twin).mount.lever_arm
    source = believed(clean, section(twin, "mount", lever_arm=arm), lagging, flexure)
    base = baseline(source, coarse, levels)
    if wandering is not None:
        base = instability.with_wander(base, wandering)
    view = view_of(base)
    if (bent := _bent(view, picks)).any():
        base = extended(base, [second_order(base.obs, source.lever_arm, bent + view.theta)])
    return base, regressors(base, view, names, [(pick.group, pick.value) for pick in picks]), clean


def _bent(view: LogView, picks: Sequence[Pick]) -> FloatArray:
    """(n, 3) rad of bending that was taken out for the picks."""
    out = np.zeros_like(view.theta)
    for pick in picks:
        kind = effects.get(pick.group.effect)
        if kind.stays:
            continue
        for column, value in zip(kind.predict(view, **pick.group.shape), pick.value, strict=True):
            if column.signals.bending is not None:
                out += value * np.asarray(column.signals.bending)
    return out


def _fitted(found: Regressors, picks: Sequence[Pick]) -> FloatArray:
    """(K,) of all nuisances and picks, fitted to the whole log; zero for what is neither."""
    chosen = [*range(len(found.nuisances)), *found.gram.index(_named(found, picks))]
    value = np.zeros(len(found.gram.names))
    value[chosen] = solve(found.gram.total, found.gram.precision, chosen).value
    return value


def _frozen(found: Regressors, value: FloatArray, picks: Sequence[Pick] = ()) -> Gram:
    """False gyro samples and the events among the picks subtracted as they were fitted (K,) to the whole log, because
    blocks that do not hold them know nothing of them."""
    impulses = [k for k, name in enumerate(found.nuisances) if name.startswith("impulse")]
    events = [pick for pick in picks if pick.group.is_event]
    places = [*impulses, *found.gram.index(_named(found, events))]
    return shifted(found.gram, places, -value[places])


def _lasting(picks: Sequence[Pick]) -> list[Pick]:
    """Those that are no events."""
    return [pick for pick in picks if not pick.group.is_event]


def _kept(found: Regressors, pick: Pick) -> Group:
    """The group of a pick on this baseline: there it is the only one of its effect."""
    return found.of(pick.group.effect)[0]


def _nuisances(found: Regressors) -> list[int]:
    return [k for k, name in enumerate(found.nuisances) if not name.startswith("impulse")]


def _named(found: Regressors, picks: Sequence[Pick]) -> list[str]:
    """Columns of the picks, then those of their periods and of a deck that is no longer the model's."""
    periods = [pick.group.slope for pick in picks if pick.group.slope in found.gram.names]
    deck = stiffening.LINEAR if any(pick.group.deck for pick in picks) else ()
    return [*(name for pick in picks for name in _kept(found, pick).names), *periods, *deck]


def _with(found: Regressors, picks: Sequence[Pick]) -> list[int]:
    return [*_nuisances(found), *found.gram.index(_named(found, picks))]


def _refined(found: Regressors, gram: Gram, picks: Sequence[Pick]) -> tuple[Pick, ...]:
    """What was taken out plus what is found now."""
    chosen = _with(found, picks)
    fit = solve(gram.total, gram.precision, chosen)
    out, first = [], len(_nuisances(found))
    for pick in picks:
        here = slice(first, first + len(pick.group.names))
        taken = np.zeros_like(pick.value) if effects.get(pick.group.effect).stays else pick.value
        out.append(replace(pick, value=taken + fit.value[here], covariance=fit.covariance[here, here], taken=taken))
        first = here.stop
    for k, pick in enumerate(picks):
        if pick.group.slope in found.gram.names:
            old = pick.group.shape["period"]
            period = old + float(np.clip(fit.value[first], -0.3 * old, 0.3 * old))
            std = float(np.sqrt(fit.covariance[first, first]))
            out[k] = replace(out[k], group=at_period(pick.group, period), shape_std=std)
            first += 1
    return tuple(_with_deck(gram, chosen, pick) for pick in out)


def _with_deck(gram: Gram, beside: Sequence[int], pick: Pick) -> Pick:
    """A pick that is told in units of the deck's stiffness, found together with it."""
    if pick.group.deck is None:
        return pick
    names = {*pick.group.names, *stiffening.NAMES}
    found = stiffening.fit(gram, [k for k in beside if gram.names[k] not in names], pick.group.deck)
    value, covariance = np.array([found.gain]), np.array([[found.variance]])
    return replace(pick, group=replace(pick.group, deck=found.deck), value=value, covariance=covariance)


def _scored(found: Regressors, gram: Gram, picks: Sequence[Pick]) -> dict[str, tuple[float, Group]]:
    """Held-out nats of the best shape of every effect that is not picked yet, on top of the picks."""
    base = _with(found, _lasting(picks))
    out: dict[str, tuple[float, Group]] = {}
    for group in found.groups:
        if any(pick.group.effect == group.effect for pick in picks):
            continue
        score = _score(found, gram, base, group)
        if score > FLOOR_NATS and not _makes_sense(found, gram, base, group):
            score = 0.0
        if group.effect not in out or score > out[group.effect][0]:
            out[group.effect] = (score, group)
    return out


def _doubted(
    base: Baseline, found: Regressors, gram: Gram, picks: Sequence[Pick], scored: Mapping[str, tuple[float, Group]],
    thresholds: Mapping[str, float],
) -> dict[str, float]:  # fmt: skip
    """Nats of slow bending that would be named, against flexure that is free."""
    likely = [name for name in slow.EFFECTS if name in scored and scored[name][0] >= thresholds.get(name, FLOOR_NATS)]
    out = {}
    for name in likely:
        pick = _picked(base, found, gram, picks, scored[name][1])
        numbers = len(pick.value) + len(pick.group.shape)
        out[name] = against_free_flexure(base, picks, _bending(view_of(base), pick), numbers)
    return out


def _beside(
    found: Regressors, gram: Gram, picks: Sequence[Pick], scored: Mapping[str, tuple[float, Group]],
    bending: Sequence[str],
) -> dict[str, tuple[float, Group]]:  # fmt: skip
    """Weaker effects count for what they have beside slow bending: what that has is told against free flexure, and what
    a constant would gain of it is not."""
    base, out = _with(found, _lasting(picks)), dict(scored)
    for name in bending:
        told, group = scored[name]
        kept = [*base, *gram.index(group.names)]
        for rival, (score, other) in scored.items():
            if score < told:
                out[rival] = (min(out[rival][0], _score(found, gram, kept, other)), other)
    return out


def against_free_flexure(base: Baseline, picks: Sequence[Pick], columns: FloatArray, numbers: int) -> float:
    """Nats of slow bending (n, k), whose size about each axis is free, on top of the picks, less the price of so many
    numbers."""
    view = view_of(base)
    seen = slow.angle(base.obs, base.flexure, base.source.twin.flexure, arw_of(base.source) ** 2)
    known = [_bending(view, pick) for pick in picks if pick.group.effect in slow.EFFECTS]
    beside = np.hstack([np.zeros((len(seen.t), 0)), *(slow.at(seen, view.t, column) for column in known)])
    more = np.hstack([beside, slow.at(seen, view.t, columns)])
    return float(slow.fit(seen, more).nats.sum() - slow.fit(seen, beside).nats.sum()) - slow.price(numbers, seen)


def _bending(view: LogView, pick: Pick) -> FloatArray:
    """(n, 1) the bending of an effect that bends all axes alike, per unit about the one it is largest about."""
    signals = effects.get(pick.group.effect).predict(view, **pick.group.shape)[0].signals
    assert signals.bending is not None
    bending = np.asarray(signals.bending)
    return bending[:, [int(np.argmax(np.abs(bending).max(axis=0)))]]


def _makes_sense(found: Regressors, gram: Gram, base: Sequence[int], group: Group) -> bool:
    """Whether a parameter that has one sign only has it."""
    if group.deck is not None:
        return True  # its evidence holds only for what makes sense
    value = solve(gram.total, gram.precision, [*base, *gram.index(group.names)]).value[-len(group.names) :]
    declared = {item.name: item for item in effects.get(group.effect).parameters()}
    return all(declared[name].signed or v > 0.0 for name, v in zip(group.parameters, value) if name in declared)


def _score(found: Regressors, gram: Gram, base: Sequence[int], group: Group) -> float:
    if group.is_event:
        return event_evidence(found, base, group)
    return nats_of(gram, base, group)


def nats_of(gram: Gram, base: Sequence[int], group: Group) -> float:
    """Evidence of a group without a time on top of regressors: held out, or beyond the twin's tolerance."""
    if group.effect in TOLERATED:
        return beyond_tolerance(gram, base, group.names)
    if group.deck is not None:
        return stiffening.evidence(gram, base, group.deck)
    return held_out_sum(gram, base, gram.index(group.names))


def beyond_tolerance(gram: Gram, base: Sequence[int], names: Sequence[str]) -> float:
    """Nats by which an effect that the twin's tolerance covers in part beats that tolerance.

    Its columns are among the nuisances, so that it fits no better than they do: what it saves is their prior's cost.
    """
    return gain(gram, base, gram.index(names)) - len(names)


def event_evidence(found: Regressors, base: Sequence[int], group: Group) -> float:
    """In-sample gain of an event over false gyro samples at the same times, less the price of its parameters."""
    G, precision = found.gram.total, found.gram.precision
    impulses = [k for k, name in enumerate(found.nuisances) if name.startswith("impulse")]
    lesser = solve(G, precision, [*base, *impulses]).gain
    greater = solve(G, precision, [*base, *impulses, *found.gram.index(group.names)]).gain
    steps = float(np.log(max(found.gram.count.sum() / 9.0, 2.0)))
    return greater - lesser - 0.5 * len(group.names) * steps - steps - EVENT_PENALTY


def _thresholds(found: Regressors, gram: Gram, picks: Sequence[Pick], rng: np.random.Generator) -> dict[str, float]:
    """The floor, or more where white noise in this very log reaches more by chance."""
    base = _with(found, _lasting(picks))
    length = float(found.gram.edges[-1] - found.gram.edges[0])
    # What linearisation and the motion's model miss grows with the record, as evidence does.
    floor = FLOOR_NATS * max(1.0, length / FLOOR_S)
    out = {group.effect: floor for group in found.groups}
    groups = [group for group in found.groups if not group.is_event and group.effect not in TOLERATED]
    reached = null_evidence(gram, base, [gram.index(group.names) for group in groups], rng, NULL_DRAWS)
    for group, high in zip(groups, reached):
        out[group.effect] = max(out[group.effect], 1.5 * float(high))
    return out


def _picked(base: Baseline, found: Regressors, gram: Gram, picks: Sequence[Pick], group: Group) -> Pick:
    kept, k = _with(found, _lasting(picks)), len(group.names)
    if group.is_event:
        impulses = [i for i, name in enumerate(found.nuisances) if name.startswith("impulse")]
        fit = solve(found.gram.total, found.gram.precision, [*kept, *impulses, *found.gram.index(group.names)])
    elif "period" in group.shape:
        return with_period(base, found, gram, kept, group)
    else:
        fit = solve(gram.total, gram.precision, [*kept, *gram.index(group.names)])
    return _with_deck(gram, kept, Pick(group, fit.value[-k:], fit.covariance[-k:, -k:], np.zeros(k)))


def _finished(
    picks: tuple[Pick, ...], base: Baseline, found: Regressors, clean: Trial, alone: Mapping[str, float],
    thresholds: Mapping[str, float], wandering: Wander | None, doubts: Mapping[str, float],
) -> Selection:  # fmt: skip
    fitted, lasting = _fitted(found, picks), _lasting(picks)
    gram = _frozen(found, fitted, picks)
    calm = _restored(found, gram, lasting)
    evidence = {}
    for pick in picks:
        if pick.group.is_event:
            evidence[pick.group.effect] = alone[pick.group.effect]
        else:
            others = [other for other in lasting if other is not pick]
            evidence[pick.group.effect] = nats_of(calm, _with(found, others), _kept(found, pick))
    for name, (score, _) in _scored(found, gram, picks).items():
        evidence[name] = min(score, doubts.get(name, score))
    if wandering is not None:
        wandering = replace(_wander(base, found, picks), path=wandering.path)
        evidence[instability.NAME] = wandering.evidence
    restored = _restored(found, _frozen(found, fitted), picks)
    return Selection(picks, base, found, restored, evidence, alone, thresholds, clean, wandering)


def _restored(found: Regressors, gram: Gram, picks: Sequence[Pick]) -> Gram:
    """With y as it was before the picks were taken out of the log."""
    places = found.gram.index([name for pick in picks for name in _kept(found, pick).names])
    return shifted(gram, places, np.concatenate([np.zeros(0), *(pick.taken for pick in picks)]))
