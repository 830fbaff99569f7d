"""Voyages of one ship held against its twin: verdicts in the catalogue, and what the voyages say together."""

import json
from pathlib import Path

import numpy as np

from pipeline.archive.config import Config, Text
from pipeline.archive.jobs import Job, State
from pipeline.archive.manifest import open_archive
from pipeline.archive.sources import found_in
from pipeline.archive.stores import open_store
from pipeline.archive.working import process
from pipeline.provenance import deckflex_version
from schemas.wire import write_log
from stages.publish.simulation import simulation_tables
from tests.pipeline.archive import voyages
from twin import parse_twin, simulate

DELAY = 0.004  # s, that the twin does not know of
SHIP = {"static": [12.0, -20.0, 30.0], "pitch": 1.5, "roll": 4.0, "flexure": 2.0}


def written(folder: Path, name: str, duration: float, seed: int) -> Path:
    twin = parse_twin(voyages.TWIN.format(**SHIP).replace("duration = 40.0", f"duration = {duration}"))
    tables = {table.topic: table for table in simulation_tables(simulate(twin, np.random.default_rng(seed)))}
    later = voyages.dated(tables, seed * 30 * voyages.DAY_NS)
    write_log(folder / f"{name}.mcap", list(later.values()))
    return folder / f"{name}.mcap"


def test_a_delay_of_every_voyage_is_found_in_each_and_combined(tmp_path, deckflex):
    believed = voyages.TWIN.format(**SHIP).replace(f"time_delay = {DELAY}", "time_delay = 0.0")
    config = Config(deckflex_version(), "td-ma", "acf", twin=Text("ship.toml", believed), outputs=())
    logs = [written(tmp_path, "a", 60.0, 3), written(tmp_path, "b", 60.0, 4), written(tmp_path, "short", 40.0, 5)]
    out = tmp_path / "out"
    open_archive(open_store(str(out)), writing=True)
    outcomes = [process(Job(found_in([str(log)], str(out)).sources[0], config.document(), str(out))) for log in logs]
    assert [one.state for one in outcomes] == [State.DONE] * 3
    assert outcomes[0].figures.endswith("time_delay")
    assert [one.reason for one in outcomes] == ["", "", "the log holds 40.0 s; a diagnosis needs 60 s"]
    query = "select name, diagnosis, effects from catalogue where axis = 'x' order by name"
    rows = json.loads(deckflex("catalogue", out, "--sql", query, "--json").out)["rows"]
    assert [row["diagnosis"] for row in rows] == ["explained", "explained", outcomes[2].reason]
    told = json.loads(deckflex("catalogue", out, "--json").out)["installations"][0]
    (found,) = told["effects"]
    assert (found["effect"], found["standing"], found["named_in"]) == ("time_delay", "repeats", 2)
    combined = found["parameters"]["delay"]
    assert abs(combined["value"] - DELAY) < 3.5 * combined["std"]
    assert 0.0 < combined["std"] < 1e-4
    alone = [json.loads(path.read_bytes()) for path in sorted(out.glob("results/*/*.diagnosis.json"))]
    each = [one["effects"][0]["parameters"]["delay"]["std"] for one in alone]
    assert combined["std"] >= float(np.sum(np.power(each, -2.0))) ** -0.5 * (1 - 1e-9)
    assert found["evidence_nats"] == sum(one["effects"][0]["evidence_nats"] for one in alone)
