import os
import stat

import pytest

from pipeline.files import check_input, check_target, check_targets, staged, writing
from schemas.errors import DataError


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.mcap"
    path.write_bytes(b"data")
    return path


def test_a_missing_input_is_told_by_name(tmp_path):
    with pytest.raises(DataError, match=r"absent\.mcap: cannot be read: No such file"):
        check_input(tmp_path / "absent.mcap")


def test_a_directory_is_not_an_input(tmp_path):
    with pytest.raises(DataError, match="is a directory"):
        check_input(tmp_path)


def test_a_loop_of_links_is_not_an_input(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(DataError, match="cannot be read"):
        check_input(tmp_path / "a")


def test_an_input_is_never_a_target_by_whatever_name(log, tmp_path):
    soft, hard = tmp_path / "soft.mcap", tmp_path / "hard.mcap"
    soft.symlink_to(log)
    os.link(log, hard)
    for name in (log, soft, hard, tmp_path / "." / "log.mcap"):
        with pytest.raises(DataError, match="never changed"):
            check_target(name, [log])


def test_a_directory_and_a_pipe_are_not_replaced(log, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(DataError, match="not an ordinary file"):
        check_target(pipe, [log])
    with pytest.raises(DataError, match="is a directory"):
        check_target(tmp_path, [log])
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_target_in_no_directory_is_refused(log, tmp_path):
    with pytest.raises(DataError, match="there is no directory"):
        check_target(tmp_path / "nowhere" / "out.mcap", [log])


def test_one_target_cannot_be_named_twice(log, tmp_path):
    with pytest.raises(DataError, match="named twice"):
        check_targets([tmp_path / "out", tmp_path / "out"], [log])


def test_staged_files_appear_together_when_whole(tmp_path):
    targets = [tmp_path / "a.mcap", tmp_path / "b.rrd"]
    with staged(targets) as temporary:
        assert [path.suffix for path in temporary] == [".mcap", ".rrd"]
        assert all(path.parent == tmp_path for path in temporary)
        for path in temporary:
            path.write_text("whole")
        assert not any(target.exists() for target in targets)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "b.rrd"]


@pytest.mark.parametrize("failure", [OSError, KeyboardInterrupt, SystemExit])
def test_nothing_is_left_when_the_writing_fails_and_an_old_target_stays(tmp_path, failure):
    target = tmp_path / "a.mcap"
    target.write_text("old")

    def write_half():
        with staged([target]) as (path,):
            path.write_text("half")
            raise failure

    with pytest.raises(failure):
        write_half()
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
    assert target.read_text() == "old"


def test_a_full_disk_is_told_with_the_target(tmp_path):
    full = OSError(28, "No space left on device")
    with (
        pytest.raises(DataError, match=r"out\.mcap: cannot be written: No space left on device"),
        writing(tmp_path / "out.mcap"),
    ):
        raise full


def test_people_read_the_targets_name_not_the_temporary_one(tmp_path):
    temporary = tmp_path / ".out.123.mcap"
    with pytest.raises(DataError, match=r"^[^ ]*/out\.mcap: disk full"), writing(tmp_path / "out.mcap", temporary):
        raise DataError("disk full", file=temporary)
