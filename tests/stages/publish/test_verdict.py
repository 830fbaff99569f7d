"""The verdict says what a person must know first, and nothing else moves it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physics.units import ARCMIN
from schemas.products import Estimate, Innovations, Status
from stages.publish.verdict import Grade, angle, surprise, verdict
from tests.stages import synthetic_result as synthetic


@pytest.fixture(scope="module")
def case():
    return synthetic.case(duration=120.0, gap=None, with_deck=False)


def judged(case, **changes):
    d = replace(case.result.deformation, **changes)
    return verdict(replace(case.result, deformation=d), case.trial)


def test_faultless_result_can_be_relied_on(case):
    found = judged(case)
    assert found.grade is Grade.GOOD
    assert not found.reasons
    assert "+10.0′, −8.0′, +30.0′" in found.found
    assert "+2.00 ± 0.03 ms" in found.found
    assert "truth bears it out" in found.sure


def test_reference_far_outside_the_covariance_forbids_relying_on_it(case):
    scores = [replace(s, rmse=s.rmse * [1.0, 40.0, 1.0]) for s in case.result.scores if s.reference == "truth"]
    found = verdict(replace(case.result, scores=tuple(scores)), case.trial)
    assert found.grade is Grade.BAD
    assert found.reasons[0].startswith("truth contradicts it about y (roll)")
    assert "truth contradicts it" in found.sure


def test_missing_stretch_is_told_in_seconds():
    case = synthetic.case(duration=120.0, gap=None, with_deck=False)
    d = case.result.deformation
    kept = (d.stamp - synthetic.EPOCH) * 1e-9 < 90.0
    found = judged(case, stamp=d.stamp[kept], total=d.total[kept], static_part=d.static_part[kept],
                   dynamic_part=d.dynamic_part[kept], covariance=d.covariance[kept])  # fmt: skip
    assert found.grade is Grade.CARE
    assert "30 s of the trial (25%) have no estimate" in found.reasons[0]


def test_axis_known_worse_than_it_bends_is_named(case):
    covariance = case.result.deformation.covariance.copy()
    covariance[:, 2, 2] = (20 * ARCMIN) ** 2
    assert "z (heading) is known no better than it bends" in judged(case, covariance=covariance).reasons


def test_unknown_covariance_forbids_relying_on_it(case):
    found = judged(case, covariance=np.full_like(case.result.deformation.covariance, np.nan))
    assert found.grade is Grade.BAD
    assert "unknown" in found.sure


def test_weak_values_and_unused_sensors_ask_for_care(case):
    weak = Estimate(np.array(0.0), np.array(1.0), Status.NOT_OBSERVABLE, "no motion")
    found = judged(case, parameters={"time_delay": weak}, used=("gyros", "specific force: not used"))
    assert found.grade is Grade.CARE
    assert found.reasons == ("specific force: not used", "the time delay is not observable")
    assert "clock" not in found.found


def test_sensors_that_contradict_each_other_need_another_source_to_be_believed(case):
    d = replace(case.result.deformation, used=("gyros", "specific force: not used, it disagreed with the gyros"))
    confirmed = verdict(replace(case.result, deformation=d), case.trial)
    alone = verdict(replace(case.result, deformation=d, scores=()), case.trial)
    assert confirmed.grade is Grade.CARE
    assert alone.grade is Grade.BAD
    assert alone.reasons == confirmed.reasons == ("specific force: not used, it disagreed with the gyros",)


def test_surprise_is_placed_in_time():
    t = np.arange(0.0, 300.0, 0.2)
    values = np.random.default_rng(1).standard_normal((len(t), 2))
    values[5] = 50.0  # while the filter settles
    quiet = Innovations(t, values.copy(), ("gyro x", "gyro y"))
    assert surprise(quiet) is None
    values[1000, 1] = -31.0
    assert surprise(Innovations(t, values, ("gyro x", "gyro y"))) == (200.0, 31.0, "gyro y")


def test_no_reference_is_no_fault_but_is_told(case):
    found = verdict(replace(case.result, scores=()), case.trial)
    assert found.grade is Grade.GOOD
    assert "nothing in the log can confirm it" in found.sure


def test_what_decoding_repaired_asks_for_care_but_not_the_resting_sled(case):
    trial = replace(case.trial, notes=("/sliding/imu: 2 gaps", "/imu/sub: a gap of 40 s"))
    assert verdict(case.result, trial).reasons == ("/imu/sub: a gap of 40 s",)


@pytest.mark.parametrize(
    ("minutes", "text"), [(0.123, "0.12′"), (-22.56, "−22.6′"), (361.0, "361′"), (np.nan, "unknown")]
)
def test_angles_have_the_digits_a_person_reads(minutes, text):
    assert angle(minutes * ARCMIN) == text


def test_angle_too_large_for_a_mount_asks_for_the_axes(case):
    turned = Estimate(np.radians([10.0, 0.0, 40.0]), 0.4 * ARCMIN * np.ones(3))
    found = judged(case, parameters={**case.result.deformation.parameters, "static_angle": turned})
    assert found.grade is Grade.CARE
    assert "turned by 41.2° in all: are its axes declared as they are mounted?" in found.reasons[0]


def test_surprise_soon_after_a_gap_suspects_the_clock():
    case = synthetic.case(duration=120.0, gap=(50.0, 53.0), with_deck=False)
    innovations = case.result.deformation.innovations
    values = innovations.values.copy()
    values[np.searchsorted(innovations.t, 57.0), 1] = 40.0
    reasons = judged(case, innovations=replace(innovations, values=values)).reasons
    assert "main IMU fell silent until t = 53 s: its clock may have jumped there" in reasons[0]
    values[:] = 0.0
    values[np.searchsorted(innovations.t, 100.0), 1] = 40.0
    reasons = judged(case, innovations=replace(innovations, values=values)).reasons
    assert "fell silent" not in reasons[0]


def test_reference_that_saw_a_part_says_so(case):
    scores = [replace(s, duration=40.0) for s in case.result.scores if s.reference == "phins"]
    sure = verdict(replace(case.result, scores=tuple(scores)), case.trial).sure
    assert "PHINS bears it out over 40 s of 120 s" in sure
    assert " over " not in judged(case).sure


def test_reference_coarser_than_what_bends_bears_nothing_out(case):
    scores = [replace(s, reference_noise=np.full(3, 30 * ARCMIN)) for s in case.result.scores if s.reference == "phins"]
    assert (
        "PHINS is too uncertain itself to bear it out"
        in verdict(replace(case.result, scores=tuple(scores)), case.trial).sure
    )
