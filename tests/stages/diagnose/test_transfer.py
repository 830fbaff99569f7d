"""Transfer functions of what has no name, against errors whose own are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schemas.trial import Trial
from stages.align import align
from stages.diagnose.evidence import Fit
from stages.diagnose.selection import select
from stages.diagnose.transfer import FREQUENCY, RATE, TAPS_S, response_of, transfer
from stages.publish.diagnosis_words import transfer_text
from tests.stages.diagnose.simulated import TWIN, log

GAIN, LATE = 2e-3, 0.02  # of the roll rate, s


def test_taps_answer_as_their_sum_of_delays_does() -> None:
    rng = np.random.default_rng(1)
    root = rng.standard_normal((len(TAPS_S), len(TAPS_S)))
    taps = Fit(rng.standard_normal(len(TAPS_S)), 1e-4 * root @ root.T, 0.0)
    gain, gain_std, phase, phase_std = response_of(taps, FREQUENCY)
    draws = taps.value + rng.multivariate_normal(np.zeros(len(TAPS_S)), taps.covariance, 4000)
    H = draws @ np.exp(-2j * np.pi * np.outer(TAPS_S, FREQUENCY))
    expected = taps.value @ np.exp(-2j * np.pi * np.outer(TAPS_S, FREQUENCY))
    np.testing.assert_allclose(gain, np.abs(expected), rtol=1e-12)
    np.testing.assert_allclose(phase, np.angle(expected), atol=1e-12)
    sure = gain > 10.0 * gain_std
    assert sure.sum() > 5
    np.testing.assert_allclose(gain_std[sure], np.abs(H).std(axis=0)[sure], rtol=0.1)
    spread = np.angle(H * np.conj(expected)).std(axis=0)
    np.testing.assert_allclose(phase_std[sure], spread[sure], rtol=0.1)


def disturbed(trial: Trial) -> Trial:
    """The roll rate, a little late, seen by the sub-IMU's gyro about the vertical: no effect of the library."""
    t = trial.seconds(trial.main.stamp)
    rate = np.interp(trial.seconds(trial.sub.stamp) - LATE, t, trial.main.gyro[:, 1])
    gyro = trial.sub.gyro + GAIN * rate[:, None] * np.array([0.0, 0.0, 1.0])
    return replace(trial, sub=replace(trial.sub, gyro=gyro))


def test_what_has_no_name_is_told_from_the_motion_that_it_follows() -> None:
    trial = disturbed(log())
    chosen = select(trial, TWIN, align(trial), np.random.default_rng(0), ["gyro_temperature"])
    found = transfer(chosen, "sub.gyro", "z", whole=True)
    assert (found.source, found.source_axis, found.unit) == (RATE, "y", "1")
    assert found.evidence_nats > 50.0
    sure = found.gain > 10.0 * found.gain_std
    assert sure.sum() > 3
    turned = np.degrees(found.phase + 2.0 * np.pi * FREQUENCY * LATE)[sure]
    assert (np.abs(found.gain - GAIN) < 3.5 * found.gain_std)[sure].all()
    assert (np.abs(turned) < 3.5 * np.degrees(found.phase_std)[sure] + 0.5).all()
    assert "follows the gyro of the main IMU, y" in transfer_text(found)


def test_a_log_without_a_gap_follows_nothing_and_a_clock_is_looked_for_in_the_gyros() -> None:
    trial = log()
    chosen = select(trial, TWIN, align(trial), np.random.default_rng(0), ["gyro_temperature"])
    found = transfer(chosen, "sub.stamp", "", whole=False)
    assert (found.channel, found.axis) == ("sub.gyro", "x")
    assert found.evidence_nats < 14.0
    assert "follows no motion of the ship" in transfer_text(found)
