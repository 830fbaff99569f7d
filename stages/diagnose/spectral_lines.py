"""Lines of a vibration in the rate residual: one frequency, one phase from beginning to end.

    d(t) = A sin(2 pi f t + p) about one axis of the sub-IMU; log-likelihood ratio |X(f)|^2 / (n S(f))

X is the transform of the whole record, S the spectrum around f. Amplitude and phase found in the odd blocks have to
foretell the even ones and the other way round, so that a lightly damped mode, whose phase wanders, is no line; the
search over frequencies and axes is paid for by the logarithm of their number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import fft
from scipy.optimize import minimize_scalar

from physics.units import DEG
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import IntArray
from stages.diagnose.spectral_data import ComplexArray
from stages.diagnose.spectral_residual import FullRateResidual

LOWEST_HZ = 0.6  # below it the ship's own motion has its lines
HIGHEST = 0.495  # of the sample rate
BLOCK_S = 20.0  # s of the odd and even blocks
AROUND_HZ = 0.4  # from where on the spectrum around a line is taken
BROAD, NARROW, SHARE = 255, 63, 0.25  # ordinates over which it is: at most, at least, and as a share of the frequency
MEDIAN = np.log(2.0)  # of an exponential variable of mean one
PADDING = 2
MOST = 6  # lines looked for


@dataclass(frozen=True)
class Line:
    """frequency: Hz. amplitude: deg/s of the rate before it was averaged over samples. axis: of the sub-IMU. phase: rad
    at the record's first sample. evidence_nats: on blocks held out, less the search."""

    frequency: float
    amplitude: float
    axis: int
    phase: float
    frequency_std: float
    amplitude_std: float
    evidence_nats: float


def lines(residual: FullRateResidual, least_nats: float) -> tuple[Line, ...]:
    """Lines with at least that much evidence, the strongest first."""
    found: list[Line] = []
    for _ in range(MOST):
        line = strongest(residual)
        if line is None or line.evidence_nats < least_nats:
            break
        found.append(line)
        residual = without(residual, line)
    return tuple(found)


def without(residual: FullRateResidual, line: Line) -> FullRateResidual:
    """The residual less a line."""
    size = line.amplitude * DEG * np.sinc(line.frequency * residual.interval)
    wave = size * np.sin(2.0 * np.pi * line.frequency * residual.interval * np.arange(len(residual.t)) + line.phase)
    return replace(residual, rate=residual.rate - wave[:, None] * residual.R_m_s[:, line.axis])


def strongest(residual: FullRateResidual) -> Line | None:
    """The line with the largest likelihood ratio, None where the record has no room for one."""
    n, T = len(residual.t), residual.interval
    padded = fft.next_fast_len(PADDING * n, real=True)
    frequency = fft.rfftfreq(padded, T)
    band = np.flatnonzero((frequency > LOWEST_HZ) & (frequency < HIGHEST / T))
    if len(band) < 4 * BROAD:
        return None
    rate = np.where(residual.good[:, None], residual.rate @ residual.R_m_s, 0.0)
    seen = np.flatnonzero((frequency > AROUND_HZ) & (frequency < HIGHEST / T))
    best = max((_peak(rate[:, axis], padded, band, seen, axis) for axis in range(3)), key=lambda found: found[0])
    _, index, axis, around = best
    return _refined(rate[:, axis], residual.good, T, frequency[index], axis, around, 3 * len(band) // PADDING)


def _peak(x: FloatArray, padded: int, band: IntArray, seen: IntArray, axis: int) -> tuple[float, int, int, float]:
    """Largest |X|^2 / (n S) of the band, its ordinate, the axis, and S there. seen: ordinates that S is taken from."""
    power = np.abs(fft.rfft(x, padded)[seen]) ** 2 / len(x)
    around = _around(power, seen)[-len(band) :]
    ratio = power[-len(band) :] / around
    top = int(np.argmax(ratio))
    return float(ratio[top]), int(band[top]), axis, float(around[top])


def _around(power: FloatArray, ordinate: IntArray) -> FloatArray:
    """Spectrum without lines: medians over blocks of ordinates, joined in logarithms.

    The flexure's spectrum is steep at low frequencies, where blocks as wide as higher up would lie far below it.
    """
    edges = [int(ordinate[0])]
    while edges[-1] <= ordinate[-1]:
        edges.append(edges[-1] + int(np.clip(SHARE * edges[-1], NARROW, BROAD)))
    edges = edges[:-1] if len(edges) > 2 else edges  # what is left at the end is no block
    blocks = [power[a - ordinate[0] : b - ordinate[0]] for a, b in pairwise(edges)]
    medians = np.array([np.median(block) for block in blocks]) / MEDIAN
    centres = 0.5 * (np.array(edges[1:]) + edges[:-1] - 1)
    return np.asarray(np.exp(np.interp(ordinate, centres, np.log(np.maximum(medians, 1e-300)))))


def _refined(x: FloatArray, good: BoolArray, T: float, frequency: float, axis: int, around: float, places: int) -> Line:
    n, clock = len(x), np.arange(len(x))
    # One transform near the peak, of the record brought down to zero frequency and averaged, serves every refinement.
    every = max(1, int(0.5 / T))
    whole = n // every * every
    down = x[:whole] * np.exp(-2j * np.pi * frequency * T * clock[:whole])
    slow = down.reshape(-1, every).sum(axis=1)
    at = T * (every * np.arange(len(slow)) + 0.5 * (every - 1))

    def sums(shift: float) -> ComplexArray:
        return np.asarray(slow * np.exp(-2j * np.pi * shift * at))

    width = 1.0 / (PADDING * n * T)
    shift = minimize_scalar(lambda d: -abs(sums(d).sum()), bounds=(-width, width), method="bounded").x
    parts = sums(shift)
    measured = float(good.sum())
    total = parts.sum() * 2.0 / measured
    odd = (at // BLOCK_S).astype(int) % 2 == 1
    halves = [2.0 * parts[odd].sum() / max(good[:whole].reshape(-1, every)[odd].sum(), 1.0),
              2.0 * parts[~odd].sum() / max(good[:whole].reshape(-1, every)[~odd].sum(), 1.0)]  # fmt: skip
    # Half the samples each: n/2 of |a|^2 / (4 S) nats
    gain = sum(abs(b) ** 2 - abs(b - a) ** 2 for a, b in (halves, halves[::-1])) * measured / 8.0 / around
    std = float(np.sqrt(2.0 * around / measured))
    frequency += float(shift)
    keep = np.sinc(frequency * T)
    amplitude = float(abs(total))
    frequency_std = np.sqrt(6.0) / np.pi / (n * T) * std / max(amplitude, 1e-300)
    return Line(
        frequency, amplitude / keep / DEG, axis, float(np.angle(total) + 0.5 * np.pi), float(frequency_std),
        std / keep / DEG, float(gain - np.log(places)),
    )  # fmt: skip
