"""A bounded search for inputs that break a parser: ``python -m tests.fuzz [--seconds S] [--corpus DIR] [TARGET ...]``.

Guided by coverage, with atheris (libFuzzer) where that is installed; without it there is nothing to do. What is new
to the coverage is kept in the corpus directory; an input that crashes, hangs or takes too much memory is left there
as ``crash-*`` and the exit status is 1.
"""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
from pathlib import Path

SEEDS = Path(__file__).parent / "corpus"
LIMITS = ("-timeout=20", "-rss_limit_mb=2500", "-max_len=20000")


def main() -> None:
    """Run the targets named, or all, one after the other, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", default=["log", "records", "message", "rig", "twin"])
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument("--corpus", type=Path, default=Path("out/fuzz"), help="where findings go")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if importlib.util.find_spec("atheris") is None:
        print("fuzzing skipped: atheris is not installed here (pip install atheris; CPython 3.11 to 3.13 on Linux)")
        return
    if options.here:
        search(options.targets[0], options.corpus, options.seconds)
        return
    broken = []
    for target in options.targets:
        print(f"== {target}", flush=True)
        own = ["--seconds", str(options.seconds), "--corpus", str(options.corpus)]
        done = subprocess.run([sys.executable, "-m", "tests.fuzz", target, "--here", *own], check=False)
        broken += [target] if done.returncode else []
    if broken:
        sys.exit(f"broken: {', '.join(broken)}; the inputs lie in {options.corpus}")


def search(target: str, corpus: Path, seconds: int) -> None:
    """Fuzz one target in this process, which libFuzzer ends."""
    import atheris

    with atheris.instrument_imports(include=["schemas", "stages.decode", "twin", "mcap"]):
        from tests.fuzz.targets import TARGETS
    found = corpus / target
    found.mkdir(parents=True, exist_ok=True)
    flags = [*LIMITS, f"-max_total_time={seconds}", f"-artifact_prefix={found}/", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], *flags, str(found), str(SEEDS / target)], TARGETS[target])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
