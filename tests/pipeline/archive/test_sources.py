"""What words find which logs, and what is passed over."""

import os
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

from pipeline.archive.sources import found_in
from schemas.errors import DataError
from tests.permissions import permissions_that_hold


@pytest.fixture
def tree(tmp_path):
    """Logs at several depths, and what is none."""
    for name in ("a.mcap", "sub/b.mcap", "sub/deep/c.MCAP", "[odd] name.mcap"):
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    for name in ("notes.txt", ".hidden.mcap", ".partial/d.mcap"):
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"#")
    return tmp_path / "in"


def names(found) -> list[str]:
    return [source.name for source in found.sources]


def test_a_directory_holds_all_logs_below_it(tree, tmp_path):
    assert names(found_in([str(tree)], str(tmp_path / "out"))) == [
        "[odd] name.mcap", "a.mcap", "sub/b.mcap", "sub/deep/c.MCAP",
    ]  # fmt: skip


def test_patterns_names_with_brackets_and_lists(tree, tmp_path):
    out = str(tmp_path / "out")
    assert names(found_in([f"{tree}/s*/*.mcap"], out)) == ["sub/b.mcap"]
    assert names(found_in([f"{tree}/**/*.mcap"], out)) == ["[odd] name.mcap", "a.mcap", "sub/b.mcap"]
    assert names(found_in([f"{tree}/su?"], out)) == ["b.mcap", "deep/c.MCAP"]
    assert names(found_in([f"{tree}/[odd] name.mcap"], out)) == ["[odd] name.mcap"]
    (tree / "list.txt").write_text(f"# voyages\n\na.mcap\n{tree}/sub\nnix.mcap\nftp://h/x.mcap\nlist.txt\n")
    found = found_in([str(tree / "list.txt")], out)
    assert sorted(names(found)) == ["a.mcap", "b.mcap", "deep/c.MCAP"]
    reasons = dict(found.unreadable)
    assert reasons["nix.mcap"] == "there is no such file or directory"
    assert "ftp:// is not served" in reasons["ftp://h/x.mcap"]
    assert reasons["list.txt"] == "a list names logs, not lists"


def test_each_log_is_found_once(tree, tmp_path):
    words = [str(tree), str(tree / "a.mcap"), f"{tree}/sub/*", f"file://{tree}/a.mcap"]
    assert len(found_in(words, str(tmp_path / "out")).sources) == 4


def test_logs_of_one_name_in_several_folders_are_told_apart(tree, tmp_path):
    for folder in ("2025", "2026/east"):
        (tree / folder).mkdir(parents=True)
        (tree / folder / "day.mcap").write_bytes(folder.encode())
        (tree / folder / "gone.mcap").symlink_to("nowhere")
    (tree / "years.lst").write_text("2025\n2026/east/day.mcap\n2026/east/gone.mcap\n")
    for words in ([f"{tree}/2025", f"{tree}/2026/east"], [f"{tree}/years.lst"]):
        found = found_in(words, str(tmp_path / "out"))
        assert names(found) == ["2025/day.mcap", "2026/east/day.mcap"]
        assert len(found.unreadable) == 2
    assert names(found_in([f"{tree}/2025"], str(tmp_path / "out"))) == ["day.mcap"]


def test_addresses_of_files_hold_any_letter(tree, tmp_path):
    log = tree / "day #1?.mcap"
    log.write_bytes(b"x")
    for word in (f"file://{log}", log.as_uri(), f"file://localhost{log}"):
        assert names(found_in([word], str(tmp_path / "out"))) == ["day #1?.mcap"]


def test_a_list_that_is_no_text_is_told_of(tree, tmp_path):
    (tree / "windows.txt").write_bytes("a.mcap\r\n".encode("utf-16"))
    with pytest.raises(DataError, match="is no list: it is not text in UTF-8"):
        found_in([f"{tree}/windows.txt"], str(tmp_path / "out"))


def test_links_in_circles_dead_links_pipes_and_closed_doors(tree, tmp_path):
    (tree / "sub" / "loop").symlink_to(tree)
    (tree / "dead.mcap").symlink_to(tree / "nowhere")
    (tree / "self.mcap").symlink_to(tree / "self.mcap")
    os.mkfifo(tree / "pipe.mcap")
    found = found_in([str(tree)], str(tmp_path / "out"))
    assert len(found.sources) == 4
    reasons = dict(found.unreadable)
    assert set(reasons) == {"dead.mcap", "self.mcap", "pipe.mcap"}
    assert reasons["pipe.mcap"] == "is not an ordinary file"
    assert "No such file" in reasons["dead.mcap"]


def test_a_directory_that_may_not_be_entered_is_told_of(tree, tmp_path):
    (tree / "sub").chmod(0)
    try:
        with permissions_that_hold():
            found = found_in([str(tree)], str(tmp_path / "out"))
    finally:
        (tree / "sub").chmod(0o755)
    assert "Permission denied" in dict(found.unreadable)[str(tree / "sub")]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("nowhere", "there is no such file or directory"),
        ("ftp://host/x.mcap", "ftp:// is not served"),
        ("zip://x.mcap::http://host/x.zip", "chain of addresses"),
        ("http://127.0.0.1:9/x.mcap", "cannot be read"),
        ("*.nix", "holds no log"),
    ],
)
def test_words_that_name_nothing_are_told_of_in_a_line(word, said, tmp_path):
    with pytest.raises(DataError, match=said) as told:
        found_in([word], str(tmp_path / "out"))
    assert "\n" not in str(told.value)


def test_input_inside_the_output_is_refused(tree, tmp_path):
    for out in (tree, tmp_path):
        with pytest.raises(DataError, match="is the output directory or inside it"):
            found_in([str(tree)], str(out))


def test_the_stamp_changes_when_a_log_is_replaced(tree, tmp_path):
    log = tree / "a.mcap"
    before = found_in([str(log)], "out").sources[0].stamp
    times = log.stat()
    other = tmp_path / "other"
    other.write_bytes(b"b.mcap")
    os.utime(other, ns=(times.st_atime_ns, times.st_mtime_ns))  # the same size and the same time of change
    other.replace(log)
    assert log.stat().st_mtime_ns == times.st_mtime_ns
    assert found_in([str(log)], "out").sources[0].stamp != before


@pytest.fixture
def web(tree):
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *words):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tree)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


def test_the_web_is_read_by_address_and_by_directory(web, tree, tmp_path):
    one = found_in([f"{web}/a.mcap"], "out").sources[0]
    assert (one.name, one.size) == ("a.mcap", len("a.mcap"))
    listed = found_in([f"{web}/sub/"], "out").sources
    assert [source.address for source in listed] == [f"{web}/sub/b.mcap"]
    with pytest.raises(DataError, match=r"x\.mcap"):
        found_in([f"{web}/x.mcap"], "out")
