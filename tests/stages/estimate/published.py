"""Runs of the twins of the published experiments, short enough for a test, and what they should give."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.products import Alignment, Deformation, Estimate, FlexureModel
from schemas.trial import ImuSeries, Trial, Truth
from twin import Simulation, load_twin, simulate, with_run

ARCMIN = np.pi / 10800.0


@cache
def simulation(name: str, duration: float, rate: float, seed: int) -> Simulation:
    twin = with_run(load_twin(name), duration=duration, rate=rate, seed=seed)
    return simulate(twin, np.random.default_rng(seed))


def true_flexure(run: Simulation) -> FlexureModel:
    """The twin's own parameters, so that no identifier takes part in the test."""
    flexure = run.twin.flexure
    damping, frequency = np.array(flexure.damping), np.array(flexure.frequency)
    std = np.array(flexure.std_arcmin) * ARCMIN
    return FlexureModel("truth", damping, damping**2 + frequency**2, std, np.zeros((3, 3, 3)), np.full(3, 4e-7))


def rough_alignment(run: Simulation, error_arcmin: float = 0.0) -> Alignment:
    """The mounting as designed, off by an error about every axis, and the delay."""
    phi = (np.array(run.twin.mount.static_arcmin) + error_arcmin) * ARCMIN
    delay = Estimate(np.array(run.twin.mount.time_delay), np.array(1e-3))
    return Alignment(Rotation.from_rotvec(phi).as_matrix(), Estimate(phi, np.full(3, ARCMIN)), np.eye(3), delay)


def no_alignment() -> Alignment:
    """Nothing at all: for methods that find everything themselves."""
    zero = Estimate(np.array(0.0), np.array(1.0))
    return Alignment(np.eye(3), Estimate(np.zeros(3), np.ones(3)), np.eye(3), zero)


def error(deformation: Deformation, truth: Truth) -> np.ndarray:
    """(n, 3) arcmin, Log(R_est R_true^T)."""
    rows = np.searchsorted(truth.stamp, deformation.stamp)
    assert np.array_equal(truth.stamp[rows], deformation.stamp)
    wrong = Rotation.from_rotvec(deformation.total) * Rotation.from_rotvec(truth.total[rows]).inv()
    return wrong.as_rotvec() / ARCMIN


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(values**2, axis=0))


def seconds(trial: Trial, deformation: Deformation) -> np.ndarray:
    return trial.seconds(deformation.stamp)


def without(trial: Trial, unit: str, begin: float, end: float) -> Trial:
    """The trial with a gap in one unit."""
    series: ImuSeries = getattr(trial, unit)
    t = trial.seconds(series.stamp)
    keep = (t < begin) | (t > end)
    cut = replace(series, stamp=series.stamp[keep], gyro=series.gyro[keep], accel=series.accel[keep])
    return replace(trial, **{unit: cut})


def until(trial: Trial, end: float) -> Trial:
    return without(without(trial, "main", end, np.inf), "sub", end, np.inf)
