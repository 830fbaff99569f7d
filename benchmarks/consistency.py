"""Is the smoother's sigma honest? Monte Carlo on twins: error against sigma, per case.

    python -m benchmarks.consistency [CASE ...] [--seeds 10]

The error of a run is one slowly varying vector, so a run counts once: error and sigma are taken at mid-record. NEES/3
is the mean of e^T P^-1 e / 3; with n runs it lies within the printed interval in 95 of 100 trials if sigma is right.
Lag is the correlation of neighbouring innovations, mean of absolute values over runs, of attitudes and velocities.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from schemas.trial import Trial
from tests.stages.estimate.runs import ARCMIN, Run, cut, estimated, simulated, slower, twin_of
from twin import make_twin

Units = dict[str, dict[str, Any]]
Change = Callable[[Trial], Trial]


def scale_errors(scale_ppm: float, skew_arcsec: float) -> Callable[[np.random.Generator], Units]:
    """Both gyros with scale factors and axes out of square drawn anew for each run."""
    return lambda rng: {
        unit: {
            "gyro_scale_ppm": (scale_ppm * rng.standard_normal(3)).tolist(),
            "gyro_nonorthogonality_arcsec": (skew_arcsec * rng.standard_normal(6)).tolist(),
        }
        for unit in ("main", "sub")
    }


PERFECT = scale_errors(0.0, 0.0)
# What the smoother takes for usual between two fibre gyros: 10 ppm of scale, 30 ppm (6 arcsec) out of square.
USUAL = scale_errors(7.1, 4.4)


def mems(rng: np.random.Generator) -> Units:
    """Two MEMS units, every bias at its limit, signs drawn: 200 deg/h, 10 mg, 0.3 deg/sqrt(h)."""
    units = scale_errors(1000.0, 100.0)(rng)
    for unit in units.values():
        unit["gyro_bias_dph"] = (200.0 * np.sign(rng.standard_normal(3))).tolist()
        unit["accel_bias_ug"] = (1e4 * np.sign(rng.standard_normal(3))).tolist()
        unit |= {"gyro_arw": 0.3, "accel_vrw_ug": 100.0}
    return units


def beside_fibre(rng: np.random.Generator) -> Units:
    """A fibre gyro as main unit, a MEMS as the other."""
    return {"main": {}, "sub": mems(rng)["sub"]}


def beside_mems(rng: np.random.Generator) -> Units:
    """The other way about."""
    return {"main": mems(rng)["main"], "sub": {}}


def gap(trial: Trial) -> Trial:
    """The sub-IMU is silent for 30 s."""
    t = trial.seconds(trial.sub.stamp)
    return replace(trial, sub=cut(trial.sub, (t < 200.0) | (t > 230.0)))


def late(trial: Trial) -> Trial:
    """The sub-IMU starts 120 s after the main one."""
    return replace(trial, sub=cut(trial.sub, trial.seconds(trial.sub.stamp) > 120.0))


def slow_main(trial: Trial) -> Trial:
    """The main unit at a tenth of the rate."""
    return replace(trial, main=slower(trial.main, 10))


def no_force(trial: Trial) -> Trial:
    """Accelerometers too noisy to be of use."""
    rng = np.random.default_rng(trial.main.stamp[0] % 2**32)
    noisy = lambda unit: replace(unit, accel=unit.accel + rng.normal(0.0, 3.0, unit.accel.shape))  # noqa: E731
    return replace(trial, main=noisy(trial.main), sub=noisy(trial.sub))


def sea(scale: float) -> dict[str, Any]:
    """A swell of pitch, roll and heading, 5, 3 and 2 degrees at scale one."""
    return {
        axis: [[scale * degrees, period, phase]]
        for axis, degrees, period, phase in (
            ("pitch", 3.0, 7.0, 0.4), ("roll", 5.0, 8.0, 1.7), ("heading", 2.0, 9.0, 4.1),
        )
    }  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A twin, its length (s) and rate (Hz), errors of its units, what is done to the trial, and another sea."""

    twin: str
    duration: float
    rate: float
    units: Callable[[np.random.Generator], Units] = PERFECT
    change: Change = lambda trial: trial
    sea: dict[str, Any] = field(default_factory=dict)

    def run(self, seed: int) -> Run:
        """One trial through the stages."""
        values = twin_of(self.twin, self.duration, self.rate).model_dump()
        values["sea"] |= self.sea
        for unit, errors in self.units(np.random.default_rng(9000 + seed)).items():
            values["imu"][unit] |= errors
        trial, truth = simulated(make_twin(values), seed)
        return estimated(self.change(trial), truth)


