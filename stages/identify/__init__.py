"""Identify: the second-order Gauss-Markov model of the flexure.

One file a method. A method is a class with ``name``, ``source``, ``options`` and
``identify(trial, alignment) -> FlexureModel``. To add one: a file here and a line in ``REGISTRY``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from schemas.products import Alignment, FlexureModel
from schemas.trial import Trial
from stages.registry import Registry

REGISTRY = Registry(
    "identifier",
    {
        "whittle": "stages.identify.whittle:Whittle",
        "acf": "stages.identify.acf:Autocorrelation",
        "rvm": "stages.identify.rvm:RelevanceVectorMachine",
        "svr": "stages.identify.svr:SupportVectorRegression",
        "woa": "stages.identify.woa:WhaleOptimisation",
    },
)


class Identifier(Protocol):
    """What every entry of the registry offers."""

    name: ClassVar[str]
    source: ClassVar[str]
    options: ClassVar[Mapping[str, str]]

    def identify(self, trial: Trial, alignment: Alignment) -> FlexureModel:
        """Flexure model of a trial; DataError when it cannot support one."""


def names() -> tuple[str, ...]:
    """Names of the identifiers, the default first."""
    return REGISTRY.names


def get(name: str) -> Any:
    """The class of that name; ValueError when there is none."""
    return REGISTRY.get(name)
