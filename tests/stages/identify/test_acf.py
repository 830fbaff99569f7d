"""Least squares on the autocorrelation, on a simulated trial."""

import dataclasses

import numpy as np
import pytest

from stages import identify
from stages.identify.acf import Autocorrelation

PUBLISHED = ("acf", "rvm", "svr", "woa")


@pytest.fixture(scope="module")
def flexure(trial, alignment):
    return Autocorrelation().identify(trial, alignment)


def test_truth_lies_within_the_standard_errors(flexure, twin):
    truth = np.stack(
        [twin.flexure.damping, np.square(twin.flexure.damping), np.radians(twin.flexure.std_arcmin) / 60.0]
    )
    found = np.stack([flexure.damping, flexure.stiffness, flexure.std])
    std = np.sqrt(np.diagonal(flexure.log_covariance, axis1=1, axis2=2)).T
    # the long axis has ten correlation times alone: its errors are not small against themselves
    assert np.all(np.abs(np.log(found / truth))[:, :2] < 3.5 * std[:, :2])
    assert flexure.method == "acf"


def test_printed_increments_give_wrong_parameters(flexure, trial, alignment, twin):
    def wrong(found):
        return np.max(np.abs(np.log(found.damping / np.asarray(twin.flexure.damping))))

    printed = Autocorrelation(as_printed=True).identify(trial, alignment)
    assert wrong(printed) > 1.0
    assert wrong(printed) > 2.0 * wrong(flexure)


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_published_identifier_states_itself(name):
    method = identify.get(name)
    assert method.name == name
    assert method.source
    assert set(method.options) == {f.name for f in dataclasses.fields(method)}
