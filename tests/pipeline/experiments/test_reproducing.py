"""Means, tables, texts and pages of experiments, on one whose figures are known."""

import json

import numpy as np
import polars as pl
import pytest

from pipeline import experiments, reproducing
from pipeline.reproduced import named
from pipeline.reproduction_page import experiment_text, page
from pipeline.reproduction_printing import reproduction_report
from schemas.errors import DataError
from tests.pipeline.experiments.fake import EXPERIMENT


@pytest.fixture(scope="module")
def outcome():
    return reproducing.measure(EXPERIMENT, 3)


def test_means_and_spreads_are_over_the_seeds(outcome):
    figure = named(outcome.figures)["", "published", "RMSE"]
    assert figure.mean == pytest.approx((2.0, 4.0, 6.0))
    assert figure.spread == pytest.approx((1.0, 2.0, 3.0))
    assert (figure.n, figure.unit, figure.part) == (3, "arcmin", "Main")


def test_printed_figures_and_limits_stand_beside_their_own_row_alone(outcome):
    figures = named(outcome.figures)
    assert figures["", "published", "RMSE"].printed.where == "Fig. 1"
    assert figures["", "published", "RMSE"].limit is None
    assert figures["", "smoother", "RMSE"].limit.value == (0.25, 0.25, 0.25)
    assert figures["other", "published", "lasts"].printed is None


def test_a_part_runs_over_no_more_seeds_than_it_says(outcome):
    assert {sample.seed for sample in outcome.samples if sample.part == "Grid"} == {1, 2}
    assert outcome.seeds == (1, 2, 3)


def test_curves_are_those_of_the_first_seed(outcome):
    assert len(outcome.panels) == 2
    assert outcome.panels[0].curves[0].y[0] == pytest.approx(1.0)


def test_claims_say_whether_they_hold(outcome):
    assert [holds for _, holds, _ in outcome.verdicts()] == [True, False, True]
    assert "at least 4 8 12 times" in outcome.verdicts()[2][2]


def test_progress_counts_seeds_and_parts():
    told = []
    reproducing.measure(EXPERIMENT, 3, lambda step, done, total: told.append((step, done, total)))
    assert told[1:] == [("fake", k, 5) for k in range(5)]


def test_the_text_holds_what_was_measured_printed_and_chosen(outcome):
    text = experiment_text(outcome)
    assert "| `published` | RMSE [arcmin] | 2 4 6 ± 1 2 3 | 3 | 4 – 6 | Fig. 1 | 4 8 12 | 8 – 12 |" in text
    assert "Everything is made up." in text
    assert "| published below 1 | **no** | 2 4 6 |" in text
    assert "breaks down" in text


def test_the_grid_has_a_sheet_for_each_axis_and_a_dash_where_nothing_was_run(outcome):
    text = experiment_text(outcome)
    assert "| `published` | 0° | 1.5 ± 0.71 | 7.5 ± 0.71 |" in text
    assert "| `published` | 1° | 2.5 ± 0.71 | – |" in text
    assert text.count("| method | misalignment / delay | 0 | 6 |") == 3


def test_table_text_and_recording_are_written_and_nothing_else(outcome, tmp_path):
    written = reproducing.write(outcome, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fake.md", "fake.parquet", "fake.rrd"]
    assert set(written) == {"text fake", "table fake", "recording fake"}
    table = pl.read_parquet(tmp_path / "fake.parquet")
    assert len(table) == len(outcome.samples)
    assert table.filter((pl.col("method") == "published") & (pl.col("seed") == 2))["value"][0].to_list() == [2, 4, 6]


def test_the_same_page_comes_from_the_table_again(outcome, tmp_path):
    reproducing.write(outcome, tmp_path)
    again = reproducing.measured_before(EXPERIMENT, tmp_path)
    assert page([again]) == page([outcome])
    assert again.versions == outcome.versions


def test_the_same_seeds_give_the_same_page(outcome):
    assert page([reproducing.measure(EXPERIMENT, 3)]) == page([outcome])


def test_no_table_and_a_foreign_table_are_told(tmp_path):
    with pytest.raises(DataError, match="no table of fake"):
        reproducing.measured_before(EXPERIMENT, tmp_path)
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "fake.parquet")
    with pytest.raises(DataError, match="not a table of an experiment"):
        reproducing.measured_before(EXPERIMENT, tmp_path)


def test_the_document_is_plain_json(outcome):
    document = json.loads(json.dumps(reproducing.reproduction_document([outcome], {}), allow_nan=False))
    figure = document["experiments"][0]["figures"][0]
    assert figure["published"] == [4.0, None, 6.0]
    assert np.allclose(figure["mean"], [2.0, 4.0, 6.0])


def test_the_report_tells_which_claims_fail(outcome):
    lines = [part for part in reproduction_report([outcome], {"table": "t"}) if isinstance(part, str)]
    assert "DOES NOT HOLD: published below 1 (2 4 6)" in lines
    assert "wrote       table: t" in lines


def test_an_unknown_experiment_is_wrong_usage_and_the_known_ones_are_told(deckflex):
    told = deckflex("reproduce", "nonsense")
    assert told.status == 2
    assert all(name in told.err for name in experiments.names())


def test_a_page_of_one_experiment_is_wrong_usage(deckflex, tmp_path):
    assert deckflex("reproduce", "td-ma", "--page", tmp_path / "page.md").status == 2


def test_a_directory_that_cannot_be_made_is_told_before_anything_runs(deckflex, tmp_path):
    (tmp_path / "file").write_text("")
    told = deckflex("reproduce", "td-ma", "-o", tmp_path / "file")
    assert told.status == 1
    assert "file" in told.err


def test_tables_measured_before_make_the_text_anew(deckflex, tmp_path, monkeypatch):
    told = deckflex("reproduce", "td-ma-platform", "--measured", "-o", tmp_path)
    assert told.status == 1
    assert "no table of td-ma-platform" in told.err


def test_resuming_measures_only_what_has_no_whole_table(tmp_path, monkeypatch):
    reproducing.reproduce((EXPERIMENT,), tmp_path, 3)
    recording = (tmp_path / "fake.rrd").read_bytes()
    monkeypatch.setattr(reproducing, "measure", None)
    outcomes, _ = reproducing.reproduce((EXPERIMENT,), tmp_path, 3, resume=True)
    assert outcomes[0].seeds == (1, 2, 3)
    assert (tmp_path / "fake.rrd").read_bytes() == recording
    assert not reproducing.finished(EXPERIMENT, tmp_path, 4)
    monkeypatch.setattr(reproducing, "versions", lambda: {"deckflex": "another"})
    assert not reproducing.finished(EXPERIMENT, tmp_path, 3)


@pytest.mark.slow
def test_an_experiment_runs_by_the_command_and_its_table_makes_the_same_text(deckflex, tmp_path):
    told = deckflex("reproduce", "td-ma-platform", "--seeds", "1", "-o", tmp_path, "--json")
    assert told.status == 0, told.err
    document = json.loads(told.out)["experiments"][0]
    assert document["seeds"] == [1]
    assert all(claim["holds"] for claim in document["claims"])
    first = (tmp_path / "td-ma-platform.md").read_text()
    assert deckflex("reproduce", "td-ma-platform", "--measured", "-o", tmp_path).status == 0
    assert (tmp_path / "td-ma-platform.md").read_text() == first
