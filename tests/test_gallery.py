"""The gallery's page and its pictures belong together and stay light."""

import re
from pathlib import Path

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"


def test_every_picture_is_explained_and_every_explained_picture_is_there():
    named = set(re.findall(r"\]\(([\w-]+\.png)\)", (GALLERY / "README.md").read_text("utf-8")))
    assert named == {path.name for path in GALLERY.glob("*.png")}


def test_pictures_are_light_enough_for_git():
    assert sum(path.stat().st_size for path in GALLERY.glob("*.png")) < 3e6
