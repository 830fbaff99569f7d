"""Trials from the twin, run through the stages in memory, and their errors against the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.products import Alignment, Deformation, FlexureModel
from schemas.trial import ImuSeries, Trial, Truth
from stages import align, estimate, identify
from stages.estimate import tuning
from stages.estimate.solve import Job
from stages.paired import Linearisation, observe, pair
from twin import Twin, load_twin, make_twin, simulate

ARCMIN = np.pi / 10800.0
ROUNDS = 4
# Errors the model holds exactly: biases and white noise, neither scale factors nor non-orthogonality.
WHITE = {"gyro_scale_ppm": [0.0] * 3, "gyro_nonorthogonality_arcsec": [0.0] * 6}
MEMS = {
    "gyro_bias_dph": [200.0, -200.0, 200.0],
    "gyro_arw": 0.3,
    "gyro_scale_ppm": [1000.0, -1000.0, 1000.0],
    "gyro_nonorthogonality_arcsec": [100.0, -100.0, -100.0, 100.0, -100.0, 100.0],
    "accel_bias_ug": [10000.0, -10000.0, 10000.0],
    "accel_vrw_ug": 100.0,
}


@dataclass(frozen=True)
class Run:
    """A trial with its truth and what the stages made of it."""

    trial: Trial
    truth: Truth
    alignment: Alignment
    flexure: FlexureModel
    deformation: Deformation

    @property
    def error(self) -> np.ndarray:
        """(n, 3) arcmin, Log(R_est R_true^T) at every sample of the answer."""
        return errors(self.deformation.stamp, Rotation.from_rotvec(self.deformation.total), self.truth)

    @property
    def rmse(self) -> np.ndarray:
        return np.sqrt(np.mean(self.error**2, axis=0))

    @property
    def predicted(self) -> np.ndarray:
        """(3,) arcmin, root mean square of the estimator's own sigma."""
        return np.sqrt(np.einsum("kii->ki", self.deformation.covariance).mean(axis=0)) / ARCMIN

    def nees(self, instants: int = 3) -> np.ndarray:
        """(instants,) e^T P^-1 e, spread over the record."""
        k = np.linspace(0, len(self.error) - 1, instants + 2).astype(int)[1:-1]
        P = self.deformation.covariance[k] / ARCMIN**2
        return np.einsum("ki,kij,kj->k", self.error[k], np.linalg.inv(P), self.error[k])


def errors(stamp: np.ndarray, total: Rotation, truth: Truth) -> np.ndarray:
    k = np.clip(np.searchsorted(truth.stamp, stamp - 500_000), 0, len(truth.stamp) - 1)
    assert np.abs(truth.stamp[k] - stamp).max() < 1_000_000
    return (total * Rotation.from_rotvec(truth.total[k]).inv()).as_rotvec() / ARCMIN


def twin_of(name: str, duration: float, rate: float = 50.0, imu: dict[str, Any] | None = None, **tables: Any) -> Twin:
    """A built-in twin, shorter, with tables laid over it; imu: errors laid over those of both units."""
    values = load_twin(name).model_dump()
    values["run"] = {**values["run"], "duration": duration, "rate": rate}
    values["channels"] = {**values["channels"], "phins": False, "gnss": False, "temperature": False}
    for table, entries in tables.items():
        values[table] = {**values[table], **entries}
    for unit in ("main", "sub"):
        values["imu"][unit] = {**values["imu"][unit], **(imu or {})}
    return make_twin(values)


def estimated(trial: Trial, truth: Truth, estimator: str = "smoother") -> Run:
    alignment = align.align(trial)
    flexure = identify.get("whittle")().identify(trial, alignment)
    return Run(trial, truth, alignment, flexure, estimate.get(estimator)().estimate(trial, alignment, flexure))


def simulated(twin: Twin, seed: int) -> tuple[Trial, Truth]:
    simulation = simulate(twin, np.random.default_rng(seed))
    return simulation.trial, simulation.truth


def gyros_only(run: Run) -> np.ndarray:
    """(3,) arcmin, RMSE of the same rounds without accelerometers."""
    paired, job = pair(run.trial, run.alignment), Job(run.trial, run.alignment)
    at = Linearisation.at(run.alignment, run.trial.rig.lever_arm)
    noise, flexure = tuning.initial(run.alignment, run.flexure, run.trial.rig), run.flexure
    for _ in range(ROUNDS):
        solution = job.round(observe(paired, at), at, replace(noise, use_velocity=False), flexure)
        at, noise, flexure = job.after(solution, job.fitted(solution))
    obs = solution.obs
    stamp = run.trial.epoch + np.rint(obs.t * 1e9).astype(np.int64)
    error = errors(stamp[obs.good], Rotation.from_quat(solution.total[obs.good]), run.truth)
    return np.sqrt(np.mean(error**2, axis=0))


def cut(series: ImuSeries, keep: np.ndarray) -> ImuSeries:
    return replace(series, stamp=series.stamp[keep], gyro=series.gyro[keep], accel=series.accel[keep])


def slower(series: ImuSeries, factor: int) -> ImuSeries:
    """Means over ``factor`` samples: rotation increments composed, forces in the axes of the middle."""
    ends = np.arange(factor, len(series), factor)
    step = (series.stamp[1] - series.stamp[0]) * 1e-9
    turn, force = Rotation.identity(len(ends)), np.zeros((len(ends), 3))
    for j in range(factor):
        sample = series.gyro[ends - factor + 1 + j] * step
        force += (turn * Rotation.from_rotvec(0.5 * sample)).apply(series.accel[ends - factor + 1 + j])
        turn = turn * Rotation.from_rotvec(sample)
    vector = turn.as_rotvec()
    force = Rotation.from_rotvec(-0.5 * vector).apply(force) / factor
    return replace(series, stamp=series.stamp[ends], gyro=vector / (factor * step), accel=force)


def half_coupled(twin: Twin, seed: int, share: float) -> tuple[Trial, Truth]:
    """The lever arm moves by a share of what flexure would move a rigid one by."""
    from twin.simulation import STREAMS, ideal_samples, make_world

    trial, truth = simulated(twin, seed)
    world = make_world(twin, dict(zip(STREAMS, np.random.default_rng(seed).spawn(len(STREAMS)))))
    part = replace(world, lever=replace(world.lever, table=share * world.lever.table))
    change = ideal_samples(part).sub_accel - ideal_samples(world).sub_accel
    return replace(trial, sub=replace(trial.sub, accel=trial.sub.accel + change)), truth
