import resource
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from schemas import scratch

ROWS = 1 << 18
pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or scratch.mapped(1 << 20) is None,
    reason="no Linux, or no room on the disk for arrays",
)


@pytest.fixture
def small(monkeypatch):
    """What is beyond a megabyte counts as large."""
    monkeypatch.setattr(scratch, "LARGE", 1 << 20)


def resident() -> int:
    """Bytes of memory that this process has now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def test_what_is_large_leaves_memory_and_keeps_its_values(small):
    values = np.random.default_rng(1).standard_normal((ROWS, 16))
    shelved = scratch.shelved(values)
    assert scratch.pages_of(shelved) is not None
    total = shelved.sum()
    before = resident()
    scratch.release(shelved[:, 3])
    assert before - resident() > 0.9 * values.nbytes
    assert shelved.sum() == total
    np.testing.assert_array_equal(shelved, values)


def test_what_is_written_before_a_release_is_there_after_it(small):
    array = scratch.empty((ROWS, 3))
    for k in range(0, ROWS, ROWS // 4):
        array[k : k + ROWS // 4] = k
        scratch.release(array)
    np.testing.assert_array_equal(array, np.repeat(np.arange(0, ROWS, ROWS // 4), ROWS // 4)[:, None] * np.ones(3))


@pytest.mark.parametrize(
    "values",
    [np.zeros(3), np.zeros((ROWS, 3))[:100], np.broadcast_to(1.0, (ROWS, 9)), np.full(ROWS, None)],
    ids=["small", "a small part", "one row for all", "objects"],
)
def test_what_takes_no_room_stays_where_it_is(small, values):
    assert scratch.shelved(values) is values


def test_views_of_views_are_followed_to_the_file_and_no_further(small):
    array = scratch.empty((ROWS, 3))
    strided = np.lib.stride_tricks.as_strided(array[:, 0], (10, 2), (24, 8))
    assert scratch.pages_of(strided.T) is scratch.pages_of(array) is not None
    assert scratch.pages_of(Rotation.from_rotvec(np.ones((5, 3))).as_rotvec()) is None  # memory of another owner
    assert scratch.pages_of(None) is None


def test_without_a_file_memory_is_plain(small, monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "nowhere"))
    monkeypatch.setattr(scratch.tempfile, "tempdir", str(tmp_path / "nowhere"))
    values = np.ones((ROWS, 3))
    assert scratch.pages_of(scratch.empty((ROWS, 3))) is None
    assert scratch.shelved(values) is values


def test_a_full_disk_is_no_error(small, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(scratch.os, "posix_fallocate", full)
    assert scratch.pages_of(scratch.empty((ROWS, 3))) is None


def test_no_file_is_left_behind(small, monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(scratch.tempfile, "tempdir", str(tmp_path))
    array = scratch.empty((ROWS, 3))
    assert scratch.pages_of(array) is not None
    assert not list(tmp_path.iterdir())
