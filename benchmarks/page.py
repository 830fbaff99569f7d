"""What benchmarks said, kept as JSON, and the page made from it."""

from __future__ import annotations

import ast
import json
import os
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "results"
PAGE = FOLDER.parent / "docs" / "benchmarks.md"
ORDER = ("decode", "filters", "idam", "run", "diagnose", "batch")
LIBRARIES = ("numpy", "numba", "rerun-sdk", "rosbags", "mcap", "mcap-ros2-support", "filterpy")
INTRODUCTION = """# Benchmarks

Made by `make bench` from measured results (`benchmarks/results/`); not written by hand. Deckflex and its peers are
measured in one run and in turns, in CPU seconds of the process unless it says otherwise, so that a busy machine touches
all alike. Figures in brackets are the least and the greatest of the repeats.

`python -m benchmarks decode run` runs parts, `--small` a short form of them, `--page` makes this page again.
"""


@dataclass(frozen=True)
class Result:
    """What one part said, line by line, and on what machine."""

    part: str
    lines: list[str]
    machine: str


def this_machine() -> str:
    """Processor, cores, Python and the libraries compared, in a line."""
    processor = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        named = [line for line in information.read_text().splitlines() if line.startswith("model name")]
        processor = named[0].partition(":")[2].strip() if named else processor
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return f"{processor}, {os.cpu_count()} cores; Python {platform.python_version()}, {libraries}"


def keep(result: Result) -> None:
    """Write a result where the page finds it."""
    RESULTS.mkdir(exist_ok=True)
    target = RESULTS / f"{result.part}.json"
    target.write_text(json.dumps(asdict(result), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def make_page() -> Path:
    """The page, from all results there are."""
    paths = [RESULTS / f"{part}.json" for part in ORDER]
    results = [Result(**json.loads(path.read_text("utf-8"))) for path in paths if path.exists()]
    PAGE.write_text("\n".join([INTRODUCTION, *map(section, results)]), encoding="utf-8")
    return PAGE


def section(result: Result) -> str:
    """What the part measures, in the words of its module, and what it said."""
    text = ast.get_docstring(ast.parse((FOLDER / f"{result.part}.py").read_text("utf-8"))) or ""
    title, _, rest = text.partition("\n")
    about = "\n\n".join(block for block in rest.strip("\n").split("\n\n") if not block.startswith("    "))
    said = "\n".join(result.lines).strip("\n")
    return f"## {title.partition(':')[0].rstrip('.')}\n\n{about}\n\n```text\n{said}\n```\n\nOn {result.machine}.\n"
