"""Events in the rate residual: slams of the bow, wild samples of the gyros.

A wild sample is a single one off on one axis of the sub-IMU. A slam is, about one axis of the hull, theta = A / w
exp(-d t) sin(w t) from its beginning on; all slams of a log share w and d. Each event has to pay for the choice of its
place, and the search for the choice of w and d; what is found can be taken out, so that it does not stand in the
spectra.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy import fft
from scipy.ndimage import maximum_filter1d
from scipy.optimize import minimize

from physics.units import ARCMIN, DEG
from schemas.diagnosis import Finding, ParameterEstimate, Place
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.diagnose import event_search
from stages.diagnose.candidate import Candidate
from stages.diagnose.event_search import Hit, Record, Shape, Whitener
from stages.diagnose.spectral_data import spectra
from stages.diagnose.spectral_fit import fit_model
from stages.diagnose.spectral_model import Model
from stages.diagnose.spectral_residual import FullRateResidual
from twin import effects
from twin.config import Twin
from twin.effects._parameters import AXES

SURE_NATS = 6.0  # that an event has to be worth beyond the choice of its place
RINGING, FADING = (3.0, 6.0, 11.0, 20.0), (0.3, 1.5)  # rad/s and 1/s of the slams looked for first
RING_S = 12.0  # s of a slam
REFINED_ON = 12  # clearest slams that tell w and d
ROUNDS = 12  # of finding, taking out, and looking again
WITHIN = 0.3  # of the strongest z: weaker events wait for the next round, so that no event's rest is taken for one
SETTLING = 10  # times that w and d are fitted, each slam with the others as they were before
FEW = 0.1  # slams to a wild sample, below which two wild ones side by side may have looked like a slam
NEAR = 3  # samples within which a wild sample and a slam are one event
FARTHEST = np.log([[1.0, 0.05], [60.0, 8.0]])  # of w and d


@dataclass(frozen=True)
class Wild:
    """A wild sample: stamp s since the epoch, axis of the sub-IMU, size rad/s, z."""

    time: float
    axis: int
    size: float
    z: float


@dataclass(frozen=True)
class Slam:
    """time: s since the epoch. amplitude: rad/s, of theta' at first. z."""

    time: float
    amplitude: float
    z: float


@dataclass(frozen=True)
class Found:
    """Events of a log. axis (of m), direction (3,) of it in s-axes, frequency rad/s and damping 1/s of all slams, with
    standard deviations. ship_wide: wild samples that fell on several axes at once, or a lone one."""

    wild: tuple[Wild, ...] = ()
    slams: tuple[Slam, ...] = ()
    axis: int = 0
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    frequency: float = 8.0
    damping: float = 0.5
    frequency_std: float = 0.0
    damping_std: float = 0.0

    @property
    def any(self) -> bool:
        """Whether there are any."""
        return bool(self.wild or self.slams)


def examine(residual: FullRateResidual, twin: Twin) -> tuple[tuple[Candidate, ...], Found]:
    """Candidates for ``slamming`` and ``outliers``, and the events."""
    noise = _whiteners(residual, twin)
    in_s = tuple(_mixed(noise, residual.R_m_s[:, axis] ** 2) for axis in range(3))
    found, left = Found(), residual
    for _ in range(ROUNDS):
        wild, slams, axis, ring = _searched(left, noise, in_s, found)
        if not (wild or slams):
            break
        if wild:
            found = replace(found, wild=(*found.wild, *wild))
        else:
            more = _with_slams(residual, found, slams, axis, ring, noise[axis])
            if len(more.slams) <= len(found.slams):
                break
            found = more
        left = without(residual, found)
    return (_slamming(residual, found), _outliers(residual, found)), found


