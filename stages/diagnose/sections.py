"""A record of any length: one that is too long to be held whole is diagnosed in sections, one after the other.

Every section stands for itself, as a log of its own would: what has been found in one is not known in the next, so that
memory is that of one section whatever the record. The answer is that of the section which departs most from the twin;
what each of the others says stands beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import fields, replace
from functools import partial

import numpy as np

from schemas import scratch
from schemas.diagnosis import Diagnosis, Section, Verdict
from schemas.errors import DataError
from schemas.trial import Trial
from stages.diagnose import diagnosis
from stages.diagnose.shrinkage import between
from twin.config import Twin

LONGEST_S = 9000.0  # of a section, of which a diagnosis holds 3 GB


def diagnose(
    trial: Trial,
    twin: Twin,
    *,
    rng: np.random.Generator | None = None,
    shrink: bool = True,
    library: Collection[str] | None = None,
    progress: Callable[[str], None] | None = None,
    longest: float = LONGEST_S,
) -> Diagnosis:
    """Where a log departs from its twin, which effects cause it, how far the gap shrinks.

    shrink: run the estimator on log, twin and compensated log for the RMSE rows. library: names of the effects that may
    be named, all by default. longest: s of a section. Raises DataError where no section can be compared with the twin.
    """
    rng = np.random.default_rng(0) if rng is None else rng
    cuts = sections(trial, longest)
    if len(cuts) == 1:
        return diagnosis.diagnose(trial, twin, rng, shrink, library, progress)
    told: list[Section] = []
    best: tuple[Diagnosis, Section] | None = None
    for k, (cut, own) in enumerate(zip(cuts, rng.spawn(len(cuts)))):
        say = partial(_say, progress, f"section {k + 1} of {len(cuts)}")
        try:
            found = diagnosis.diagnose(between(trial, *cut), twin, own, shrink, library, say)
        except DataError as error:
            told.append(Section(*cut, None, problem=error.problem))
        else:
            told.append(Section(*cut, found.verdict, tuple((f.name, f.evidence_nats) for f in found.effects)))
            if best is None or _departure(found) > _departure(best[0]):
                best = found, told[-1]
        _let_go(trial)
    if best is None:
        raise DataError(f"no section of the record can be diagnosed; the first one: {told[0].problem}")
    return _of_all(*best, told, trial.duration)


def _say(progress: Callable[[str], None] | None, section: str, step: str) -> None:
    if progress is not None:
        progress(f"{section}: {step}")


def sections(trial: Trial, longest: float = LONGEST_S) -> list[tuple[float, float]]:
    """Begin and end, s since the epoch, of as few equal parts of a record as are no longer than asked."""
    first, last = (float(stamp - trial.epoch) * 1e-9 for stamp in trial.main.stamp[[0, -1]])
    count = max(1, int(np.ceil((last - first) / longest)))
    edges = np.linspace(first, last, count + 1)
    edges[-1] += 1.0  # the last sample is part of it
    return list(zip(edges[:-1].tolist(), edges[1:].tolist()))


def _departure(found: Diagnosis) -> tuple[bool, float]:
    return found.verdict is not Verdict.NO_GAP, found.gap.before


def _of_all(found: Diagnosis, shown: Section, told: list[Section], duration: float) -> Diagnosis:
    """The answer of one section, for the record."""
    window = shown.begin_s, shown.end_s
    where = tuple(replace(place, window_s=place.window_s or window) for place in found.where)
    note = (
        f"the record is longer than a diagnosis holds: {len(told)} sections were diagnosed one by one, and what is "
        f"shown is of the one that departs most from the twin, from {shown.begin_s:.0f} to {shown.end_s:.0f} s"
    )
    return replace(found, where=where, duration_s=duration, sections=tuple(told), notes=(note, *found.notes))


def _let_go(trial: Trial) -> None:
    """Give back the memory of a record whose samples lie in files."""
    for series in (getattr(trial, field.name) for field in fields(trial)):
        if hasattr(series, "stamp"):
            scratch.release(*(getattr(series, field.name) for field in fields(series)))
