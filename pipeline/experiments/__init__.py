"""Published experiments, run again over seeds with published figures beside measured ones.

One file an experiment. An experiment is a :class:`schemas.experiment.Experiment` of pure functions of a seed; nothing
here prints or writes. To add one: a file here with an ``EXPERIMENT`` and a line in ``REGISTRY``.
"""

from __future__ import annotations

from schemas.experiment import Experiment
from stages.registry import Registry

REGISTRY = Registry(
    "experiment",
    {
        "idam-simulation": "pipeline.experiments.idam_simulation:EXPERIMENT",
        "idam-ship": "pipeline.experiments.idam_ship:EXPERIMENT",
        "td-ma": "pipeline.experiments.td_ma:EXPERIMENT",
        "td-ma-sweep": "pipeline.experiments.td_ma_sweep:EXPERIMENT",
        "td-ma-platform": "pipeline.experiments.td_ma_platform:EXPERIMENT",
        "model-free": "pipeline.experiments.model_free:EXPERIMENT",
        "sliding": "pipeline.experiments.sliding:EXPERIMENT",
    },
)


def names() -> tuple[str, ...]:
    """Names of the experiments."""
    return REGISTRY.names


def get(name: str) -> Experiment:
    """The experiment of that name; ValueError, with the names there are, when there is none."""
    experiment: Experiment = REGISTRY.get(name)
    return experiment
