"""Estimate: the deformation at every sample of the main IMU, with covariance.

One file a method. A method is a class with ``name``, ``source``, ``options`` and
``estimate(trial, alignment, flexure) -> Deformation``. To add one: a file here and a line in ``REGISTRY``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol

from schemas.products import Alignment, Deformation, FlexureModel
from schemas.trial import Trial
from stages.registry import Registry

REGISTRY = Registry(
    "estimator",
    {
        "smoother": "stages.estimate.smoother:Smoother",
        "filter": "stages.estimate.smoother:CausalFilter",
        "td-ma": "stages.estimate.td_ma:TdMa",
        "td-noma": "stages.estimate.td_ma:TdNoMa",
        "notd-ma": "stages.estimate.td_ma:NoTdMa",
        "notd-noma": "stages.estimate.td_ma:NoTdNoMa",
        "idam": "stages.estimate.idam:Idam",
        "svram": "stages.estimate.idam:Svram",
        "woam": "stages.estimate.idam:Woam",
        "model-free": "stages.estimate.model_free:ModelFree",
        "traditional": "stages.estimate.model_free:Traditional",
    },
)


class Estimator(Protocol):
    """What every entry of the registry offers."""

    name: ClassVar[str]
    source: ClassVar[str]
    options: ClassVar[Mapping[str, str]]

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Deformation of a trial; DataError when it cannot support one."""


def names() -> tuple[str, ...]:
    """Names of the estimators, the default first."""
    return REGISTRY.names


def get(name: str) -> Any:
    """The class of that name; ValueError when there is none."""
    return REGISTRY.get(name)
