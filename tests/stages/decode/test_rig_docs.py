"""The rig page and its examples say what the code does."""

import re
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

from stages.decode import RigProfile, load_rig
from stages.decode.profile import Attitude, Channel, ImuChannel, Mount, Noise

DOCS = Path(__file__).parents[3] / "docs"
EXAMPLES = sorted((DOCS / "rigs").glob("*.toml"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_load(path):
    assert load_rig(path).name == tomllib.loads(path.read_text(encoding="utf-8"))["name"]


def test_there_are_examples():
    assert len(EXAMPLES) >= 4


@pytest.mark.parametrize("model", [RigProfile, Mount, Channel, ImuChannel, Attitude, Noise])
def test_every_key_is_explained(model: type[BaseModel]):
    text = (DOCS / "rig.md").read_text(encoding="utf-8")
    missing = [key for key in model.model_fields if not re.search(rf"[`\[ ]?\b{key}\b", text)]
    assert missing == []


def test_toml_on_the_page_loads(tmp_path):
    text = (DOCS / "rig.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)
    assert blocks
    for block in blocks:
        (tmp_path / "rig.toml").write_text(block, encoding="utf-8")
        load_rig(tmp_path / "rig.toml")
