"""The main job through the command line, on a real log."""

import hashlib
import json

import numpy as np
import polars as pl
import pytest
from mcap.reader import make_reader

from schemas import scratch
from schemas.wire import read_log, scan_log
from stages import slabs, unfit

CONTRACT = {
    "log", "estimator", "identifier", "duration_s", "samples", "static_arcmin", "time_delay_s", "flexure",
    "rmse_arcmin", "deck_shape", "warnings", "wall_s",
}  # fmt: skip
WRITTEN_BACK = {
    "/deckflex/deformation": "deckflex_msgs/msg/Deformation",
    "/deckflex/attitude": "geometry_msgs/msg/QuaternionStamped",
    "/deckflex/alignment": "deckflex_msgs/msg/Alignment",
    "/deckflex/flexure_model": "deckflex_msgs/msg/FlexureModel",
    "/deckflex/deck_shape": "deckflex_msgs/msg/DeckShape",
    "/deckflex/score": "deckflex_msgs/msg/Score",
}


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def finished(sample, tmp_path_factory):
    """One run with everything written: folder, document, hash of the input before."""
    from tests.pipeline.running import run_command

    folder = tmp_path_factory.mktemp("run")
    before = digest(sample)
    told = run_command(
        "run", sample, "-o", folder / "out.mcap", "--rrd", folder / "out.rrd", "--parquet", folder, "--json"
    )
    assert told.status == 0, told.err
    return folder, told, before


def test_json_is_one_document_with_the_contracts_keys_and_nothing_else_is_printed(finished):
    _, told, _ = finished
    document = json.loads(told.out)
    assert document.keys() >= CONTRACT
    assert document["flexure"].keys() >= {"damping", "frequency", "std_arcmin"}
    assert all(len(document["rmse_arcmin"][name]) == 3 for name in ("truth", "phins"))
    assert document["deck_shape"] is not None
    assert told.err == ""


def test_a_long_log_worked_on_piece_by_piece_gives_the_same_bytes(finished, sample, tmp_path, deckflex, monkeypatch):
    monkeypatch.setattr(scratch, "LARGE", 1 << 14)
    monkeypatch.setattr(slabs, "SLAB", 1000)
    monkeypatch.setattr(slabs, "LONG", 1)
    monkeypatch.setattr(unfit, "PIECE", 10 * unfit.SPIKE_WINDOW)
    told = deckflex("run", sample, "-o", tmp_path / "out.mcap")
    assert told.status == 0, told.err
    assert digest(tmp_path / "out.mcap") == digest(finished[0] / "out.mcap")


def test_the_answer_is_close_to_the_truth(finished):
    document = json.loads(finished[1].out)
    assert np.all(np.array(document["rmse_arcmin"]["truth"]) < [1.0, 1.0, 2.0])


def test_the_input_is_untouched_and_nothing_but_the_outputs_is_left(finished, sample):
    folder, told, before = finished
    assert digest(sample) == before
    assert sorted(path.name for path in sample.parent.iterdir()) == [sample.name]
    named = set(json.loads(told.out)["written"].values())
    assert {str(path) for path in folder.iterdir()} == named


def test_the_log_written_holds_the_original_channels_and_the_new_ones(finished, sample):
    folder, _, _ = finished
    with sample.open("rb") as old, (folder / "out.mcap").open("rb") as new:
        before, after = (make_reader(stream, validate_crcs=True).get_summary() for stream in (old, new))
    schemas = {channel.topic: after.schemas[channel.schema_id].name for channel in after.channels.values()}
    assert schemas.keys() == {channel.topic for channel in before.channels.values()} | WRITTEN_BACK.keys()
    assert {topic: schemas[topic] for topic in WRITTEN_BACK} == WRITTEN_BACK


def test_the_deformation_written_is_the_one_reported(finished):
    folder, told, _ = finished
    document = json.loads(told.out)
    table = read_log(folder / "out.mcap", topics=["/deckflex/deformation"]).tables["/deckflex/deformation"]
    assert len(table) == document["samples"]
    assert np.all(np.diff(table.columns["header.stamp"]) > 0)
    covariance = table.columns["covariance"].reshape(-1, 3, 3)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)


def test_parquet_holds_the_same_samples(finished):
    folder, told, _ = finished
    frame = pl.read_parquet(next(folder.glob("*.deformation.parquet")))
    assert len(frame) == json.loads(told.out)["samples"]


