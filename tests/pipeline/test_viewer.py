"""The viewer: on loopback alone, told in one line what is wrong, gone when it is stopped."""

import sys
from pathlib import Path

import pytest

from pipeline import viewer
from pipeline.options import RunOptions
from pipeline.viewer import check_recording, has_screen, show, view, viewer_command
from schemas.errors import DataError


@pytest.mark.parametrize("web", [False, True])
def test_the_viewer_listens_on_loopback_alone(tmp_path, web):
    command = viewer_command(tmp_path / "a.rrd", web=web)
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_the_program_itself_is_run_since_its_python_entry_hides_how_it_ended():
    assert Path(viewer_command(Path("a.rrd"), web=False)[0]).name.lower() in ("rerun", "rerun.exe")


def test_a_name_that_looks_like_an_option_stays_a_file():
    assert Path(viewer_command(Path("--serve-grpc.rrd"), web=False)[1]).is_absolute()


def test_a_recording_that_is_none_is_told(deckflex, tmp_path):
    told = deckflex("view", tmp_path / "absent.rrd")
    assert told.status == 1
    assert "absent.rrd" in told.err
    assert DataError.__name__ not in told.err


def test_what_is_no_recording_is_not_opened(tmp_path):
    (tmp_path / "a.rrd").write_text("hello")
    with pytest.raises(DataError, match="not a Rerun recording"):
        check_recording(tmp_path / "a.rrd")


def test_without_a_screen_nothing_is_run_first(tmp_path, monkeypatch):
    monkeypatch.setattr(viewer, "has_screen", lambda environment: False)
    with pytest.raises(DataError, match="--web"):
        view(tmp_path / "no_such.mcap", RunOptions(), print)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere there always is one")
def test_a_screen_is_what_the_environment_names():
    assert not has_screen({"DISPLAY": ""})
    assert has_screen({"WAYLAND_DISPLAY": "wayland-0"})


def fake(monkeypatch, script):
    monkeypatch.setattr(viewer, "viewer_command", lambda recording, web: [sys.executable, "-c", script])


def test_the_address_is_told_and_nothing_else(monkeypatch, tmp_path):
    fake(monkeypatch, "import sys; print('\\x1b[2mINFO\\x1b[0m Hosting a web-viewer at http://127.0.0.1:9 - connect at "
                      "http://127.0.0.1:9?url=x\\nINFO loading', file=sys.stderr)")  # fmt: skip
    told = []
    show(tmp_path / "a.rrd", told.append, web=True)
    assert told == ["open http://127.0.0.1:9?url=x in a browser; Ctrl+C ends the viewer"]


def test_a_viewer_that_fails_says_why(monkeypatch, tmp_path):
    fake(monkeypatch, "import sys; print('INFO fine\\nError: no GPU', file=sys.stderr); sys.exit(3)")
    with pytest.raises(DataError, match="status 3: Error: no GPU"):
        show(tmp_path / "a.rrd", print, web=False)
