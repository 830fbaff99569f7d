"""Start-up stays fast because heavy libraries stay out: counted, not timed."""

import subprocess
import sys

import pytest

SLOW = {"numba", "rerun", "polars", "pyarrow", "matplotlib", "filterpy", "pywt", "distributed", "dask", "fsspec"}
LISTED = (
    "import sys; from pipeline.cli import main\ntry: main(sys.argv[1:])\nfinally: print(*sys.modules, file=sys.stderr)"
)


def modules_after(*arguments: object) -> set[str]:
    command = [sys.executable, "-c", LISTED, *map(str, arguments)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    return {name.split(".")[0] for name in told.split()}


@pytest.mark.parametrize(
    "command", ["run", "compare", "info", "simulate", "list", "view", "version", "batch", "catalogue"]
)
def test_help_loads_nothing_slow(command):
    assert not modules_after(command, "--help") & (SLOW | {"numpy", "scipy"})


def test_info_loads_nothing_slow(sample):
    assert not modules_after("info", sample) & SLOW
