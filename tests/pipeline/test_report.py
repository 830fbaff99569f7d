"""Pages written by the commands: whole or not at all, with their provenance, next to the other outputs."""

import json

import pytest

from tests.stages.publish.page.reading import loads_from_elsewhere, read


@pytest.fixture(scope="module")
def compared(sample, tmp_path_factory):
    from tests.pipeline.running import run_command

    folder = tmp_path_factory.mktemp("report")
    page, recording = folder / "page.html", folder / "both.rrd"
    words = ("compare", sample, "--estimator", "td-ma", "--estimator", "traditional")
    told = run_command(*words, "--report", page, "--rrd", recording, "--json")
    assert told.status == 0, told.err
    return folder, json.loads(told.out)


def test_run_writes_a_page_with_its_provenance(sample, deckflex, tmp_path):
    page = tmp_path / "page.html"
    told = deckflex("run", sample, "--estimator", "td-ma", "--report", page, "--json")
    assert told.status == 0, told.err
    document = json.loads(told.out)
    assert document["written"] == {"report": str(page)}
    shown = read(page.read_text("utf-8"))
    assert loads_from_elsewhere(shown) == []
    body = shown.texts["body"]
    for stated in ("log.sha256", document["details"]["provenance"]["log.sha256"], "td-ma", "numpy", "UTC", "rig"):
        assert stated in body
    for warning in document["warnings"]:
        assert warning in body
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


def test_compare_writes_page_and_recording_with_every_estimator(compared):
    folder, document = compared
    assert set(document["written"]) == {"report", "recording"}
    body = read((folder / "page.html").read_text("utf-8")).texts["body"]
    for one in document["estimators"]:
        assert one["estimator"] in body
        assert f"{one['rmse_arcmin']['truth'][0]:.3f}" in body


def test_compared_estimators_are_overlaid_with_bars_of_their_errors(compared):
    from tests.stages.publish.test_rerun_bridge import bar_lengths, chunks, column, view_names

    folder, document = compared
    found = chunks(folder / "both.rrd")
    for one in document["estimators"]:
        for kind in ("deformation", "error"):
            assert len(column(found[f"/{kind}/{one['estimator']}/x"], "Scalars:scalars")[0])
    assert "/deformation/truth/x" in found
    lengths = bar_lengths(folder / "both.rrd", "/bars/x/bars")
    rmse = [one["rmse_arcmin"]["truth"][0] for one in document["estimators"]]
    assert lengths[1] / lengths[0] == pytest.approx(rmse[1] / rmse[0], rel=0.01)
    assert sum("RMSE" in name and "[arcmin]" in name for name in view_names(folder / "both.rrd")) == 3


@pytest.mark.parametrize("command", [("run",), ("compare", "--estimator", "td-ma")])
def test_page_over_an_input_is_refused(sample, deckflex, command):
    told = deckflex(command[0], sample, *command[1:], "--report", sample)
    assert told.status == 1
    assert "inputs are never changed" in told.err
