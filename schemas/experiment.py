"""What a published experiment, run again, is made of: figures printed, figures measured, curves to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from schemas.rig import FloatArray

Values = tuple[float, ...]
"""One figure, or one per axis x (pitch), y (roll), z (heading); NaN where there is none."""


@dataclass(frozen=True)
class Row:
    """One figure measured on one seed. case: what was varied. note: what else must be said (a failure, a place)."""

    case: str
    method: str
    quantity: str
    unit: str
    value: Values
    note: str = ""


@dataclass(frozen=True)
class Printed:
    """A figure to set beside a measured one. where: figure, table or computation it comes from.

    unit is that of the measured row of the same case, method and quantity.
    """

    case: str
    method: str
    quantity: str
    value: Values
    where: str


@dataclass(frozen=True)
class Curve:
    """Points x, y (n,)."""

    name: str
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True)
class Panel:
    """Curves on one sheet; over_time: x is seconds since the start of the trial. where: figure it stands for."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    over_time: bool = True


@dataclass(frozen=True)
class Measured:
    """What one part of an experiment gave on one seed."""

    rows: tuple[Row, ...]
    panels: tuple[Panel, ...] = ()


@dataclass(frozen=True)
class Part:
    """A table of an experiment. run: seed to what was measured, pure. seeds: at most so many of those asked for.

    grid: the case is "row / column", and the page shows one sheet per axis.
    """

    title: str
    text: str
    run: Callable[[int], Measured]
    seeds: int | None = None
    grid: bool = False


@dataclass(frozen=True)
class Figure:
    """Rows of one part, case, method and quantity over n seeds: mean and standard deviation, with what was printed.

    spread: NaN for one seed. limit: what the best possible estimator could do.
    """

    part: str
    case: str
    method: str
    quantity: str
    unit: str
    mean: Values
    spread: Values
    n: int
    note: str = ""
    printed: Printed | None = None
    limit: Printed | None = None


Figures = Mapping[tuple[str, str, str], Figure]
"""By case, method and quantity."""


@dataclass(frozen=True)
class Check:
    """Something that the measured figures must show. verdict: whether they do, and the figures that say so."""

    claim: str
    verdict: Callable[[Figures], tuple[bool, str]]


@dataclass(frozen=True)
class Experiment:
    """A published experiment. chosen: what the paper does not print and how it was settled, a sentence each.

    printed, limits: figures to set beside the measured ones. twins, methods: names in their registries.
    """

    name: str
    about: str
    source: str
    twins: tuple[str, ...]
    methods: tuple[str, ...]
    chosen: tuple[str, ...]
    parts: tuple[Part, ...]
    printed: tuple[Printed, ...] = ()
    limits: tuple[Printed, ...] = ()
    checks: tuple[Check, ...] = ()
    seeds: int = 5
