"""A whole archive by its command: forty sound voyages, six kinds of damage, two worker processes."""

import io
import json
import re
import shutil

import polars as pl
import pytest

from pipeline.archive.batch_printing import listening
from pipeline.archive.jobs import Outcome, State
from pipeline.archive.running import Step
from pipeline.archive.source import Source
from tests.pipeline.archive import voyages
from tests.pipeline.archive.processes import check_whole, entries


@pytest.fixture
def told(done):
    return json.loads((done / "told.json").read_text())


@pytest.fixture
def copied(done, tmp_path):
    return shutil.copytree(done / "out", tmp_path / "out", copy_function=shutil.copy2)


def test_bad_logs_are_set_aside_with_their_reason_and_stop_nothing(done, told):
    assert told["logs"] == 46
    assert told["done"] == 40
    assert told["failed"] == []
    reasons = {row["name"]: row["reason"] for row in told["set_aside"]}
    assert len(reasons) == len(voyages.DAMAGES) == 6
    for fault in voyages.DAMAGES:
        reason = reasons[f"bad/{fault.name.lower()}.mcap"]
        assert "\n" not in reason
        for word in fault.value[1].words:
            assert word in reason
    assert (done / "status").read_text() == "1"


def test_a_line_is_said_for_every_log_and_one_at_the_end(done):
    lines = (done / "said").read_text().splitlines()
    assert len(lines) == 47
    assert all("/46 done" in line or "/46 set aside" in line for line in lines[:46])
    assert lines[-1] == "deckflex: 6 of 46 logs are without a result, each with its reason above"
    assert sum("left]" in line for line in lines) >= 44


def test_every_entry_is_whole_and_nothing_else_lies_about(done):
    out = done / "out"
    check_whole(out)
    assert len(entries(out)) == 40
    assert len(entries(out, "aside")) == 6
    named = {name for entry in entries(out) for name in json.loads(entry.read_bytes())["files"].values()}
    assert named == {str(path.relative_to(out)) for path in (out / "results").rglob("*") if path.is_file()}
    assert list((out / ".partial").iterdir()) == []


def test_hours_and_memory_are_counted(told):
    assert told["hours"] == pytest.approx(40 * 40 / 3600, rel=0.05)
    assert told["hours_per_minute"] > 0
    assert 0.1 < told["peak_memory_gb"] < 1.5


def test_a_second_run_does_nothing(fleet, copied, deckflex):
    before = voyages.digest(copied)
    told = deckflex("batch", fleet, "-o", copied, *voyages.CHEAP, "--json")
    document = json.loads(told.out)
    assert (document["done"], document["done_before"], len(document["set_aside"])) == (0, 40, 6)
    assert document["workers"] == 0
    assert told.status == 1
    assert voyages.digest(copied) == before


def test_a_reason_that_was_spoilt_stops_nothing(fleet, copied, deckflex):
    entries(copied, "aside")[0].write_text("{")
    document = json.loads(deckflex("batch", fleet, "-o", copied, *voyages.CHEAP, "--json").out)
    assert (document["done_before"], len(document["set_aside"])) == (40, 6)
    assert sum("is not JSON" in row["reason"] for row in document["set_aside"]) == 1


def test_dry_run_says_what_would_be_done_and_touches_nothing(fleet, copied, deckflex, tmp_path):
    before = voyages.digest(copied)
    first = json.loads(deckflex("batch", fleet, "-o", tmp_path / "new", *voyages.CHEAP, "--dry-run", "--json").out)
    assert len(first["to_do"]) == 46
    assert not (tmp_path / "new").exists()
    words = ("batch", fleet, "-o", copied, "--estimator", "td-ma", "--dry-run", "--json")
    assert len(json.loads(deckflex(*words).out)["to_do"]) == 46  # other options are other work
    again = json.loads(deckflex("batch", fleet, "-o", copied, *voyages.CHEAP, "--retry", "--dry-run", "--json").out)
    assert len(again["to_do"]) == 6
    assert voyages.digest(copied) == before


def test_an_archive_inside_its_own_input_is_not_read_as_logs(few, done, deckflex):
    shutil.copytree(done / "out" / "results", few / "out" / "results")
    (few / "out" / "deckflex-archive.json").write_text('{"format": 1}')
    plan = json.loads(deckflex("batch", few, "-o", few / "out", *voyages.CHEAP, "--dry-run", "--json").out)
    assert len(plan["to_do"]) == 6
    other = json.loads(deckflex("batch", few, "-o", few / "other", *voyages.CHEAP, "--dry-run", "--json").out)
    assert len(other["to_do"]) == 6
    assert "passed over" in other["notes"][0]


