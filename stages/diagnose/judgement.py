"""From evidence to a verdict: what may be named, what is left, where it sits, and how sure the two halves are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.diagnosis import Finding, Verdict
from stages.diagnose.evidence import solve
from stages.diagnose.pick import Pick
from stages.diagnose.selection import Selection

LEFT_NATS = 25.0  # of a family or a spectrum without a name, below which nothing is said to be left
ENOUGH = 0.97  # share of the evidence that the named must have where something is left
HALVES = 6.0  # chi-square per degree of freedom up to which the halves of a log agree


@dataclass(frozen=True)
class Abstention:
    """verdict, and whether the effects found may be named. reason: why not, empty where they may."""

    verdict: Verdict
    named: bool
    reason: str = ""


def judged(evidence: float, left: float, agree: float, any_found: bool) -> Abstention:
    """evidence: nats of all that was found; left: nats of what no effect explains; agree: chi-square of the halves."""
    remains = left >= LEFT_NATS
    if not any_found:
        return Abstention(Verdict.UNKNOWN_EFFECT if remains else Verdict.NO_GAP, False)
    if not remains:
        return Abstention(Verdict.EXPLAINED, True)
    share = evidence / (evidence + left)
    if share >= ENOUGH and agree < HALVES:
        return Abstention(Verdict.PARTLY_EXPLAINED, True)
    why = (
        f"the named effects would explain {share:.0%} of what departs from the twin and {left:.0f} nats would be left"
        if share < ENOUGH
        else "the halves of the log contradict each other about their parameters"
    )
    return Abstention(Verdict.UNKNOWN_EFFECT, False, why)


def named_of(
    judged_: Abstention, found: tuple[Finding, ...], certain: tuple[Finding, ...]
) -> tuple[Verdict, tuple[Finding, ...]]:
    """Verdict and names: all that was found or, where that may not be, what stamps and values show on their own."""
    if judged_.named:
        return judged_.verdict, found
    return (Verdict.PARTLY_EXPLAINED, certain) if certain else (judged_.verdict, ())


def halves_agree(chosen: Selection) -> float:
    """Chi-square per degree of freedom between the parameters of the first and the second half of the log, at worst."""
    worst = 0.0
    for pick in chosen.picks:
        if not pick.group.is_event:
            worst = max(worst, _between_halves(chosen, pick))
    return worst


def _between_halves(chosen: Selection, pick: Pick) -> float:
    gram, kept = chosen.gram, chosen.explained
    here = [kept.index(k) for k in chosen.columns(pick)]
    middle = len(gram.blocks) // 2
    fits = [solve(part.sum(axis=0), gram.precision, kept) for part in (gram.blocks[:middle], gram.blocks[middle:])]
    difference = fits[0].value[here] - fits[1].value[here]
    spread = fits[0].covariance[np.ix_(here, here)] + fits[1].covariance[np.ix_(here, here)]
    # Linearisation and the motion's model leave a few per cent of any parameter.
    spread = spread + np.diag((0.03 * pick.value) ** 2)
    size = np.sqrt(np.diag(spread))
    scaled = difference / size
    return float(scaled @ np.linalg.solve(spread / np.outer(size, size), scaled)) / len(here)