def without(residual: FullRateResidual, found: Found) -> FullRateResidual:
    """The residual less the events."""
    if not found.any:
        return residual
    rate, T = residual.rate.copy(), residual.interval
    for wild in found.wild:
        rate[round((wild.time - residual.t[0]) / T)] -= wild.size * residual.R_m_s[:, wild.axis]
    shape = ringing(found.frequency, found.damping, T)
    for slam in found.slams:
        part, wave = event_search.rendered(_hit(slam, residual), shape, len(rate), T)
        rate[part, found.axis] -= wave
    return replace(residual, rate=rate)


def remove(trial: Trial, found: Found) -> Trial:
    """The trial with the events taken out of the sub-IMU's gyros. Slams are bending: they stay in the other channels,
    and ``windows`` says when."""
    if not found.any:
        return trial
    t, gyro = trial.seconds(trial.sub.stamp), trial.sub.gyro.copy()
    interval = float(np.median(np.diff(t)))
    for wild in found.wild:
        gyro[int(np.argmin(np.abs(t - wild.time))), wild.axis] -= wild.size
    shape = ringing(found.frequency, found.damping, interval)
    for slam in found.slams:
        hit = slice(*np.searchsorted(t, [slam.time, slam.time + RING_S]))
        gyro[hit] -= np.outer(slam.amplitude * shape(t[hit] - slam.time), found.direction)
    return replace(trial, sub=replace(trial.sub, gyro=gyro))


def windows(found: Found) -> tuple[tuple[float, float], ...]:
    """(begin, end) s since the epoch of every slam until it has faded."""
    length = min(4.0 / found.damping, RING_S)
    return tuple((slam.time, slam.time + length) for slam in found.slams)


def ringing(frequency: float, damping: float, interval: float) -> Shape:
    """Mean rate, over the samples that end at given times since the beginning, of a slam of unit rate at first."""

    def angle(t: FloatArray) -> FloatArray:
        after = np.maximum(t, 0.0)
        return np.asarray(np.exp(-damping * after) * np.sin(frequency * after) / frequency)

    return lambda t: np.asarray((angle(t) - angle(t - interval)) / interval)


def impulse(t: FloatArray) -> FloatArray:
    """One sample."""
    return np.where(np.abs(t) < 1e-9, 1.0, 0.0)


def _whiteners(residual: FullRateResidual, twin: Twin) -> tuple[Whitener, ...]:
    """Noise about the axes of m: the twin's, its nuisances fitted within their tolerance, which no event can leave."""
    data = spectra(residual)
    model = Model.of(twin, data.grid)
    x = model.believed if data.poor else fit_model(data, model, model.believed).x
    frequency = data.grid.frequency
    return tuple(Whitener(frequency, model.spectrum(x, axis, [0.5])[0], residual.interval) for axis in range(3))


def _mixed(noise: tuple[Whitener, ...], share: FloatArray) -> Whitener:
    """Noise about an axis that has a share (3,) of the others' power."""
    return replace(noise[0], power=sum((s * one.power for s, one in zip(share, noise)), np.zeros(len(noise[0].power))))


def _price(residual: FullRateResidual) -> float:
    """Nats that the choice of an event's place costs."""
    return float(np.log(3.0 * len(residual.t)))


def _searched(
    left: FullRateResidual, noise: tuple[Whitener, ...], in_s: tuple[Whitener, ...], found: Found
) -> tuple[list[Wild], list[int], int, tuple[float, float]]:
    """Wild samples; first samples of slams, their axis, their w and d. Where both would fit, the better one stays."""
    T, usable = left.interval, event_search.usable(left.good)
    least = float(np.sqrt(2.0 * (_price(left) + SURE_NATS)))
    measured = np.where(left.good[:, None], left.rate, 0.0)
    wild = [_wild_scores(measured @ left.R_m_s[:, axis], in_s[axis], usable) for axis in range(3)]
    rung = _rung(measured, noise, usable, least, found)
    wild_best = np.max([np.abs(z) for z in wild], axis=0)
    slam_best = np.max([np.abs(z) for z, _ in rung], axis=0)
    reach = 2 * NEAR + 1
    is_wild = maximum_filter1d(wild_best, reach) >= maximum_filter1d(slam_best, reach)
    wild = [np.where(is_wild, z, 0.0) for z in wild]
    rung = [(np.where(is_wild, 0.0, z), ring) for z, ring in rung]
    axis = found.axis if found.slams else int(np.argmax([np.abs(z).max() for z, _ in rung]))
    z, ring = rung[axis]
    highest = max(np.abs(z).max(), *(np.abs(one).max() for one in wild))
    floor = max(least, WITHIN * float(highest))
    if np.abs(z).max() == highest:
        return [], event_search.peaks(z, floor, int(event_search.APART_S / T)), axis, ring
    places = [(k, axis) for axis in range(3) for k in event_search.peaks(wild[axis], floor, NEAR)]
    return [_as_wild(left, measured, k, axis, in_s[axis]) for k, axis in places], [], axis, ring