def test_catalogue_finds_the_drift_that_was_put_in(copied, deckflex):
    document = json.loads(deckflex("catalogue", copied, "--json").out)
    assert document["logs"] == 40
    assert len(document["set_aside"]) == 6
    group = document["installations"][0]
    for axis, true in zip("xyz", voyages.DRIFT):
        slope, std = voyages.drift_of(group["static_angle"], axis)
        assert abs(slope - true) < 3.5 * std
        assert std < 1.0
        exponent = group["flexure_against_sea"][axis]
        assert abs(exponent["exponent"] - 1.0) < 3.5 * exponent["exponent_std"]
        assert exponent["exponent_std"] < 0.5
    assert document["worst"][0]["grade"] == "bad"


def test_catalogue_is_one_data_set_of_a_row_a_log_and_axis(copied, deckflex):
    first = json.loads(deckflex("catalogue", copied, "--json").out)
    frame = pl.read_parquet(first["catalogue"])
    assert len(frame) == 3 * 40 + 6
    assert frame.filter(pl.col("axis").is_null())["reason"].null_count() == 0
    sound = frame.filter(pl.col("axis").is_not_null())
    for column in ("static_arcmin", "static_std_arcmin", "time_delay_s", "flexure_std_arcmin", "rmse_truth_arcmin",
                   "grade", "roughness_dps", "start_utc", "sha256", "version"):  # fmt: skip
        assert sound[column].null_count() == 0, column
    assert sound["rmse_phins_arcmin"].null_count() == 3 * 30
    assert sound["name"][0] == "month-00/voyage 00-0.mcap"
    assert str(sound["start_utc"][0]).startswith("2026-01-01 00:00:00")
    before = (copied / "catalogue.parquet").stat().st_mtime_ns
    assert json.loads(deckflex("catalogue", copied, "--json").out) == first
    assert (copied / "catalogue.parquet").stat().st_mtime_ns == before


def test_catalogue_answers_queries(copied, deckflex):
    query = "select name, rmse_truth_arcmin as e from catalogue where axis = 'z' order by e desc limit 2"
    rows = json.loads(deckflex("catalogue", copied, "--sql", query, "--json").out)["rows"]
    assert len(rows) == 2
    assert rows[0]["e"] > rows[1]["e"]
    spring = json.loads(deckflex("catalogue", copied, "--where", "month(start_utc) <= 3", "--json").out)
    assert spring["logs"] == 12
    wrong = deckflex("catalogue", copied, "--where", "colour = 'red'")
    assert wrong.status == 2
    assert "colour" in wrong.err


def test_catalogue_writes_page_and_recording(copied, deckflex, tmp_path):
    from tests.stages.publish.page.reading import loads_from_elsewhere, read
    from tests.stages.publish.test_rerun_bridge import column_text

    page, recording = tmp_path / "archive.html", tmp_path / "archive.rrd"
    told = deckflex("catalogue", copied, "--report", page, "--rrd", recording)
    assert told.status == 0, told.err
    assert "The static angle drifts" in told.out
    shown = read(page.read_text("utf-8"))
    assert loads_from_elsewhere(shown) == []
    for words in ("Static angle about z (heading)", "bad/degrees.mcap", "Flexure about x (pitch) against the sea"):
        assert words in shown.texts["body"]
    assert recording.stat().st_size > 50_000
    assert str(tmp_path) not in page.read_text("utf-8")
    text = column_text(recording, "/summary")
    assert copied.name in text
    assert str(copied.parent) not in text


def test_page_and_recording_take_no_place_of_the_archives_own(copied, deckflex):
    deckflex("catalogue", copied)
    before = voyages.digest(copied)
    for target in (copied / "catalogue.parquet", entries(copied)[0], copied / "deckflex-archive.json"):
        told = deckflex("catalogue", copied, "--report", target)
        assert (told.status, told.err.count("\n")) == (1, 1)
        assert "file of the archive itself" in told.err
    assert voyages.digest(copied) == before
    assert deckflex("catalogue", copied, "--report", copied / "page.html").status == 0


def test_a_person_sees_that_work_goes_on_before_the_first_log_ends(monkeypatch):
    class Screen(io.StringIO):
        def isatty(self):
            return True

    def seen():
        return re.sub(r"\x1b\[[^a-zA-Z]*[a-zA-Z]", "", screen.getvalue())

    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setenv("COLUMNS", "120")
    with listening() as listener:
        listener.begun(3)
        assert "0 of 3 logs, time left not known yet; 0:00:00" in seen()
        outcome = Outcome(Source("a.mcap", "a.mcap", 10, ""), State.ASIDE, reason="the file is empty")
        listener.ended(Step(outcome, 1, 3, 700.0))
    assert "1/3 set aside a.mcap  the file is empty  [12 min left]" in seen()
    assert "1 of 3 logs, 12 min left;" in seen()


def test_an_entry_that_was_spoilt_is_told_of_and_the_rest_stands(copied, deckflex):
    entries(copied)[0].write_text("{")
    told = deckflex("catalogue", copied, "--json")
    document = json.loads(told.out)
    assert document["logs"] == 39
    assert "is not JSON" in document["notes"][0]
