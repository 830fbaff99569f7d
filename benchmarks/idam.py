"""The compiled 24-state filter beside the same filter with filterpy's classes: ``python -m benchmarks.idam``.

CPU seconds of the process. The compiled filter runs over the whole record and over the short stretch that filterpy
can finish; the ratio is taken on that stretch, in turns, so that a busy machine touches both alike.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stages.estimate.idam import Idam
from stages.estimate.rodrigues.filtering import Setup, Tuning, run
from stages.estimate.rodrigues.inputs import Matching
from tests.oracles.rodrigues_filterpy import FilterpyRodrigues
from tests.stages.estimate.rodrigues_case import Case, case

VARIANTS = {
    "plain update (svram, woam)": Idam(mpf=False, mce=False).tuning,
    "correntropy": Idam(mpf=False).tuning,
    "model prediction and correntropy (idam)": Idam().tuning,
}
PER_SAMPLE = ("dt", "jump", "q_m", "q_s", "omega", "omega_dot", "force", "W_s", "z", "sums", "good", "t", "stamp")


def resized(data: Matching, steps: int) -> Matching:
    """The first steps of the data, repeated where there are not enough: time taken does not depend on the values."""
    rows = np.arange(steps) % len(data.t)
    rows[rows == 0] = 1  # no step of length zero in between
    rows[0] = 0
    return replace(data, **{name: getattr(data, name)[rows] for name in PER_SAMPLE})


def seconds(job: Callable[[], object]) -> float:
    start = time.process_time()
    job()
    return time.process_time() - start


def by_filterpy(data: Matching, of: Case, given: Setup, tuned: Tuning) -> None:
    plain = FilterpyRodrigues(data, of.flexure.damping, of.flexure.stiffness, given, tuned)
    for k in range(1, len(data.t)):
        plain.step(k)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=720_000, help="samples of the long run (2 h at 100 Hz)")
    parser.add_argument("--short", type=int, default=2000, help="samples that filterpy runs over")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    of = case(120.0, 1)
    short = resized(of.data, options.short)
    long = resized(of.data, options.steps)
    for name, tuned in VARIANTS.items():
        given = of.setup(tuned)
        run(short, of.flexure, given, tuned)  # compiled, or read from the cache
        ratios = []
        for _ in range(options.repeats):
            slow = seconds(lambda: by_filterpy(short, of, given, tuned))  # noqa: B023
            fast = seconds(lambda: [run(short, of.flexure, given, tuned) for _ in range(5)]) / 5  # noqa: B023
            ratios.append(slow / fast)
        whole = seconds(lambda: run(long, of.flexure, given, tuned))  # noqa: B023
        spread = f"{statistics.median(ratios):.0f} [{min(ratios):.0f}, {max(ratios):.0f}]"
        print(f"{name:<42}{options.steps} steps: {whole:6.1f} s    times as fast as filterpy: {spread}")


if __name__ == "__main__":
    main()