def _wild_scores(x: FloatArray, noise: Whitener, usable: BoolArray) -> FloatArray:
    record = Record(x, noise, usable, 1)
    return record.scores(np.ones(len(record.weight), dtype=complex))


def _as_wild(left: FullRateResidual, measured: FloatArray, k: int, axis: int, noise: Whitener) -> Wild:
    hit = event_search.fitted(measured @ left.R_m_s[:, axis], k, impulse, noise, exact=True)
    return Wild(float(left.t[k]), axis, hit.size, hit.z)


def _rung(
    measured: FloatArray, noise: tuple[Whitener, ...], usable: BoolArray, least: float, found: Found
) -> list[tuple[FloatArray, tuple[float, float]]]:
    """For each axis z (n,) of the ringing that stands out the most, with its w and d; those of earlier slams if any."""
    T = noise[0].interval
    rings = [(found.frequency, found.damping)] if found.slams else list(product(RINGING, FADING))
    clock = np.asarray(T * np.arange(1, int(RING_S / T)), dtype=float)
    records = [Record(measured[:, axis], noise[axis], usable, len(clock)) for axis in range(3)]
    best: list[tuple[FloatArray, tuple[float, float]]] = [(np.zeros(len(measured)), rings[0])] * 3
    worth = [-1.0] * 3
    for w, d in rings:
        # It begins with a sample or in the middle of one: missed by half a sample, it would look like a wild one.
        starts = [fft.rfft(ringing(w, d, T)(clock - late * T), records[0].padded) for late in (0.0, 0.5)]
        for axis, record in enumerate(records):
            early, late = (record.scores(H) for H in starts)
            z = np.where(np.abs(early) > np.abs(late), early, late)
            gain = float(np.sum(np.maximum(z * z - least**2, 0.0)) + np.abs(z).max())
            if gain > worth[axis]:
                best[axis], worth[axis] = (z, (w, d)), gain
    return best


def _hit(slam: Slam, residual: FullRateResidual) -> Hit:
    return Hit(slam.time - float(residual.t[0]), slam.amplitude, slam.z)


def _with_slams(
    residual: FullRateResidual, found: Found, firsts: list[int], axis: int, ring: tuple[float, float], noise: Whitener
) -> Found:
    """New slams added; w and d fitted to the strongest; every beginning and size fitted again beside the others."""
    T, rows = residual.interval, residual.R_m_s[axis]
    if not found.slams:
        found = replace(found, axis=axis, direction=tuple(rows), frequency=ring[0], damping=ring[1])  # type: ignore[arg-type]
    old = [_hit(slam, residual) for slam in found.slams]
    taken = [hit.time for hit in old] + [wild.time - float(residual.t[0]) for wild in found.wild]
    new = [Hit(k * T, 0.0, 0.0) for k in firsts if all(abs(k * T - time) > event_search.APART_S for time in taken)]
    if not new:
        return found
    clean, hits = without(residual, replace(found, slams=())).rate[:, axis], old + new
    for _ in range(SETTLING):
        before = found.damping
        hits = _again(clean, hits, ringing(found.frequency, found.damping, T), noise)
        found = _sharper(clean, hits, found, noise)
        if abs(found.damping - before) < 0.3 * found.damping_std:
            break
    hits = _again(clean, hits, ringing(found.frequency, found.damping, T), noise)
    if _at_edge(found):
        return replace(found, slams=())
    least = np.sqrt(2.0 * (_price(residual) + SURE_NATS))
    start = float(residual.t[0])
    return replace(found, slams=tuple(Slam(start + hit.time, hit.size, hit.z) for hit in hits if abs(hit.z) > least))