CASES = {
    "idam 600 s": Case("idam", 600.0, 25.0),
    "idam 600 s, usual errors": Case("idam", 600.0, 25.0, USUAL),
    "idam 600 s, 20 ppm, 10 arcsec": Case("idam", 600.0, 25.0, scale_errors(20.0, 10.0)),
    "idam 600 s, 50 ppm, 20 arcsec": Case("idam", 600.0, 25.0, scale_errors(50.0, 20.0)),
    "idam 3600 s": Case("idam", 3600.0, 20.0),
    "idam 3600 s, 20 ppm, 10 arcsec": Case("idam", 3600.0, 20.0, scale_errors(20.0, 10.0)),
    "td-ma 3600 s": Case("td-ma", 3600.0, 20.0),
    "td-ma 3600 s, usual errors": Case("td-ma", 3600.0, 20.0, USUAL),
    "model-free 7200 s": Case("model-free", 7200.0, 10.0),
    "model-free 7200 s, usual errors": Case("model-free", 7200.0, 10.0, USUAL),
    "MEMS pair 60 s": Case("idam", 60.0, 50.0, mems),
    "MEMS pair 100 s": Case("idam", 100.0, 50.0, mems),
    "MEMS pair 600 s": Case("idam", 600.0, 50.0, mems),
    "MEMS pair 100 s, sea of half a degree": Case("idam", 100.0, 50.0, mems, sea=sea(0.1)),
    "MEMS pair 100 s, sea of a sixth of a degree": Case("idam", 100.0, 50.0, mems, sea=sea(0.03)),
    "MEMS and fibre 100 s": Case("idam", 100.0, 50.0, beside_mems, sea=sea(1.0)),
    "fibre and MEMS 600 s": Case("idam", 600.0, 50.0, beside_fibre),
    "idam 600 s, gyros only": Case("idam", 600.0, 25.0, change=no_force),
    "idam 600 s, gap of 30 s": Case("idam", 600.0, 25.0, change=gap),
    "idam 600 s, sub late": Case("idam", 600.0, 25.0, change=late),
    "idam 600 s, main 10 Hz": Case("idam", 600.0, 100.0, change=slow_main),
}


@dataclass(frozen=True)
class Found:
    """Of one run, arcmin; z: error over sigma at mid-record."""

    rmse: np.ndarray
    sigma: np.ndarray
    z: np.ndarray
    nees: float
    lag: np.ndarray


def found(run: Run) -> Found:
    """What counts of one run."""
    middle = len(run.error) // 2
    error, P = run.error[middle], run.deformation.covariance[middle] / ARCMIN**2
    assert run.deformation.innovations is not None
    values = run.deformation.innovations.values[25:]
    with np.errstate(invalid="ignore"):
        lag = np.abs(np.nanmean(values[1:] * values[:-1], axis=0) / np.nanmean(values**2, axis=0))
    nees = float(error @ np.linalg.solve(P, error)) / 3.0
    return Found(run.rmse, run.predicted, error / np.sqrt(np.diag(P)), nees, lag)


def row(name: str, runs: list[Found]) -> str:
    """A line of the table."""
    n, z = len(runs), np.abs([run.z for run in runs])
    low, high = chi2.ppf([0.025, 0.975], 3 * n) / (3 * n)
    text = lambda values: " ".join(f"{value:.3f}" for value in values)  # noqa: E731
    within = " ".join(f"{100.0 * np.mean(z < limit):.0f}" for limit in (1.0, 2.0, 3.0))
    lag = np.mean([run.lag for run in runs], axis=0)
    sigma = np.sqrt(np.mean([run.sigma**2 for run in runs], axis=0))
    return (
        f"| {name} | {n} | {text(np.mean([run.rmse for run in runs], axis=0))} | {text(sigma)} "
        f"| {np.mean([run.nees for run in runs]):.2f} | {low:.2f}–{high:.2f} | {within} "
        f"| {np.max(lag[:3]):.2f} {np.max(lag[3:]):.2f} |"
    )


HEAD = (
    "| case | n | mean RMSE | sigma | NEES / 3 | 95 % | within 1, 2, 3 sigma, % | lag |\n"
    "|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    """Measure the named cases, or all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    print(HEAD, flush=True)
    for name in options.cases or CASES:
        runs = [found(CASES[name].run(seed)) for seed in range(options.seeds)]
        print(row(name, runs), flush=True)


if __name__ == "__main__":
    main()
