"""How large the gap is and how far the named effects close it, in held-out nats, with an interval over blocks."""

from __future__ import annotations

import numpy as np

from schemas.diagnosis import Comparison, Finding, Gap
from schemas.rig import FloatArray
from stages.diagnose.evidence import Table, held_out, held_out_sum
from stages.diagnose.selection import TOLERATED, Selection

DRAWS = 400
INTERVAL = (2.5, 97.5)


def gap_of(chosen: Selection, named: tuple[Finding, ...], left: float, rng: np.random.Generator) -> Gap:
    """left: nats that the ceiling gains on top of everything named."""
    names = {finding.name for finding in named}
    blocks = _mean_part(chosen, names)
    other = sum(f.evidence_nats for f in named) - sum(
        f.evidence_nats for f in named if f.name in {pick.group.effect for pick in chosen.picks}
    )
    return _gap(blocks, other, left, chosen, rng)


def _mean_part(chosen: Selection, names: set[str]) -> FloatArray:
    """(b,) nats per block that the named mean effects gain together."""
    more = [k for pick in chosen.picks if pick.group.effect in names for k in chosen.columns(pick)]
    base = [k for k in chosen.explained if k not in more]
    if not more:
        return np.zeros(len(chosen.gram.blocks))
    named = [pick.group for pick in chosen.picks if pick.group.effect in names]
    # An event sits in one block, of which no other one knows; what a tolerance covers in part is told by its prior.
    if any(group.is_event or group.effect in TOLERATED or group.deck is not None for group in named):
        total = sum(chosen.evidence[name] for name in names if name in chosen.evidence)
        return np.full(len(chosen.gram.blocks), total / len(chosen.gram.blocks))
    return held_out(chosen.gram, base, more)


def _gap(blocks: FloatArray, other: float, left: float, chosen: Selection, rng: np.random.Generator) -> Gap:
    samples = float(chosen.gram.count.sum())
    gained = float(blocks.sum()) + other
    total = gained + left
    if total <= 0.0 or gained <= 0.0:
        return Gap(max(left, 0.0) / samples, max(left, 0.0) / samples, 0.0, (0.0, 0.0))
    draws = blocks[rng.integers(0, len(blocks), (DRAWS, len(blocks)))].sum(axis=1)
    draws = draws + other + np.sqrt(2.0 * max(other, 0.0)) * rng.standard_normal(DRAWS)
    # What is left is a log-likelihood ratio of its own: it scatters by the root of twice its size, and by a few nats.
    over = np.maximum(left + np.sqrt(2.0 * left + 10.0) * rng.standard_normal(DRAWS), 0.0)
    closed = np.clip(draws / np.maximum(draws + over, 1e-9), 0.0, 1.0)
    low, high = np.percentile(closed, INTERVAL)
    return Gap(total / samples, left / samples, gained / total, (float(low), float(high)))


def comparisons(
    chosen: Selection, named: tuple[Finding, ...], left: float, rng: np.random.Generator
) -> tuple[Comparison, ...]:
    """The same for the best effect that was not named, in the named ones' place, and for a placebo."""
    picks = [pick for pick in chosen.picks if pick.group.effect in {finding.name for finding in named}]
    if not picks or picks[0].group.is_event:
        return ()
    more = [k for pick in picks for k in chosen.columns(pick)]
    base = [k for k in chosen.explained if k not in more]
    total = held_out_sum(chosen.gram, base, more) + left
    taken = {pick.group.effect for pick in chosen.picks}
    rivals = [g for g in chosen.regressors.groups if g.effect not in taken and not g.is_event]
    scored = [(held_out_sum(chosen.gram, base, chosen.gram.index(g.names)), g) for g in rivals]
    out = []
    if scored:
        best = max(scored, key=lambda item: item[0])[1]
        blocks = held_out(chosen.gram, base, chosen.gram.index(best.names))
        gained = max(float(blocks.sum()), 0.0)
        out.append(Comparison("runner-up", best.effect, _gap(blocks, 0.0, max(total - gained, 0.0), chosen, rng)))
    blocks = _placebo(chosen, base, more)
    gained = max(float(blocks.sum()), 0.0)
    name = f"{picks[0].group.effect} of another hour"
    out.append(Comparison("placebo", name, _gap(blocks, 0.0, max(total - gained, 0.0), chosen, rng)))
    return tuple(out)


def _placebo(chosen: Selection, base: list[int], more: list[int]) -> FloatArray:
    """The regressors of the answer half a record out of step."""
    columns, names = chosen.regressors.columns, [chosen.gram.names[k] for k in base]
    moved = np.roll(columns[:, :, more], len(columns) // 2, axis=0)
    precision, t = chosen.gram.precision[base], chosen.base.t
    table = Table.of(names, columns, restored_values(chosen), t, precision, chosen=base)
    own = table.widened([f"placebo {k}" for k in more], moved, np.zeros(len(more)))
    return held_out(own, range(len(base)), range(len(base), len(base) + len(more)))


def restored_values(chosen: Selection) -> FloatArray:
    """(N, m) whitened innovations as the twin alone leaves the log."""
    return np.asarray(chosen.values + chosen.taken)
