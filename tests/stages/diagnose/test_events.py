"""Slams and wild samples: found where they are, told apart, taken out; none on a null."""

import numpy as np
import pytest

from physics.units import ARCMIN, DEG
from stages.align import align
from stages.diagnose import events, spectra
from tests.stages.diagnose.full_rate import drawn, residual_of

SLAMS = (("slamming", (("rate", 2.0), ("amplitude", 12.0), ("frequency", 8.0), ("damping", 0.6), ("axis", "y"))),)
WILD = (("outliers", (("rate", 4.0), ("size", 0.1))),)


def found_in(seed, effects=()):
    residual, belief = residual_of(seed, 240.0, effects)
    candidates, found = events.examine(residual, belief)
    return {candidate.finding.name: candidate for candidate in candidates}, found, residual


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_null_has_no_events(seed):
    by_name, found, _ = found_in(seed)
    assert not found.any
    assert not any(candidate.named for candidate in by_name.values())


@pytest.mark.parametrize(
    "effect",
    [
        (("second_mode", (("damping", 0.05), ("frequency", 4.0), ("std_arcmin", 3.0))),),
        (("nonstationary_sea", (("growth", 3.0),)),),
        (("flexure_parameters", (("damping", 0.6),)),),
        (("gyro_bandwidth", (("cutoff", 15.0),)),),
    ],
    ids=lambda effect: effect[0][0],
)
def test_other_effects_make_no_events(effect):
    assert not found_in(4, effect)[1].any


def test_wild_samples_are_found_at_their_place_and_axis():
    trial, _ = drawn(5, 240.0, WILD)
    clean, _ = drawn(5, 240.0)
    by_name, found, _ = found_in(5, WILD)
    off = trial.sub.gyro - clean.sub.gyro
    rows, axes = np.nonzero(np.abs(off) > 1e-9)
    t = trial.seconds(trial.sub.stamp)
    assert {(round(t[k], 3), int(axis)) for k, axis in zip(rows, axes)} == {
        (round(wild.time, 3), wild.axis) for wild in found.wild
    }
    sizes = {(round(wild.time, 3), wild.axis): wild.size for wild in found.wild}
    for k, axis in zip(rows, axes):
        assert sizes[round(t[k], 3), int(axis)] == pytest.approx(off[k, axis], abs=0.01 * DEG)
    candidate = by_name["outliers"]
    assert candidate.named
    assert not by_name["slamming"].named
    assert abs(candidate.finding.parameters["size"].value - 0.1) < 3.0 * candidate.finding.parameters["size"].std


def test_wild_samples_taken_out_leave_a_null():
    trial, belief = drawn(5, 240.0, WILD)
    _, found, before = found_in(5, WILD)
    removed = events.remove(trial, found)
    after = spectra.residual(removed, align(removed), belief)
    assert not events.examine(after, belief)[1].any
    assert np.diff(after.rate, axis=0).std() < 0.8 * np.diff(before.rate, axis=0).std()
    assert np.array_equal(trial.sub.gyro, drawn(5, 240.0, WILD)[0].sub.gyro)


def test_slams_are_found_with_their_ringing():
    by_name, found, residual = found_in(6, SLAMS)
    slams = by_name["slamming"]
    assert slams.named
    assert not by_name["outliers"].named
    assert slams.finding.parameters["axis"].value == "y"
    for key, value in {"amplitude": 12.0, "frequency": 8.0, "damping": 0.6}.items():
        assert abs(slams.finding.parameters[key].value - value) < 4.0 * slams.finding.parameters[key].std
    left = events.without(residual, found)
    clean = residual_of(6)[0]
    assert np.std(left.rate[:, 1] - clean.rate[:, 1]) < 0.1 * np.std(residual.rate[:, 1] - clean.rate[:, 1])
    assert all(end > begin for begin, end in events.windows(found))


def test_a_lone_step_of_the_mounting_is_not_named_as_a_wild_sample():
    step = (("misalignment_step", (("x", 1.0), ("time", 100.0))),)
    by_name, found, _ = found_in(9, step)
    assert found.any
    assert not by_name["outliers"].named
    assert "misalignment_step" in by_name["outliers"].finding.ambiguous_with


def test_a_slam_begins_between_samples():
    shape = events.ringing(8.0, 0.5, 0.01)
    t = np.arange(-0.02, 2.0, 0.01)
    late = shape(t - 0.004)
    assert late[t < 0.0].max(initial=0.0) == 0.0
    assert np.cumsum(late)[-1] * 0.01 == pytest.approx(
        np.exp(-0.5 * (t[-1] - 0.004)) * np.sin(8.0 * (t[-1] - 0.004)) / 8.0, abs=1e-9
    )
    assert late.max() * ARCMIN == pytest.approx(ARCMIN, rel=0.05)
