"""What people look at: whitened residuals in time, and where in channel, band and time the gap lies."""

from __future__ import annotations

import numpy as np

from schemas.diagnosis import Localisation, Trace
from schemas.rig import FloatArray
from stages.diagnose.evidence import combined, solve
from stages.diagnose.selection import Selection
from stages.diagnose.whitening import CHANNELS

MAIN_PHINS = "phins_main.attitude"
MOTION_HZ = (0.03, 0.5)  # where ships move
BLOCKS = 24  # of the localisation map
LOWEST_HZ = 0.01


def residuals(chosen: Selection) -> tuple[FloatArray, FloatArray]:
    """(N, m) whitened: as the twin alone leaves the log, and as the picks leave it, nuisances fitted in both."""
    columns, values = chosen.regressors.columns, chosen.values
    impulse = [k for k, name in enumerate(chosen.regressors.nuisances) if name.startswith("impulse")]
    kept = [*chosen.explained, *impulse]
    G = chosen.regressors.gram
    after = values - combined(columns, kept, solve(G.total, G.precision, kept).value)
    base = chosen.nuisances
    restored = values + chosen.taken
    before = restored - combined(columns, base, solve(chosen.gram.total, chosen.gram.precision, base).value)
    return before, after


def channels(chosen: Selection) -> tuple[str, ...]:
    """Of three innovations each: those of the pair, then the main PHINS's own."""
    return (*CHANNELS[: chosen.base.whitened.values.shape[1] // 3], MAIN_PHINS)


def traces(chosen: Selection) -> tuple[Trace, ...]:
    """Every channel and axis in time."""
    before, after = residuals(chosen)
    taken, names = chosen.taken, channels(chosen)
    out = []
    for k in range(before.shape[1]):
        good = np.isfinite(after[:, k])
        out.append(Trace(names[k // 3], "xyz"[k % 3], chosen.base.t, before[:, k], after[:, k], taken[:, k], good))
    return tuple(out)


def localisation(chosen: Selection) -> Localisation:
    """Nats of deficit of the twin alone, per channel, octave and block: 1/2 (power - 1 - ln power) per ordinate."""
    before, _ = residuals(chosen)
    t = chosen.base.t
    step = float(np.median(np.diff(t)))
    count = int(np.clip((t[-1] - t[0]) / 30.0, 2, BLOCKS))
    edges = np.linspace(t[0], t[-1], count + 1)
    bounds = np.searchsorted(t, edges)
    bounds[-1] = len(t)
    top = 0.5 / step
    octaves = top * 2.0 ** -np.arange(int(np.log2(top / LOWEST_HZ)) + 1)[::-1]
    bands = np.stack([np.concatenate([[0.0], octaves[:-1]]), octaves], axis=1)
    score = np.zeros((before.shape[1], len(bands), count))
    for b in range(count):
        part = np.nan_to_num(before[bounds[b] : bounds[b + 1]])
        power = 2.0 * np.abs(np.fft.rfft(part, axis=0)) ** 2 / max(len(part), 1)
        frequency = np.fft.rfftfreq(len(part), step)
        for j, (low, high) in enumerate(bands):
            inside = (frequency >= low) & (frequency <= high)
            n = inside.sum()
            if n:
                mean = np.maximum(power[inside].mean(axis=0) / 2.0, 1e-6)
                score[:, j, b] = np.maximum(n * (mean - 1.0 - np.log(mean)) - 1.0, 0.0)
    names = tuple(f"{channel} {axis}" for channel in channels(chosen) for axis in "xyz")[: before.shape[1]]
    return Localisation(names, bands, edges, score)


def band_of(signal: FloatArray, t: FloatArray) -> tuple[float, float]:
    """The octave about the frequency at which a whitened signal (N, m) has most power."""
    step = float(np.median(np.diff(t)))
    power = (np.abs(np.fft.rfft(np.nan_to_num(signal), axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(signal), step)
    smooth = np.convolve(power, np.ones(5), "same")
    peak = float(max(frequency[int(np.argmax(smooth[1:])) + 1], frequency[1]))
    return (float(peak / np.sqrt(2.0)), float(peak * np.sqrt(2.0)))
