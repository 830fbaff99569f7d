"""Every fault of the corpus through the command line: its outcome, and what holds whatever happens."""

from __future__ import annotations

from pathlib import Path

import pytest

from schemas.wire import Table
from tests.faults.corpus import Fault
from tests.faults.outcomes import Refused, assert_answered, assert_refused, run


@pytest.mark.parametrize("fault", Fault, ids=lambda fault: fault.name)
def test_the_fault_has_its_outcome(fault: Fault, tables: dict[str, Table], sound: bytes, tmp_path: Path) -> None:
    damage, outcome = fault.value
    path, out = tmp_path / "trial.mcap", tmp_path / "out"
    out.mkdir()
    damage.write(sound, tables, path)
    before = path.read_bytes()
    told = run(path, out / "out.mcap")
    assert path.read_bytes() == before
    assert {one.name for one in tmp_path.iterdir()} == {"trial.mcap", "out"}
    if isinstance(outcome, Refused):
        assert_refused(told, outcome, path, out)
    else:
        assert_answered(told, outcome, out, tables["/truth/deformation"])
