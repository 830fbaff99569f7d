"""A log from a twin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.files import staged, writing
from pipeline.one_log import Progress, Steps
from pipeline.provenance import deckflex_version
from schemas.errors import DataError

RECORD = "deckflex_simulation"  # name of the metadata record that holds the twin


def simulate_log(
    twin: str, target: Path, *, seed: int | None = None, duration: float | None = None, progress: Progress | None = None
) -> dict[str, Any]:
    """Write the log of a twin (a TOML file or a built-in name) and say what was made.

    seed and duration (s) stand in for the twin's own. The same twin, seed and version give the same bytes.
    """
    import numpy as np

    from schemas.wire import write_log
    from stages.publish.simulation import simulation_tables
    from twin import dump_twin, load_twin, make_twin, simulate

    steps = Steps(progress)
    loaded = load_twin(twin)
    changes = {"seed": seed, "duration": duration}
    table = loaded.model_dump(exclude_none=True)
    table["run"] |= {key: value for key, value in changes.items() if value is not None}
    settled = make_twin(table, file=twin)
    with steps.step("simulate"):
        simulation = simulate(settled, np.random.default_rng(settled.run.seed))
    with steps.step("write"), staged([target]) as (path,), writing(target, path):
        tables = simulation_tables(simulation)
        write_log(path, tables, metadata={RECORD: {"deckflex": deckflex_version(), "twin": dump_twin(settled)}})
    return {
        "log": str(target),
        "twin": settled.name,
        "seed": settled.run.seed,
        "duration_s": settled.run.duration,
        "messages": sum(len(table) for table in tables),
        "wall_s": sum(steps.seconds.values()),
    }


def default_target(twin: str) -> Path:
    """``<twin>.mcap`` here; an existing file is never replaced unless it was named. Raises DataError."""
    target = Path(Path(twin).stem + ".mcap")
    if target.exists():
        raise DataError("exists already; name the log to write with -o", file=target)
    return target
