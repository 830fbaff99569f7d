"""A short trial of the IDAM twin, ready for the 24-state filter."""

from dataclasses import dataclass

import numpy as np

from physics.units import ARCMIN
from schemas.products import Alignment, FlexureModel
from stages.align import align
from stages.estimate.rodrigues.filtering import Setup, Tuning, setup
from stages.estimate.rodrigues.inputs import Matching, matching
from twin import Simulation, load_twin, simulate, with_run


@dataclass(frozen=True)
class Case:
    simulation: Simulation
    alignment: Alignment
    flexure: FlexureModel
    data: Matching

    def setup(self, tuned: Tuning) -> Setup:
        return setup(self.data, self.alignment, self.flexure, self.simulation.trial.rig, tuned)


def case(duration: float, seed: int) -> Case:
    twin = with_run(load_twin("idam"), duration=duration)
    simulation = simulate(twin, np.random.default_rng(seed))
    alignment = align(simulation.trial)
    damping = np.array(twin.flexure.damping)
    std = np.array(twin.flexure.std_arcmin) * ARCMIN
    flexure = FlexureModel("known", damping, damping**2, std, np.zeros((3, 3, 3)), np.zeros(3))
    return Case(simulation, alignment, flexure, matching(simulation.trial, alignment))


def with_outliers(z: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Measurements of which a share is off by 0.05 m/s and 1e-3 rad/s."""
    size = np.repeat([0.05, 1e-3], 3)
    return z + (rng.random(z.shape) < share) * rng.choice([-1.0, 1.0], z.shape) * size
