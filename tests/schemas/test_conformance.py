"""The official conformance files of the MCAP format, record by record."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from mcap import records as mcap

from schemas.wire import read_log, scan_log
from schemas.wire.records import read_records

FILES = Path(__file__).parents[2].parent / "shared" / "mcap-conformance"
CASES = sorted(FILES.glob("*/*.mcap"))
pytestmark = pytest.mark.skipif(not CASES, reason="the official conformance files are not beside the repository")


def as_expected(record: Any) -> dict[str, Any]:
    """The record in the form of the expected files: fields by name, numbers as text."""
    return {"type": type(record).__name__, "fields": {name: _text(value) for name, value in vars(record).items()}}


def _text(value: Any) -> Any:
    if isinstance(value, bytes):
        return [str(byte) for byte in value]
    if isinstance(value, dict):
        return {str(key): _text(item) for key, item in value.items()}
    return value if isinstance(value, str) else str(int(value))


def test_all_416_files_are_there():
    assert len(CASES) == 416


@pytest.mark.parametrize("kind", sorted({case.parent.name for case in CASES}))
def test_every_record_is_the_expected_one(kind: str):
    for case in (case for case in CASES if case.parent.name == kind):
        expected = json.loads(case.with_suffix(".json").read_text())["records"]
        records = [as_expected(record) for record in read_records(case.read_bytes())]
        assert records == [{"type": one["type"], "fields": dict(one["fields"])} for one in expected], case.name


def test_every_file_reads_as_a_log_with_its_messages_counted_and_no_damage_found():
    for case in CASES:
        messages = [record for record in read_records(case.read_bytes()) if isinstance(record, mcap.Message)]
        log = read_log(case)
        assert sum(channel.count or 0 for channel in log.channels) == len(messages), case.name
        assert all("not decoded" in problem for problem in log.problems), (case.name, log.problems)
        assert {(c.topic, c.count) for c in scan_log(case).channels} == {(c.topic, c.count) for c in log.channels}
