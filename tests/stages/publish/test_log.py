"""Estimates appended to a copy of the log, alone, and as Parquet."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from mcap.reader import make_reader

from physics.units import ARCMIN
from schemas.wire import Table, read_log, write_log
from stages.publish.log import publish_log, write_parquet
from tests.stages import synthetic_result as synthetic


@pytest.fixture(scope="module")
def case():
    return synthetic.case(duration=30.0, gap=None)


@pytest.fixture
def source(tmp_path):
    stamp = synthetic.stamps(5.0, 10.0)
    columns = {"header.stamp": stamp, "header.frame_id": np.full(50, "imu_main", dtype=object)}
    columns |= {"temperature": np.linspace(20.0, 21.0, 50), "variance": np.zeros(50)}
    table = Table("/temp", "sensor_msgs/msg/Temperature", columns, stamp, stamp, np.zeros(50, np.uint32))
    path = tmp_path / "in.mcap"
    write_log(path, [table])
    return path


def test_originals_and_estimates_stand_side_by_side(case, source, tmp_path):
    before = hashlib.sha256(source.read_bytes()).hexdigest()
    target = tmp_path / "out.mcap"
    publish_log(case.result, case.trial, source, target)
    with target.open("rb") as file:
        counts: dict[str, int] = {}
        for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    assert counts["/temp"] == 50
    assert counts["/deckflex/deformation"] == len(case.result.deformation.stamp)
    assert hashlib.sha256(source.read_bytes()).hexdigest() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.mcap", "out.mcap"]


def test_only_estimates_leaves_the_originals_out(case, source, tmp_path):
    target = tmp_path / "out.mcap"
    publish_log(case.result, case.trial, source, target, only_estimates=True)
    assert all(topic.startswith("/deckflex/") for topic in read_log(target).tables)


@pytest.mark.parametrize("only_estimates", [True, False])
def test_provenance_is_in_the_metadata(case, source, tmp_path, only_estimates):
    target = tmp_path / "out.mcap"
    publish_log(case.result, case.trial, source, target, only_estimates)
    assert dict(read_log(target).metadata["deckflex"]) == dict(case.result.provenance)


def test_parquet_holds_deformation_and_deck_shape(case, tmp_path):
    first, second = write_parquet(case.result, tmp_path / "tables", "trial")
    frame = pl.read_parquet(first)
    np.testing.assert_allclose(frame["total_z_arcmin"], case.result.deformation.total[:, 2] / ARCMIN)
    assert frame["time"].dtype == pl.Datetime("ns")
    deck = pl.read_parquet(second)
    np.testing.assert_allclose(deck["torsion_rad_per_m"], case.result.deck_shape.curvature[:, 1])


def test_no_deck_no_second_table(case, tmp_path):
    assert len(write_parquet(replace(case.result, deck_shape=None), tmp_path, "trial")) == 1
