"""Lines in the rate of a shaking deck: found where there is one, never made of the steep spectrum of the flexure."""

import numpy as np
import pytest

from physics import flexure
from physics.units import ARCMIN, DEG
from stages.diagnose.candidate import FLOOR_NATS
from stages.diagnose.spectral_lines import lines
from stages.diagnose.spectral_residual import FullRateResidual

T, NOISE = 0.05, 4e-5  # s between samples; rad/s of white noise


def shaken(seed: int, duration: float) -> FullRateResidual:
    """A deck without a line: mean rates of the flexure and white noise."""
    rng = np.random.default_rng(seed)
    n = int(duration / T)
    rate = np.empty((n, 3))
    for axis, (damping, frequency) in enumerate(((0.2, 0.6), (0.15, 0.45), (0.15, 0.4))):
        theta, _ = flexure.sample(damping, damping**2 + frequency**2, 2.0 * ARCMIN, np.full(n, T), rng)
        rate[:, axis] = np.diff(theta) / T
    rate += NOISE * rng.standard_normal((n, 3))
    still = np.zeros((n, 3))
    return FullRateResidual(T * np.arange(n), T, rate, np.ones(n, bool), still, still, np.eye(3), 0.0, 0.0)


@pytest.mark.parametrize("duration", [60.0, 80.0, 400.0])
def test_the_steep_spectrum_of_a_short_record_is_no_line(duration):
    assert [lines(shaken(seed, duration), FLOOR_NATS) for seed in range(30)] == [()] * 30


@pytest.mark.parametrize(("frequency", "amplitude"), [(0.8, 0.012), (7.3, 0.002)])
def test_a_line_in_a_short_record_is_found_with_its_size(frequency, amplitude):
    residual = shaken(1, 60.0)
    residual.rate[:, 1] += amplitude * DEG * np.sinc(frequency * T) * np.sin(2 * np.pi * frequency * residual.t + 0.3)
    (line,) = lines(residual, FLOOR_NATS)
    assert line.axis == 1
    assert abs(line.frequency - frequency) < 3.5 * line.frequency_std
    assert abs(line.amplitude - amplitude) < 3.5 * line.amplitude_std
