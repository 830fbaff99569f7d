"""All benchmarks in turn: ``python -m benchmarks``; each prints ratios to peers measured in the same run."""

from __future__ import annotations

import subprocess
import sys

BENCHMARKS = ("decode", "idam", "run")


def main() -> None:
    """Run each benchmark in a process of its own."""
    for name in BENCHMARKS:
        print(f"\n== {name}", flush=True)
        subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=True)


if __name__ == "__main__":
    main()
