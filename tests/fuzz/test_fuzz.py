"""The kept inputs, and inputs drawn anew, against every target: a refusal in one line is the worst that may happen."""

from __future__ import annotations

import functools
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from schemas.wire.records import MAGIC, frames
from tests.fuzz.targets import TARGETS

CORPUS = Path(__file__).parent / "corpus"
KEPT = sorted(path for path in CORPUS.glob("*/*") if path.is_file())
QUICK = settings(max_examples=50, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@pytest.mark.parametrize("path", KEPT, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_a_kept_input_is_read_or_refused(path: Path) -> None:
    TARGETS[path.parent.name](path.read_bytes())


def test_every_target_has_kept_inputs() -> None:
    assert {path.parent.name for path in KEPT} == TARGETS.keys()


@functools.cache
def seeds(target: str) -> tuple[bytes, ...]:
    return tuple(path.read_bytes() for path in KEPT if path.parent.name == target)


@st.composite
def broken(draw: st.DrawFn, target: str) -> bytes:
    """A kept input with pieces overwritten, cut out, repeated or moved."""
    data = bytearray(draw(st.sampled_from(seeds(target))))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(len(data) - 1, 0)))
        stop = min(len(data), start + draw(st.integers(0, 40)))
        act = draw(st.sampled_from(("overwrite", "cut", "repeat", "largest", "move")))
        piece = data[start:stop]
        if act == "overwrite":
            data[start:stop] = draw(st.binary(min_size=len(piece), max_size=len(piece)))
        elif act == "largest":
            data[start : start + 8] = b"\xff" * len(data[start : start + 8])
        else:
            data[start:stop] = b"" if act in ("cut", "move") else piece * draw(st.integers(2, 5))
            place = draw(st.integers(0, len(data)))
            data[place:place] = piece if act == "move" else b""
    return bytes(data)


@st.composite
def shuffled(draw: st.DrawFn) -> bytes:
    """The records of a sound log left out, doubled and in another order."""
    data = (CORPUS / "log" / "none.mcap").read_bytes()
    parts = [data[start - 9 : start + length] for _, start, length in frames(memoryview(data)[:-8], len(MAGIC))]
    chosen = draw(st.lists(st.sampled_from(parts), max_size=len(parts) + 3))
    return MAGIC + b"".join(chosen) + draw(st.sampled_from((b"", MAGIC)))


@pytest.mark.parametrize("target", TARGETS)
def test_a_broken_input_is_read_or_refused(target: str) -> None:
    @QUICK
    @given(broken(target))
    def check(data: bytes) -> None:
        TARGETS[target](data)

    check()


@QUICK
@given(shuffled())
def test_a_log_of_shuffled_records_is_read_or_refused(data: bytes) -> None:
    TARGETS["log"](data)


@QUICK
@given(st.binary(max_size=300))
def test_any_bytes_behind_the_magic_are_read_or_refused(data: bytes) -> None:
    TARGETS["log"](MAGIC + data)


def test_without_atheris_the_search_says_so_and_is_no_failure() -> None:
    absent = "import runpy, sys; sys.modules['atheris'] = None; runpy.run_module('tests.fuzz', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", absent], capture_output=True, text=True, check=True)
    assert "skipped" in done.stdout