def _at_edge(found: Found) -> bool:
    """Whether w and d have run to where no deck rings."""
    p = np.log([found.frequency, found.damping])
    return bool((np.abs(p - FARTHEST) < 1e-3).any())


def _again(clean: FloatArray, hits: list[Hit], shape: Shape, noise: Whitener) -> list[Hit]:
    """Each event fitted again beside the others, one after the other."""
    left, out = clean.copy(), []
    for hit in hits:
        _add(left, hit, shape, noise.interval, -1.0)
    for hit in hits:
        _add(left, hit, shape, noise.interval, 1.0)
        out.append(event_search.fitted(left, round(hit.time / noise.interval), shape, noise, exact=False))
        _add(left, out[-1], shape, noise.interval, -1.0)
    return out


def _add(x: FloatArray, hit: Hit, shape: Shape, interval: float, sign: float) -> None:
    part, wave = event_search.rendered(hit, shape, len(x), interval)
    x[part] += sign * wave


def _sharper(clean: FloatArray, hits: list[Hit], found: Found, noise: Whitener) -> Found:
    """w and d that explain the strongest events best, with their standard deviations for all of them."""
    T, shape, left = noise.interval, ringing(found.frequency, found.damping, noise.interval), clean.copy()
    for hit in hits:
        _add(left, hit, shape, T, -1.0)
    parts = []
    for hit in _clearest(hits, found):
        _add(left, hit, shape, T, 1.0)
        parts.append(event_search.Window.of(left, hit, noise))
        _add(left, hit, shape, T, -1.0)

    def worth(p: FloatArray) -> float:
        w, d = np.exp(np.clip(p, *FARTHEST))
        tried = ringing(float(w), float(d), T)
        return 0.5 * sum(part.z(tried) ** 2 for part in parts)

    start = np.log([found.frequency, found.damping])
    best = minimize(lambda p: -worth(p), start, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-3}).x
    best = np.clip(best, *FARTHEST)
    std = np.sqrt(np.diag(_covariance(worth, best)) * len(parts) / len(hits))
    w, d = (float(value) for value in np.exp(best))
    return replace(found, frequency=w, damping=d, frequency_std=w * float(std[0]), damping_std=d * float(std[1]))


def _clearest(hits: list[Hit], found: Found) -> list[Hit]:
    """Strong events with the fewest others nearby: what is left of those would be taken for a longer ring."""
    time = np.sort([hit.time for hit in hits])
    room = np.diff(time, prepend=-np.inf, append=np.inf)
    free = {t: min(before, after) for t, before, after in zip(time, room[:-1], room[1:])}
    strong = 0.5 * float(np.median([abs(hit.z) for hit in hits]))
    ring = 2.0 / found.damping
    return sorted((hit for hit in hits if abs(hit.z) >= strong),
                  key=lambda hit: (-min(free[hit.time], ring), -abs(hit.z)))[:REFINED_ON]  # fmt: skip


def _covariance(worth: Callable[[FloatArray], float], p: FloatArray) -> FloatArray:
    h = 0.01 * np.eye(2)
    curvature = np.array([[-(worth(p + a + b) - worth(p + a - b) - worth(p - a + b) + worth(p - a - b)) / 4e-4
                           for b in h] for a in h])  # fmt: skip
    values, vectors = np.linalg.eigh(curvature)
    return np.asarray((vectors / np.maximum(values, 1e-2)) @ vectors.T)


