"""What a published experiment gave when it was run again: measured rows, and their means beside what was printed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from schemas.experiment import Experiment, Figure, Figures, Panel, Part, Printed, Row, Values


@dataclass(frozen=True)
class Sample:
    """One measured row with the part of the experiment and the seed it comes from."""

    part: str
    seed: int
    row: Row


@dataclass(frozen=True)
class Outcome:
    """What an experiment gave. panels: of the first seed. versions: of everything whose version moves a figure."""

    experiment: Experiment
    samples: tuple[Sample, ...]
    panels: tuple[Panel, ...]
    versions: Mapping[str, str]

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Means and spreads in the order the rows were measured."""
        groups: dict[tuple[str, str, str, str], list[Row]] = {}
        for sample in self.samples:
            row = sample.row
            groups.setdefault((sample.part, row.case, row.method, row.quantity), []).append(row)
        return tuple(_figure(self.experiment, part, rows) for (part, *_), rows in groups.items())

    def of_part(self, part: Part) -> tuple[Figure, ...]:
        """The figures of one part."""
        return tuple(figure for figure in self.figures if figure.part == part.title)

    @property
    def seeds(self) -> tuple[int, ...]:
        """All seeds that were run."""
        return tuple(sorted({sample.seed for sample in self.samples}))

    def verdicts(self) -> tuple[tuple[str, bool, str], ...]:
        """Each claim of the experiment, whether the figures show it, and which."""
        known = named(self.figures)
        return tuple((check.claim, *check.verdict(known)) for check in self.experiment.checks)


def named(figures: Iterable[Figure]) -> Figures:
    """Figures by case, method and quantity; where two parts share a name, the first one's."""
    found: dict[tuple[str, str, str], Figure] = {}
    for figure in figures:
        found.setdefault((figure.case, figure.method, figure.quantity), figure)
    return found


def _figure(experiment: Experiment, part: str, rows: Sequence[Row]) -> Figure:
    first = rows[0]
    values = np.array([row.value for row in rows], dtype=float)
    spread = values.std(axis=0, ddof=1) if len(rows) > 1 else np.full(values.shape[1], np.nan)
    beside = [_beside(printed, first) for printed in (experiment.printed, experiment.limits)]
    return Figure(
        part, first.case, first.method, first.quantity, first.unit, _values(values.mean(axis=0)), _values(spread),
        len(rows), first.note, *beside,
    )  # fmt: skip


def _values(array: np.ndarray) -> Values:
    return tuple(float(value) for value in array)


def _beside(printed: Iterable[Printed], row: Row) -> Printed | None:
    key = (row.case, row.method, row.quantity)
    return next((p for p in printed if (p.case, p.method, p.quantity) == key), None)
