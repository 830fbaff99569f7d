"""The ship experiment of the IDAM paper on a simulated ship: two units, two PHINS turned by Table 2."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.experiments.bench import RMSE, Bench, changed, rmse_row, run, runs, time_panels
from pipeline.experiments.claims import beats, published_over
from schemas.experiment import Curve, Experiment, Measured, Panel, Part, Printed, Row
from schemas.products import Estimate

METHODS = ("idam", "woam", "svram", "smoother")
PUBLISHED = METHODS[:3]
AGAINST_PHINS = "RMSE against PHINS"
EARTH = 6_371_000.0  # m, for drawing
DURATION = 1200.0  # s


@lru_cache(maxsize=1)
def plain(seed: int) -> Bench:
    """The trial; the parts of one seed share it."""
    return Bench.simulated(changed("idam-ship", run={"duration": DURATION}), seed)


def accuracy(seed: int) -> Measured:
    """Figures 8 to 10: attitude error against PHINS, as published, and against the truth."""
    bench = plain(seed)
    done = runs(bench, METHODS)
    rows = [rmse_row(r, reference="phins", quantity=AGAINST_PHINS) for r in done]
    rows += [rmse_row(r) for r in done]
    explained = done[-1].scores["phins"].reference_noise
    rows.append(Row("", "PHINS", "its own noise, as the scoring finds it", "arcmin", _arcmin(explained)))
    return Measured(tuple(rows), (*time_panels(bench, done, reference="phins"), _track(bench)))


def _arcmin(radians: np.ndarray) -> tuple[float, ...]:
    return tuple(float(v) for v in np.degrees(radians) * 60.0)


def _track(bench: Bench) -> Panel:
    """Figure 8: the ship's track in kilometres east and north of its start."""
    assert bench.trial.gnss is not None
    fix = bench.trial.gnss
    east = (fix.longitude - fix.longitude[0]) * np.cos(fix.latitude[0]) * EARTH / 1e3
    north = (fix.latitude - fix.latitude[0]) * EARTH / 1e3
    return Panel("Track", "east [km]", "north [km]", (Curve("GNSS", east, north),), over_time=False)


def installation(seed: int) -> Measured:
    """Table 2: installation deviations recovered from the trial at rest."""
    alignment = plain(seed).alignment
    units = {"main IMU to PHINS 1": alignment.installation_main, "sub-IMU to PHINS 2": alignment.installation_sub}
    return Measured(tuple(_deviation(name, found) for name, found in units.items() if found is not None))


def _deviation(name: str, found: Estimate) -> Row:
    """Pitch, roll, heading of ``R_imu_phins = Rz(heading) Rx(pitch) Ry(roll)``."""
    heading, pitch, roll = Rotation.from_rotvec(found.value).as_euler("ZXY", degrees=True)
    return Row("", name, "installation deviation", "deg", (float(pitch), float(roll), float(heading)))


VARIED = {
    "half the sea": {"sea": {"pitch_significant": 0.8, "roll_significant": 2.25, "heading_significant": 0.7}},
    "flexure x 2": {"flexure": {"std_arcmin": [6.0, 4.4, 8.0]}},
}


def sensitivity(seed: int) -> Measured:
    """Sea, flexure and noise, none of which is printed."""
    rows = []
    for case, sections in VARIED.items():
        twin = changed("idam-ship", run={"duration": DURATION}, **sections)  # type: ignore[arg-type]
        bench = Bench.simulated(twin, seed)
        rows += [rmse_row(run(bench, name), case) for name in ("idam", "smoother")]
    return Measured(tuple(rows))


EXPERIMENT = Experiment(
    name="idam-ship",
    about="The IDAM ship experiment's layout, simulated: two units, two PHINS with the deviations of Table 2",
    source="B. Zhao, X. Xia, T. Wang, W. Gao, Electronics 2024, 13, 3555, section 6, Figs. 8-10, Table 2",
    twins=("idam-ship",),
    methods=METHODS,
    chosen=(
        "No data of the voyage are published: ship, sea, flexure and PHINS noise are a twin's, so the published errors"
        " are set beside for their size only.",
        "1200 s at 100 Hz instead of hours: 300 s of manoeuvres, 600 s at rest, 300 s under way; errors from the"
        " first sample on.",
        "PHINS: 0.06′ per sample, drift of 0.3 0.3 0.6′ each. What two of them err, with the error of the installation"
        " found at rest, no method can go below against them.",
        "Published figures are named roll, pitch, heading; here x is pitch, y roll, z heading.",
    ),
    parts=(
        Part("Attitude error (Figs. 9, 10)", "Against the two PHINS as published, and against the truth.", accuracy),
        Part("Installation (Table 2)", "Pitch, roll, heading; the twin is turned by the published ones.", installation),
        Part("Sensitivity", "Against the truth.", sensitivity, seeds=1),
    ),
    printed=(
        Printed("", "idam", AGAINST_PHINS, (1.852, 0.797, 9.589), "Fig. 10"),
        Printed("", "woam", AGAINST_PHINS, (1.914, 0.828, 10.735), "Fig. 10"),
        Printed("", "svram", AGAINST_PHINS, (5.098, 5.155, 25.143), "Fig. 10"),
        Printed("", "main IMU to PHINS 1", "installation deviation", (-0.041, 0.430, -0.250), "Table 2"),
        Printed("", "sub-IMU to PHINS 2", "installation deviation", (-0.029, 0.525, 0.330), "Table 2"),
    ),
    checks=(
        beats("`smoother` better than every published method as run here", "", "smoother", PUBLISHED, RMSE),
        published_over(
            "published error of `idam` above that of `smoother` against the same kind of reference",
            ("", "smoother", AGAINST_PHINS), ("", "idam", AGAINST_PHINS), (1.0, 1.0, 1.0),
        ),
    ),
)  # fmt: skip
