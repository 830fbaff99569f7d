"""The reference's own noise, read off the error against it."""

from __future__ import annotations

import numpy as np

from physics.units import ARCMIN
from stages.score import noise


def errors(rng, n=72_000, rate=10.0, white=0.1, walk=0.0):
    stamp = (np.arange(n) * (1e9 / rate)).astype(np.int64)
    slow = np.cumsum(walk * rng.standard_normal((n, 3)), axis=0)
    return stamp, (white * rng.standard_normal((n, 3)) + slow) * ARCMIN


def test_white_noise_is_found_under_a_random_walk():
    stamp, error = errors(np.random.default_rng(3), white=0.1, walk=0.02)
    np.testing.assert_allclose(noise.white_noise(stamp, error, 0.1) / ARCMIN, 0.1, rtol=0.05)


def test_no_white_noise_is_invented():
    stamp, error = errors(np.random.default_rng(3), white=0.0, walk=0.02)
    assert noise.white_noise(stamp, error, 0.1).max() < 0.005 * ARCMIN


def test_white_noise_of_a_slow_reference_is_read_at_its_own_rate():
    rng = np.random.default_rng(4)
    knots = 0.1 * ARCMIN * rng.standard_normal((3001, 3))
    t = np.arange(30_000) * 0.01
    error = np.stack([np.interp(t, np.arange(3001) * 0.1, knots[:, i]) for i in range(3)], axis=1)
    stamp = (t * 1e9).round().astype(np.int64)
    np.testing.assert_allclose(noise.white_noise(stamp, error, 0.1) / ARCMIN, 0.1, rtol=0.1)


def test_drift_of_a_gauss_markov_reference_is_found():
    from tests.stages.synthetic_result import drifting

    rng = np.random.default_rng(5)
    stamp, error = errors(rng, white=0.1)
    error = error + drifting(stamp * 1e-9, rng, np.array([0.3, 0.3, 0.6]) * ARCMIN)
    found = noise.drift(stamp, error, noise.white_noise(stamp, error, 0.1)) / ARCMIN
    np.testing.assert_allclose(found, [0.3, 0.3, 0.6], rtol=0.25)


def test_wandering_estimate_is_not_excused_beyond_the_data_sheet():
    stamp, error = errors(np.random.default_rng(6), walk=0.5)
    np.testing.assert_array_equal(noise.drift(stamp, error, np.zeros(3)), noise.DRIFT_CEILING)


def test_constant_error_is_nobodys_noise():
    stamp, error = errors(np.random.default_rng(7), white=0.0)
    found = noise.reference_noise(stamp, error + 5 * ARCMIN, 0.1, np.zeros(3))
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_short_record_gets_the_nominal_values():
    stamp, error = errors(np.random.default_rng(8), n=50)
    np.testing.assert_array_equal(noise.white_noise(stamp, error, 0.1), noise.NOMINAL_WHITE)
    np.testing.assert_array_equal(noise.drift(stamp, error, np.zeros(3)), noise.NOMINAL_DRIFT)
