"""The page of benchmarks says what was measured."""

import json
from pathlib import Path

import pytest

from benchmarks import page

KEPT = sorted(page.RESULTS.glob("*.json"))


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_what_was_kept_stands_on_the_page(path: Path):
    result = page.Result(**json.loads(path.read_text("utf-8")))
    assert path.stem == result.part
    assert "\n".join(result.lines).strip("\n") in page.PAGE.read_text("utf-8")


def test_a_result_becomes_a_section_with_its_figures_and_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(page, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(page, "PAGE", tmp_path / "page.md")
    page.keep(page.Result("run", ["minutes 15", "  120 s"], "a machine"))
    page.keep(page.Result("decode", ["2.5 times"], "another one"))
    text = page.make_page().read_text("utf-8")
    assert text.index("## Decoding") < text.index("## The whole job")
    assert "```text\nminutes 15\n  120 s\n```" in text
    assert text.count("On a machine.") == 1
    assert "python -m benchmarks.run" not in text, "the usage of a part belongs into its help"
