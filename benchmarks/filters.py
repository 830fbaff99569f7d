"""Smoother and filter beside filterpy and beside one pass over the data.

    python -m benchmarks.filters [--duration 7200] [--short 500] [--repeats 3]

The smoother's own model of a simulated trial. filterpy's KalmanFilter runs the same model over the first steps alone,
matrix by matrix, and its RTS smoother over what it found; the ratio is per step. One pass over the data is pairing and
matching the samples, which every estimator needs: what the numbers are read for anyhow.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import KalmanFilter

from physics.kalman import SparseModel, run_filter, run_smoother
from schemas.products import Alignment, FlexureModel
from schemas.trial import Trial
from stages import identify
from stages.align import align
from stages.estimate import tuning
from stages.estimate.solve import Job
from stages.paired import Linearisation, observe, pair
from twin import load_twin, simulate, with_run

OUT = np.arange(8)


def seconds(job: Callable[[], object]) -> float:
    start = time.process_time()
    job()
    return time.process_time() - start


def model_of(trial: Trial, alignment: Alignment, flexure: FlexureModel) -> SparseModel:
    """The first piece of the model as the smoother builds it."""
    at = Linearisation.at(alignment, trial.rig.lever_arm)
    noise = tuning.initial(alignment, tuning.separable(flexure), trial.rig)
    return Job(trial, alignment).model(observe(pair(trial, alignment), at), at, noise)[0]()


def dense(model: SparseModel, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, Q, H of a step."""
    n, m = len(model.x0), model.z.shape[1]
    F, Q, H = np.eye(n), np.zeros((n, n)), np.zeros((m, n))
    np.add.at(F, (model.transition_row, model.transition_col), model.transition[k])
    np.add.at(Q, (model.noise_row, model.noise_col), model.noise[k])
    Q = Q + Q.T - np.diag(np.diag(Q))
    for i in range(m):
        np.add.at(H[i], model.measurement_col[i], model.measurement[k, i])
    return F, Q, H


class Filterpy:
    """filterpy over the first steps; the matrices are made beforehand and do not count."""

    def __init__(self, model: SparseModel, steps: int) -> None:
        self.model = model
        self.matrices = [dense(model, k) for k in range(steps)]
        self.x, self.P = np.zeros((steps, len(model.x0))), np.zeros((steps, *model.P0.shape))

    def filter(self) -> None:
        model = self.model
        kalman = KalmanFilter(dim_x=len(model.x0), dim_z=model.z.shape[1])
        kalman.x, kalman.P = model.x0.copy(), model.P0.copy()
        for k, (F, Q, H) in enumerate(self.matrices):
            kalman.predict(F=F, Q=Q)
            seen = np.isfinite(model.z[k])
            if seen.any():
                kalman.update(model.z[k, seen], R=np.diag(model.variance[k, seen]), H=H[seen])
            self.x[k], self.P[k] = kalman.x, kalman.P

    def smooth(self) -> None:
        F, Q, _ = zip(*self.matrices, strict=True)
        KalmanFilter(dim_x=len(self.model.x0), dim_z=1).rts_smoother(self.x, self.P, list(F), list(Q))


def spread(values: list[float]) -> str:
    return f"{statistics.median(values):.3g} [{min(values):.3g}, {max(values):.3g}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=7200.0, help="seconds of trial")
    parser.add_argument("--short", type=int, default=500, help="steps that filterpy runs over")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    trial = simulate(with_run(load_twin("idam-ship"), duration=options.duration), np.random.default_rng(1)).trial
    alignment = align(trial)
    flexure = identify.get("whittle")().identify(trial, alignment)
    model = model_of(trial, alignment, flexure)
    steps, short = len(model.z), min(options.short, len(model.z))
    run_smoother(model, run_filter(model, OUT), 5)  # compiled, or read from the cache
    reference = Filterpy(model, short)
    found: dict[str, list[float]] = {name: [] for name in ("filter", "smoother", "by filterpy", "its RTS", "pass")}
    for _ in range(options.repeats):
        found["pass"].append(seconds(lambda: observe(pair(trial, alignment), Linearisation.at(alignment, None))))
        filtered = run_filter(model, OUT)
        found["filter"].append(seconds(lambda: run_filter(model, OUT)) / steps)
        found["smoother"].append(seconds(lambda: run_smoother(model, filtered, 5)) / steps)  # noqa: B023
        found["by filterpy"].append(seconds(reference.filter) / short)
        found["its RTS"].append(seconds(reference.smooth) / short)
    print(f"{len(trial.main)} samples of each unit, {steps} steps of {len(model.x0)} states")
    rows = {"filter": ("filter", "by filterpy"), "backward pass of the smoother": ("smoother", "its RTS")}
    for name, (own, other) in rows.items():
        ratios = [b / a for a, b in zip(found[own], found[other], strict=True)]
        per_step = 1e6 * statistics.median(found[own])
        print(f"{name:<32}{per_step:8.2f} us a step   times as fast as filterpy: {spread(ratios)}")
    both = [(a + b) * steps / c for a, b, c in zip(found["filter"], found["smoother"], found["pass"], strict=True)]
    print(f"{'one pass over the data':<32}{statistics.median(found['pass']):8.2f} s")
    print(f"filter and smoother over one pass over the data: {spread(both)}")


if __name__ == "__main__":
    main()
