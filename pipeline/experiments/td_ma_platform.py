"""The turntable experiment of the TD-MA paper, simulated: no lever arm, 15 ms and 15 samples of delay."""

from __future__ import annotations

from typing import Any

from pipeline.experiments.bench import RMSE, Bench, changed, rmse_row, runs, time_panels
from pipeline.experiments.claims import at_most, beats
from pipeline.experiments.td_ma import DELAY, found_rows
from schemas.experiment import Experiment, Measured, Panel, Part, Printed, Row

PUBLISHED = ("td-ma", "td-noma", "notd-ma", "notd-noma")
METHODS = (*PUBLISHED, "smoother")
CASES = {"15 ms": 0.015, "15 samples, 75 ms": 0.075}
DURATION = 300.0  # s


def accuracy(seed: int) -> Measured:
    """Figures 13 to 18, the delay read both ways."""
    rows: list[Row] = []
    panels: tuple[Panel, ...] = ()
    for case, delay in CASES.items():
        sections: dict[str, Any] = {
            "run": {"duration": DURATION},
            "mount": {"lever_arm": [0.0, 0.0, 0.0], "time_delay": delay},
        }
        bench = Bench.simulated(changed("td-ma", **sections), seed)
        done = runs(bench, METHODS)
        rows += [*(rmse_row(r, case) for r in done), *found_rows(done, case)]
        panels += tuple(_titled(panel, case) for panel in time_panels(bench, done))
    return Measured(tuple(rows), panels)


def _titled(panel: Panel, case: str) -> Panel:
    return Panel(f"{panel.title}, {case}", panel.x_label, panel.y_label, panel.curves)


EXPERIMENT = Experiment(
    name="td-ma-platform",
    about="The TD-MA turntable experiment, simulated: 15 ms and 15 samples of delay with 6°, 3°, 2° of misalignment",
    source="D. Xu, Y. Yu, X. Zhang, X. Peng, J. Syst. Eng. Electron. 2023, section 4.2, Figs. 13-18",
    twins=("td-ma",),
    methods=METHODS,
    chosen=(
        "The text says 15 ms, the simulation before it 15 samples: both are run.",
        f"{DURATION:.0f} s at 200 Hz of the simulation's motion without a lever arm; errors from the first sample on.",
        "The paper adds the deformation to the output of one unit; here two units have errors of their own.",
        "No figure of accuracy is printed.",
    ),
    parts=(Part("Accuracy (Figs. 13-18)", "", accuracy),),
    printed=(Printed("15 ms", "td-ma", DELAY, (15.0,), "set on the platform"),
             Printed("15 samples, 75 ms", "td-ma", DELAY, (75.0,), "set on the platform")),
    checks=(
        at_most("`td-ma` below 1′ with 15 ms", "15 ms", "td-ma", RMSE, (1.0, 1.0, 1.0)),
        at_most("`td-ma` below 1′ with 15 samples", "15 samples, 75 ms", "td-ma", RMSE, (1.0, 1.0, 1.0)),
        *(
            beats(f"`smoother` better than every published method, {case}", case, "smoother", PUBLISHED, RMSE)
            for case in CASES
        ),
    ),
)  # fmt: skip
