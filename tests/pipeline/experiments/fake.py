"""An experiment whose figures are known beforehand."""

import numpy as np

from pipeline.experiments.claims import at_most, beats
from schemas.experiment import Curve, Experiment, Measured, Panel, Part, Printed, Row


def measured(seed: int) -> Measured:
    rows = (
        Row("", "published", "RMSE", "arcmin", (1.0 * seed, 2.0 * seed, 3.0 * seed)),
        Row("", "smoother", "RMSE", "arcmin", (0.5, 0.5, 0.5)),
        Row("other", "published", "lasts", "s", (10.0 + seed,), "breaks down"),
    )
    x = np.linspace(0.0, 10.0, 50)
    panels = (
        Panel("Error x [arcmin]", "time [s]", "error [arcmin]", (Curve("published", x, np.sin(x) + seed),)),
        Panel("Sweep", "delay", "RMSE", (Curve("a, 5°", x, x), Curve("truth", x, 2 * x)), over_time=False),
    )
    return Measured(rows, panels)


def grid(seed: int) -> Measured:
    return Measured(
        tuple(
            Row(f"{row}° / {column}", "published", "RMSE", "arcmin", (row + column + seed, 1.0, 2.0))
            for row in (0, 1)
            for column in (0, 6)
            if (row, column) != (1, 6)
        )
    )


EXPERIMENT = Experiment(
    name="fake",
    about="A fake",
    source="Nobody, section 0",
    twins=("idam",),
    methods=("published", "smoother"),
    chosen=("Everything is made up.",),
    parts=(Part("Main", "What it is.", measured), Part("Grid", "", grid, seeds=2, grid=True)),
    printed=(Printed("", "published", "RMSE", (4.0, float("nan"), 6.0), "Fig. 1"),),
    limits=(Printed("", "smoother", "RMSE", (0.25, 0.25, 0.25), "a covariance"),),
    checks=(
        at_most("published below 7", "", "published", "RMSE", (7.0, 7.0, 7.0)),
        at_most("published below 1", "", "published", "RMSE", (1.0, 1.0, 1.0)),
        beats("ours better", "", "smoother", ("published",), "RMSE"),
    ),
    seeds=3,
)