def test_the_log_that_was_run_says_how(finished, sample):
    folder, _, before = finished
    with (folder / "out.mcap").open("rb") as stream:
        records = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    assert records["deckflex"]["log.sha256"] == before
    assert records["deckflex"]["estimator"] == "smoother"


def test_only_estimates_leaves_the_originals_out(deckflex, sample, tmp_path):
    told = deckflex("run", sample, "-o", tmp_path / "out.mcap", "--only-estimates", "--estimator", "filter")
    assert told.status == 0
    with (tmp_path / "out.mcap").open("rb") as stream:
        channels = make_reader(stream).get_summary().channels.values()
    assert {channel.topic for channel in channels} == WRITTEN_BACK.keys()


def test_estimates_that_a_log_holds_already_are_replaced_and_that_is_said(deckflex, finished, sample, tmp_path):
    folder, _, _ = finished
    told = deckflex("run", folder / "out.mcap", "-o", tmp_path / "again.mcap", "--estimator", "filter", "--json")
    assert told.status == 0, told.err
    assert any("/deckflex/deformation" in warning for warning in json.loads(told.out)["warnings"])
    with (tmp_path / "again.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
        records = [record for record in make_reader(stream).iter_metadata() if record.name == "deckflex"]
    counts = {c.topic: summary.statistics.channel_message_counts[c.id] for c in summary.channels.values()}
    before = {channel.topic: channel.count for channel in scan_log(folder / "out.mcap").channels}
    # Which samples of the sled are outliers depends on the deformation, so on the estimator.
    assert counts.pop("/deckflex/deck_shape") == pytest.approx(before.pop("/deckflex/deck_shape"), rel=0.01)
    assert counts == before
    assert [record.metadata["estimator"] for record in records] == ["filter"]
    again, original = read_log(tmp_path / "again.mcap"), read_log(sample)
    assert again.problems == ()
    for topic, table in original.tables.items():
        assert np.array_equal(table.columns["header.stamp"], again.tables[topic].columns["header.stamp"])


def test_people_see_angles_delay_flexure_errors_and_where_it_wrote(deckflex, sample, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    told = deckflex("run", sample, "-o", tmp_path / "out.mcap")
    assert told.status == 0
    assert told.err == ""
    for word in ("pitch x", "roll y", "heading z", "time delay", "RMSE vs truth", "deck shape", "times real time"):
        assert word in told.out
    assert str(tmp_path / "out.mcap") in told.out
    assert "\x1b" not in told.out


def test_compare_puts_estimators_side_by_side(deckflex, sample, tmp_path):
    words = ("compare", sample, "--estimator", "smoother", "--estimator", "filter")
    document = json.loads(deckflex(*words, "--rrd", tmp_path / "both.rrd", "--json").out)
    assert [one["estimator"] for one in document["estimators"]] == ["smoother", "filter"]
    assert all(one["rmse_arcmin"]["truth"] for one in document["estimators"])
    assert (tmp_path / "both.rrd").stat().st_size > 0
    table = deckflex(*words).out
    assert "smoother" in table
    assert "filter" in table


def test_compare_goes_on_without_an_estimator_that_has_no_answer(deckflex, sample):
    words = ("compare", sample, "--identifier", "whittle", "--set", "idam.as_printed=true")
    document = json.loads(deckflex(*words, "--estimator", "idam", "--estimator", "td-ma", "--json").out)
    assert [one["estimator"] for one in document["estimators"]] == ["td-ma"]
    assert "broke down" in document["failed"]["idam"]
    told = deckflex(*words, "--estimator", "idam", "--estimator", "td-ma")
    assert told.status == 0
    assert "no answer   idam: t = " in told.out


def test_compare_of_nothing_but_failures_is_one_line_and_a_failure(deckflex, sample):
    told = deckflex(
        "compare", sample, "--estimator", "idam", "--identifier", "whittle", "--set", "idam.as_printed=true"
    )
    assert told.status == 1
    assert told.out == ""
    assert len(told.err.splitlines()) == 1
    assert str(sample) in told.err
    assert "idam: t = " in told.err


def test_the_same_log_gives_the_same_bytes(deckflex, finished, sample, tmp_path):
    folder, _, _ = finished
    assert deckflex("run", sample, "-o", tmp_path / "again.mcap").status == 0
    assert digest(tmp_path / "again.mcap") == digest(folder / "out.mcap")
