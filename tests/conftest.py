"""Before anything imports numpy: one thread in the linear algebra libraries, as in the command itself.

And the order of the files, for workers that take one after the other: what compiles the filters comes first beside
something that does not need them, so that they are compiled once; long files come before short ones.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

FIRST = (
    "faults/test_environment.py", "stages/shape/test_spline.py", "faults/test_faults.py", "test_architecture.py",
    "stages/diagnose/test_diagnosis.py", "stages/diagnose", "pipeline", "stages/estimate",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: _rank(item.path))


def _rank(path: Path) -> int:
    place = path.relative_to(Path(__file__).parent).as_posix()
    return next((rank for rank, prefix in enumerate(FIRST) if place.startswith(prefix)), len(FIRST))
