"""What the page and the recording of an archive show: figures against date, flexure against the sea, tables, words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from schemas.rig import FloatArray
from schemas.trial import IntArray

AGAINST_THE_SEA = "Flexure against the sea"
"""Title of the table that stands beside the charts of flexure against the sea."""


@dataclass(frozen=True)
class Fit:
    """A fitted line with its standard deviation, to be drawn beside points: x, value, std (j,). name: what it is."""

    x: FloatArray
    value: FloatArray
    std: FloatArray
    name: str = "fitted"


@dataclass(frozen=True)
class Trend:
    """One figure against date. stamp: (k,) ns UTC. values, std: (k, m), std None where there is none. names: m.

    fits: the lines through them, their x in ns UTC. tab: the part of the recording that it belongs to.
    """

    title: str
    label: str
    stamp: IntArray
    values: FloatArray
    std: FloatArray | None
    names: Sequence[str]
    fits: Sequence[Fit] = ()
    tab: str = "Trends"


@dataclass(frozen=True)
class Relation:
    """One figure against another. x, y, std: (k,). fit: the line through them."""

    title: str
    x_label: str
    y_label: str
    x: FloatArray
    y: FloatArray
    std: FloatArray
    fit: Fit | None = None


@dataclass(frozen=True)
class Listing:
    """A table under a heading; where a reader shows only so many rows the rest is counted."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[object]]


@dataclass(frozen=True)
class ArchiveReport:
    """grade: good, care or bad. headline, sentences: the answer in words. warnings: what to distrust."""

    title: str
    about: str
    grade: str
    headline: str
    sentences: Sequence[str] = ()
    trends: Sequence[Trend] = ()
    listings: Sequence[Listing] = ()
    warnings: Sequence[str] = ()
    provenance: Mapping[str, str] = field(default_factory=dict)
    relations: Sequence[Relation] = ()
