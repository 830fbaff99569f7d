"""Benchmarks, what they said and the page about it.

    python -m benchmarks [PART ...] [--small]     run parts (all of them), keep what they say, make the page anew
    python -m benchmarks --page                   make the page from what is kept

Each part is a process of its own that measures deckflex and its peers side by side. Small runs show that everything
works; they are printed and not kept.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from benchmarks.page import Result, keep, make_page, this_machine

SMALL = {
    "decode": ["--duration", "120", "--repeats", "2"],
    "filters": ["--duration", "120", "--short", "100", "--repeats", "2"],
    "idam": ["--steps", "20000", "--short", "200", "--repeats", "1"],
    "run": ["--minutes", "2", "4"],
    "diagnose": ["--minutes", "3"],
    "batch": ["--logs", "4", "--repeats", "1"],
}


def main() -> None:
    """Run, keep, make the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[*SMALL, []], metavar="PART", help=", ".join(SMALL))
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    for part in [] if options.page else options.parts or SMALL:
        print(f"\n== {part}", flush=True)
        said = run(part, SMALL[part] if options.small else [])
        if not options.small:
            keep(Result(part, said, this_machine()))
    if not options.small:
        print(f"{make_page()} written")


def run(part: str, arguments: list[str]) -> list[str]:
    """The lines of one part, shown as they come."""
    command = [sys.executable, "-m", f"benchmarks.{part}", *arguments]
    lines = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            lines.append(line.rstrip())
    if process.returncode != 0:
        raise SystemExit(f"{part} failed")
    return lines


if __name__ == "__main__":
    main()
