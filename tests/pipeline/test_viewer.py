import pytest

from pipeline.viewer import viewer_command
from schemas.errors import DataError


@pytest.mark.parametrize("web", [False, True])
def test_the_viewer_listens_on_loopback_alone(tmp_path, web):
    command = viewer_command(tmp_path / "a.rrd", web=web)
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_a_name_that_looks_like_an_option_stays_a_file():
    from pathlib import Path

    assert Path(viewer_command(Path("--serve-grpc.rrd"), web=False)[3]).is_absolute()


def test_a_recording_that_is_none_is_told(deckflex, tmp_path):
    told = deckflex("view", tmp_path / "absent.rrd")
    assert told.status == 1
    assert "absent.rrd" in told.err
    assert DataError.__name__ not in told.err
