"""One simulated trial for all identifiers."""

import numpy as np
import pytest

from schemas.products import Alignment
from schemas.trial import Trial
from stages.align import align
from twin import Twin, load_twin, simulate, with_run


@pytest.fixture(scope="package")
def twin() -> Twin:
    return with_run(load_twin("idam"), duration=900.0)


@pytest.fixture(scope="package")
def trial(twin: Twin) -> Trial:
    return simulate(twin, np.random.default_rng(3)).trial


@pytest.fixture(scope="package")
def alignment(trial: Trial) -> Alignment:
    return align(trial)
