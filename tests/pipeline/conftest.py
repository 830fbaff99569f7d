"""One small simulated log for all tests of the command line, and the command itself."""

from pathlib import Path

import pytest

from tests.pipeline.running import run_command


@pytest.fixture
def deckflex():
    """Run the command in this process, as the entry point does."""
    return run_command


@pytest.fixture(scope="session")
def sample(tmp_path_factory) -> Path:
    """Every channel of the contract, two minutes; not to be changed."""
    log = tmp_path_factory.mktemp("sample") / "trial.mcap"
    told = run_command("simulate", "sample", "-o", log, "--seed", "3", "--duration", "120", "--json")
    assert told.status == 0, told.err
    return log
