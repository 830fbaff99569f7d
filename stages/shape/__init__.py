"""Deck shape: curvature and torsion along a path from a sliding SINS, one file a method.

A method is a class with ``name``, ``source``, ``options`` (name -> meaning; the keyword arguments of its constructor)
and ``shape(trial, deformation) -> DeckShape``. To add one: a file here and a line in ``REGISTRY``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from schemas.products import DeckShape, Deformation
from schemas.trial import Trial
from stages.registry import Registry

REGISTRY = Registry(
    "deck-shape method",
    {
        "spline": "stages.shape.spline:SplineShape",
        "wavelet-kalman": "stages.shape.wavelet_kalman:WaveletKalmanShape",
    },
)
DEFAULT = "spline"


class ShapeMethod(Protocol):
    """What every entry of the registry offers."""

    name: ClassVar[str]
    source: ClassVar[str]
    options: ClassVar[Mapping[str, str]]

    def shape(self, trial: Trial, deformation: Deformation | None = None) -> DeckShape:
        """Deck shape of a trial; DataError when the trial holds none."""


def names() -> tuple[str, ...]:
    """Names of the methods, the default first."""
    return REGISTRY.names


def get(name: str) -> Any:
    """The class of that name; ValueError, with the names there are, when there is none."""
    return REGISTRY.get(name)