def _slamming(residual: FullRateResidual, found: Found) -> Candidate:
    if not found.slams:
        return Candidate(Finding("slamming", {}, 0.0, advice=effects.get("slamming").advice))
    price, minutes = _price(residual), residual.duration / 60.0
    z = np.array([slam.z for slam in found.slams])
    sizes = np.array([slam.amplitude for slam in found.slams]) / ARCMIN
    spread = np.sqrt(np.mean((sizes / z) ** 2) + (np.var(sizes) if len(z) > 1 else 0.0))
    evidence = float(np.sum(0.5 * z**2 - price) - np.log(len(RINGING) * len(FADING)))
    parameters = {
        "rate": ParameterEstimate(len(z) / minutes, float(np.sqrt(len(z))) / minutes, "1/min"),
        "amplitude": ParameterEstimate(float(sizes.mean()), float(spread / np.sqrt(len(z))), "arcmin/s"),
        "frequency": ParameterEstimate(found.frequency, found.frequency_std, "rad/s"),
        "damping": ParameterEstimate(found.damping, found.damping_std, "1/s"),
        "axis": ParameterEstimate(AXES[found.axis], None, ""),
    }
    band = (found.frequency / (4.0 * np.pi), 0.5 / residual.interval)
    places = _places(windows(found), z, AXES[found.axis], band)
    finding = Finding("slamming", parameters, evidence, places=places, advice=effects.get("slamming").advice)
    few = len(found.slams) < FEW * len(found.wild)
    return Candidate(finding, reason="so few among many wild samples may be two of those side by side" if few else "")


def _outliers(residual: FullRateResidual, found: Found) -> Candidate:
    if not found.wild:
        return Candidate(Finding("outliers", {}, 0.0, advice=effects.get("outliers").advice))
    price, minutes = _price(residual), residual.duration / 60.0
    z = np.array([wild.z for wild in found.wild])
    sizes = np.abs([wild.size for wild in found.wild]) / DEG
    least = float(np.sqrt(2.0 * (price + SURE_NATS)) * np.median(sizes / np.abs(z)))
    size, seen = _untruncated(float(sizes.mean()), least)
    count = len(z) / seen
    parameters = {
        "rate": ParameterEstimate(count / minutes, float(np.sqrt(len(z))) / seen / minutes, "1/min"),
        "size": ParameterEstimate(size, size / float(np.sqrt(12.0 * len(z))), "deg/s"),
    }
    strongest = found.wild[int(np.argmax(np.abs(z)))]
    times = tuple((wild.time - residual.interval, wild.time) for wild in found.wild)
    places = _places(times, z, AXES[strongest.axis], (0.1 / residual.interval, 0.5 / residual.interval))
    finding = Finding("outliers", parameters, float(np.sum(0.5 * z**2 - price)), places=places,
                      advice=effects.get("outliers").advice)  # fmt: skip
    if len({wild.time for wild in found.wild}) > 1:
        return Candidate(finding)
    phrase = "the accelerometers and PHINS, which a step of the mounting turns too"
    finding = replace(finding, ambiguous_with=("misalignment_step",), separated_by=(phrase,))
    return Candidate(finding, reason="a single wild instant may be a step of the mounting")


def _untruncated(mean: float, least: float) -> tuple[float, float]:
    """Mean size, and share seen, of sizes even between half and one and a half of it, seen from ``least`` on."""
    if mean > 2.0 * least:
        return mean, 1.0
    size = (2.0 * mean - least) / 1.5
    if 0.5 * size > least:
        return mean, 1.0
    return size, float(np.clip((1.5 * size - least) / max(size, 1e-12), 0.05, 1.0))


def _places(
    times: tuple[tuple[float, float], ...], z: FloatArray, axis: str, band: tuple[float, float]
) -> tuple[Place, ...]:
    order = np.argsort(-np.abs(z))[:3]
    return tuple(Place("sub.gyro", axis, band, times[k], float(0.5 * z[k] ** 2)) for k in order)
