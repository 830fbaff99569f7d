"""One small simulated log for all tests of the command line, and the command itself."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from pipeline import cli


@dataclass(frozen=True)
class Outcome:
    status: int
    out: str
    err: str


@pytest.fixture
def deckflex(capsys):
    """Run the command in this process, as the entry point does."""

    def run(*arguments: object) -> Outcome:
        capsys.readouterr()
        with pytest.raises(SystemExit) as exit_:
            cli.main([str(argument) for argument in arguments])
        return Outcome(exit_.value.code, *capsys.readouterr())

    return run


def made(folder: Path, twin: str, duration: float) -> Path:
    log = folder / f"{twin}.mcap"
    with pytest.raises(SystemExit) as exit_:
        cli.main(["simulate", twin, "-o", str(log), "--seed", "3", "--duration", str(duration), "--json"])
    assert exit_.value.code == 0
    return log


@pytest.fixture(scope="session")
def sample(tmp_path_factory) -> Path:
    """Every channel of the contract, two minutes; not to be changed."""
    return made(tmp_path_factory.mktemp("sample"), "sample", 120.0)
