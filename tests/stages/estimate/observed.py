"""What observe() should find in a synthetic world, by quadrature of its closed forms."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.products import Alignment, Estimate
from schemas.trial import Trial
from stages.paired import Linearisation, Observations, Paired, observe, pair
from tests.stages.estimate.synthetic import World

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def paired_of(world: World, trial: Trial | None = None, despike: bool = True) -> Paired:
    """Both units of the world's trial, or of another one of the same mounting."""
    rotation = Rotation.from_rotvec(world.static)
    static = Estimate(world.static, np.full(3, 1e-3))
    delay = Estimate(np.asarray(world.delay), np.asarray(1e-4))
    alignment = Alignment(rotation.as_matrix(), static, 1e-6 * np.eye(3), delay)
    return pair(world.trial() if trial is None else trial, alignment, despike)


def true_linearisation(world: World, start: float, **changed) -> Linearisation:
    """Linearised about the truth at s ``start``, or about something else where ``changed`` says so."""
    values = {
        "R_0": world.total(np.array([start]))[0].as_matrix(),
        "R_ref": Rotation.from_rotvec(world.static).as_matrix(),
        "delay": world.delay,
        "drift": world.drift,
        "lever_arm": world.lever,
        "coupling": world.coupled,
        "gyro_bias": np.zeros(3),
        "scale": np.zeros((3, 3)),
    }
    return Linearisation(**{**values, **changed})


def observed(world: World, **changed) -> tuple[Observations, Linearisation]:
    """Observations of a perfect trial about the truth; the start of the overlap follows from the world."""
    paired = paired_of(world)
    start = observe(paired, true_linearisation(world, 0.0)).t[0]
    at = true_linearisation(world, start, **changed)
    return observe(paired, at), at


def expected_z(world: World, obs: Observations) -> np.ndarray:
    """Log(Exp(theta)), (N, 3)."""
    return world.theta(obs.t[obs.index])


def step_mean(function, obs: Observations) -> np.ndarray:
    """(N - 1, ...) means over the steps."""
    t = obs.t[obs.index]
    nodes = 0.5 * (t[:-1, None] + t[1:, None]) + 0.5 * np.diff(t)[:, None] * NODES
    values = function(nodes.ravel())
    return 0.5 * np.einsum("j,kj...->k...", WEIGHTS, values.reshape(len(nodes), len(NODES), *values.shape[1:]))


def expected_u(world: World, obs: Observations) -> np.ndarray:
    """Mean of A_m^T (v - v_0) - omega x r over the steps, (N - 1, 3)."""
    start = world.velocity(obs.t[:1])
    mean = step_mean(lambda t: world.main(t).inv().apply(world.velocity(t) - start), obs)
    return mean - np.cross(step_mean(world.rate_m, obs), world.lever)
