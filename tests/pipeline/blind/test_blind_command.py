"""``deckflex blind`` as typed."""

import json

import pytest

from tests.pipeline.running import run_command

SMALL = ("--duration", 60, "--severity", 10, "--effect", "accel_bias", "--seed", 4)
SHARES = ("--null-share", 0.5, "--pair-share", 0, "--foreign-share", 0, "--leave-out-share", 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("command") / "sealed"
    told = run_command("blind", "seal", folder, "--logs", 2, *SMALL, *SHARES, "--json")
    assert told.status == 0, told.err
    assert json.loads(told.out) == {
        "folder": str(folder), "key": f"{folder}.key", "logs": 2, "secret": False
    }  # fmt: skip
    return folder


def test_a_set_goes_from_seal_to_score(folder, tmp_path):
    told = run_command("blind", "answer", folder, "--method", "bic", "--json")
    assert json.loads(told.out)["methods"]["bic"]["answered"] == 2
    page, scored = tmp_path / "score.md", tmp_path / "score.json"
    told = run_command("blind", "score", folder, "-o", scored, "--page", page, "--json")
    assert told.status == 0, told.err
    assert json.loads(told.out) == json.loads(scored.read_text())
    assert json.loads(told.out)["methods"]["bic"]["single"]["top1"]["n"] == 1
    assert "score.svg" in page.read_text()
    assert page.with_suffix(".svg").read_text().startswith("<svg")
    again = run_command("blind", "score", folder)
    assert again.status == 1
    assert "opened already" in again.err
    assert again.err.count("\n") == 1
    shown = run_command("blind", "score", folder, "--again")
    assert "| nulls: a false name |" in shown.out


@pytest.mark.parametrize(
    ("words", "status", "part"),
    [
        (("answer", "nowhere"), 1, "nowhere"),
        (("score", "nowhere"), 1, "nowhere"),
        (("answer", "nowhere", "--method", "guess"), 2, "largest_residual"),
        (("answer", "nowhere", "--without", "witchcraft"), 2, "time_delay"),
        (("seal", "{}", "--effect", "witchcraft"), 2, "time_delay"),
        (("seal", "{}", "--null-share", "0.9", "--pair-share", "0.9"), 1, "add up"),
    ],
)
def test_mistakes_are_told_in_a_line(words, status, part, tmp_path):
    told = run_command("blind", *(word.format(tmp_path / "new") for word in words))
    assert told.status == status
    assert part in " ".join(told.err.split())
    assert "Traceback" not in told.err
