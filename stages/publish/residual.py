"""Of a diagnosis' residuals, the channels that tell most, and their spectra before and after."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schemas.diagnosis import Spectrum, Trace, Transfer
from schemas.rig import FloatArray
from stages.publish.spectrum import welch

SEGMENTS = 8  # that a record is cut into for its spectrum
SHORTEST, LONGEST = 64, 1024  # samples of a segment


def telling(traces: Sequence[Trace], most: int) -> list[Trace]:
    """So many traces, those first that depart most from the unit variance the twin foretells."""
    usable = [trace for trace in traces if trace.good.any() and len(trace.t) > 1]
    return sorted(usable, key=lambda trace: -float(np.mean(trace.before[trace.good] ** 2)))[:most]


def whitened_spectra(traces: Sequence[Trace]) -> list[Spectrum]:
    """One-sided densities of whitened traces, flat at 2 dt where the twin is right; none of what is too short."""
    return [_spectrum(trace) for trace in traces if len(trace.t) >= SHORTEST]


def transfer_gain(found: Transfer) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gain (k,) with one standard error less and more, all within a factor of hundred of it, for logarithmic axes."""
    low, high = found.gain - found.gain_std, found.gain + found.gain_std
    return found.gain, np.maximum(low, 0.01 * found.gain), np.minimum(high, 100.0 * found.gain)


def _spectrum(trace: Trace) -> Spectrum:
    step = float(np.median(np.diff(trace.t)))
    length = int(np.clip(len(trace.t) // SEGMENTS, SHORTEST, LONGEST))
    known = float(np.mean(trace.good))
    before, after = (welch(_filled(v, trace), 1.0 / step, length) / known for v in (trace.before, trace.after))
    frequency = np.asarray(np.fft.rfftfreq(length, step), dtype=float)
    flat = np.full(len(frequency), 2.0 * step)
    return Spectrum(trace.channel, trace.axis, frequency, before, after, flat, "1/Hz")


def _filled(values: FloatArray, trace: Trace) -> FloatArray:
    """Nothing where the data were masked."""
    return np.where(trace.good & np.isfinite(values), values, 0.0)
