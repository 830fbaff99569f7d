"""The heap keeps what arrays leave, in a process of its own."""

import subprocess
import sys

import pytest

CODE = """
import resource
import numpy as np
from pipeline.heap import keep_freed
kept = keep_freed() if {keep} else True
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
def used():
    several = [np.ones(1_000_000) for _ in range(8)]  # more than the C library keeps of itself
used()
before = faults()
for _ in range(10):
    used()
print(kept, faults() - before)
"""


def faults(keep: bool) -> tuple[bool, int]:
    code = CODE.format(keep=keep)
    told, number = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    return told == "True", int(number)


def test_arrays_come_from_memory_that_earlier_ones_left() -> None:
    kept, few = faults(True)
    if not kept:
        pytest.skip("this C library has no mallopt")
    _, many = faults(False)
    assert few < 0.2 * many
