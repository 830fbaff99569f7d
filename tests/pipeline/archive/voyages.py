"""An archive of short simulated voyages: ten months, the static angle drifting, and six kinds of damage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from schemas.wire import Table, read_log, write_log
from stages.publish.simulation import simulation_tables
from tests.faults.corpus import Fault
from twin import parse_twin, simulate

DRIFT = (6.0, -9.0, 12.0)  # arcmin a month
START = (12.0, -20.0, 30.0)  # arcmin
MONTHS, A_MONTH = 10, 4
DAY_NS = 86_400_000_000_000
MONTH_NS = round(365.2425 / 12 * DAY_NS)
CHEAP = ("--estimator", "td-ma", "--identifier", "acf")
DAMAGES = (
    Fault.EMPTY_FILE,
    Fault.NOT_MCAP,
    Fault.TRUNCATED_IN_HEADER,
    Fault.NO_SUB,
    Fault.DEGREES,
    Fault.ALL_NAN,
)
TWIN = """
name = "voyage"
[run]
duration = 40.0
rate = 20.0
seed = 5
[ship]
latitude = 43.0
heading = 30.0
speed = 15.0
[sea]
model = "spectrum"
pitch_significant = {pitch}
roll_significant = {roll}
heading_significant = 2.0
heave_significant = 0.6
[mount]
static_arcmin = {static}
lever_arm = [3.0, 25.0, 4.0]
time_delay = 0.004
[flexure]
damping = [0.2, 0.15, 0.15]
frequency = [0.6, 0.45, 0.4]
std_arcmin = [{flexure}, {flexure}, {flexure}]
"""


def simulated(month: int, seed: int) -> dict[str, Table]:
    """A voyage of one month as tables; the rougher the sea, the more the deck bends."""
    rough = 1.0 + 0.5 * (seed % 4)
    static = [round(a + b * month, 3) for a, b in zip(START, DRIFT)]
    text = TWIN.format(static=static, pitch=1.5 * rough, roll=4.0 * rough, flexure=2.0 * rough)
    simulation = simulate(parse_twin(text), np.random.default_rng(seed))
    return {table.topic: table for table in simulation_tables(simulation)}


def dated(tables: dict[str, Table], later_ns: int) -> dict[str, Table]:
    """The same log at another date."""
    return {topic: _later(table, later_ns) for topic, table in tables.items()}


def _later(table: Table, by: int) -> Table:
    columns = {**table.columns, "header.stamp": table.columns["header.stamp"] + by}
    return replace(table, columns=columns, log_time=table.log_time + by, publish_time=table.publish_time + by)


def make_voyages(folder: Path, months: int = MONTHS, a_month: int = A_MONTH) -> None:
    """Logs in a folder for each month; the first of each has PHINS too."""
    for month in range(months):
        (folder / f"month-{month:02d}").mkdir(parents=True)
        for k in range(a_month):
            tables = dated(simulated(month, 10 * month + k), month * MONTH_NS + k * DAY_NS)
            kept = [table for topic, table in tables.items() if k == 0 or not topic.startswith("/phins")]
            write_log(folder / f"month-{month:02d}" / f"voyage {month:02d}-{k}.mcap", kept)


def damage(folder: Path) -> dict[str, Fault]:
    """Spoilt copies of voyages in a folder of their own; name to what was done."""
    bad = folder / "bad"
    bad.mkdir()
    sources = sorted(folder.glob("month-*/*-0.mcap"))
    made = {}
    for fault, source in zip(DAMAGES, sources, strict=False):
        target = bad / f"{fault.name.lower()}.mcap"
        fault.value[0].write(source.read_bytes(), read_log(source).tables, target)
        made[f"bad/{target.name}"] = fault
    return made


def drift_of(rows: dict[str, dict[str, float]], axis: str) -> tuple[float, float]:
    """Slope and its standard deviation, arcmin a month, of the JSON of a catalogue."""
    return rows[axis]["arcmin_per_month"], rows[axis]["arcmin_per_month_std"]


def digest(folder: Path) -> dict[str, tuple[int, int]]:
    """Every file below a folder with its time of change and size."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {str(path.relative_to(folder)): (path.stat().st_mtime_ns, path.stat().st_size) for path in files}
