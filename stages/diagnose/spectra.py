"""Covariance effects: what the spectra of the rate residual at full rate say against a twin.

Every effect is tried as if it were the only one beyond those already named: fitted with all nuisances to the odd
segments and scored on the even ones, and the other way round. Where two overlap they are nested: a low-pass of the
gyros and an interpolation of delayed samples by whatever wrote the log both dull the highest frequencies, so that what
else acts there is judged with a low-pass free, whenever the log has one or something like it. Events are to be taken
out before (:mod:`stages.diagnose.events`): one wild sample is enough to bend a spectrum.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from physics.units import ARCMIN, DEG_PER_SQRT_HOUR
from schemas.diagnosis import Finding, ParameterEstimate, Parameters, Place, Spectrum
from schemas.products import BoolArray
from schemas.rig import FloatArray
from stages.diagnose import spectral_lines
from stages.diagnose.candidate import FLOOR_NATS, Candidate
from stages.diagnose.spectral_coupling import NAMES, Coupling, coupling
from stages.diagnose.spectral_data import Spectra, spectra
from stages.diagnose.spectral_fit import Fit, fit_model, held_out, log_likelihood, log_likelihood_by_bin
from stages.diagnose.spectral_lines import Line
from stages.diagnose.spectral_model import FLEXURE, NOISE, NUISANCES, RELEASES, TOLERANCE, Model, Slot, variants
from stages.diagnose.spectral_residual import FullRateResidual, residual
from twin import effects
from twin.config import Twin
from twin.effects._parameters import AXES

__all__ = ["EFFECTS", "FullRateResidual", "JointFit", "examine", "fit", "pictures", "residual"]

DENSITIES = ("second_mode", "nonstationary_sea", "gyro_bandwidth", "gyro_random_walk", "flexure_parameters")
EFFECTS = (*DENSITIES, "axis_coupling", "narrowband_vibration")
NOISES = ("gyro_quantization",)  # found elsewhere, but their noise stands in the spectra
POOR = "too many gaps for a spectrum"
DULL_NATS = 3.0  # in favour of a low-pass, from which on other effects are judged with one free
PLAINLY_NATS = 50.0
LAG_SIGMAS, LAG_SHARE = 4.0, 0.3  # by which the lag of the gyros may miss that of the low-pass
GRID = {1: (16,), 2: (8, 8), 3: (3, 24, 5)}  # starts of a fit, by number of parameters
OCTAVES_FROM_HZ = 0.01


@dataclass(frozen=True)
class JointFit:
    """Several effects together. findings: one for each name, its evidence what leaving it out alone would cost on data
    held out. log_likelihood: held out, of all of them; nominal: of the twin with its nuisances. whole: fit to all."""

    findings: tuple[Finding, ...]
    log_likelihood: float
    nominal: float
    halves: tuple[Fit, Fit]
    whole: Fit
    coupling: Coupling | None
    lines: tuple[Line, ...]


@dataclass(frozen=True)
class _Trial:
    """A model fitted to both halves and to all. spread: of the last parameter, natural log, by how a low-pass is
    made."""

    halves: tuple[Fit, Fit]
    whole: Fit
    score: float
    spread: float = 0.0


def examine(
    residual: FullRateResidual, twin: Twin, named: Collection[str] = (), names: Collection[str] = EFFECTS
) -> tuple[Candidate, ...]:
    """A candidate for every effect of ``names`` that is not named yet, the strongest first.

    named: effects found so far; those that act on spectra are in the model with free parameters. Where gaps leave no
    spectrum nothing can be named, and the reason says so.
    """
    wanted = [name for name in EFFECTS if name in names and name not in named]
    found = spectral_lines.lines(residual, FLOOR_NATS)
    for line in found:
        residual = spectral_lines.without(residual, line)
    data = spectra(residual)
    if data.poor:
        return tuple(Candidate(_nothing(name), reason=POOR) for name in wanted)
    base = _named(data, Model.of(twin, data.grid), named)
    dull = _try(data, base, "gyro_bandwidth") if "gyro_bandwidth" not in named else base
    dulled = dull if dull.whole.log_likelihood - base.whole.log_likelihood > DULL_NATS else None
    out = [_judged(data, base, dulled, name, dull) for name in DENSITIES if name in wanted]
    out = [_with_lag(candidate, residual) for candidate in out]
    if "axis_coupling" in wanted:
        out.append(_coupled(data, dulled or base))
    if "narrowband_vibration" in wanted:
        out.extend([_vibration(line) for line in found] or [Candidate(_nothing("narrowband_vibration"))])
    return tuple(sorted(out, key=lambda candidate: -candidate.finding.evidence_nats))


def fit(residual: FullRateResidual, twin: Twin, names: tuple[str, ...]) -> JointFit:
    """All the effects ``names`` together, and what each is worth beside the others. Names that do not act on spectra
    are left aside."""
    found = spectral_lines.lines(residual, FLOOR_NATS) if "narrowband_vibration" in names else ()
    for line in found:
        residual = spectral_lines.without(residual, line)
    data = spectra(residual)
    nominal, joint = _named(data, Model.of(twin, data.grid), ()), _named(data, Model.of(twin, data.grid), names)
    findings = []
    for name in (name for name in names if name in DENSITIES):
        others = _named(data, Model.of(twin, data.grid), [other for other in names if other != name])
        slot = next((slot for slot in joint.whole.model.slots if slot.name == name), Slot(name))
        findings.append(_finding(data, name, slot, others, joint, joint.score - others.score))
    coupled = coupling(data, joint.halves, joint.whole) if "axis_coupling" in names else None
    findings += [_coupling_finding(coupled)] if coupled else []
    findings += [_vibration(line).finding for line in found[:1]]
    return JointFit(tuple(findings), joint.score, nominal.score, joint.halves, joint.whole, coupled, found)


def flexure(residual: FullRateResidual, twin: Twin, lagging: bool = False) -> FloatArray | None:
    """(3, 3) damping, stiffness (1/s^2) and std (rad) of the axes, one a row, at any distance from the twin's; None
    where gaps leave no spectrum. Segments are too short for slow bending to be in it. lagging: with a low-pass of the
    gyros, which the flexure would be bent to otherwise."""
    data = spectra(residual)
    if data.poor:
        return None
    model = Model.of(twin, data.grid).plus("flexure_parameters")
    fitted = _fitted(data, model, model.believed)
    fitted = _try(data, fitted, "gyro_bandwidth") if lagging else fitted
    return np.exp(fitted.whole.x[FLEXURE]).reshape(3, 3)


def pictures(before: FullRateResidual, after: FullRateResidual, joint: JointFit) -> tuple[Spectrum, ...]:
    """Spectra of the residual, of the residual after compensation, and as the fitted model expects them, one-sided."""
    seen, left = spectra(before), spectra(after)
    scale = 2.0 * before.interval
    out = []
    for axis, letter in enumerate(AXES):
        power = [_mean_power(one, axis) * scale for one in (seen, left)]
        expected = joint.whole.model.spectrum(joint.whole.x, axis, [0.5])[0] * scale
        frequency = seen.grid.frequency
        power = [np.interp(frequency, one.grid.frequency[_counted(one)], values[_counted(one)])
                 for one, values in zip((seen, left), power)]  # fmt: skip
        expected = np.interp(frequency, joint.whole.model.grid.frequency, expected)
        out.append(Spectrum("sub.gyro", letter, frequency, power[0], power[1], expected, "(rad/s)²/Hz"))
    return tuple(out)


def _counted(data: Spectra) -> BoolArray:
    """Bins (k,) that count."""
    return np.asarray(data.count.sum(axis=(0, 1)) > 0.0)


def _mean_power(data: Spectra, axis: int) -> FloatArray:
    weight = data.count / np.maximum(data.count.sum(axis=(0, 1)), 1e-300)
    return np.asarray((data.power[..., axis, axis].real * weight).sum(axis=(0, 1)))


def _fitted(data: Spectra, model: Model, start: FloatArray) -> _Trial:
    """From a start for the nuisances and, where it is shorter than the model, a search for the rest."""

    def one(part: Spectra) -> Fit:
        return fit_model(part, model, _searched(part, model, start))

    halves = one(data.half(0)), one(data.half(1))
    return _Trial(halves, one(data), held_out(data, halves))


def _named(data: Spectra, model: Model, names: Collection[str]) -> _Trial:
    """The twin with all named effects that act on spectra, one after the other."""
    trial = _fitted(data, model, model.believed)
    for name in (*DENSITIES, *NOISES):
        if name in names:
            trial = _try(data, trial, name)
    return trial


def _try(data: Spectra, base: _Trial, name: str) -> _Trial:
    """The best of the variants (axes) of an effect added to a model, by the data they were fitted to."""
    first, *others = variants(name)
    trials = [_fitted(data, base.whole.model.plus(name, first), base.whole.x)]
    forms = name == "gyro_bandwidth"
    if not forms or trials[0].whole.log_likelihood - base.whole.log_likelihood > DULL_NATS:
        trials += [_fitted(data, base.whole.model.plus(name, one), base.whole.x) for one in others]
    best = max(trials, key=lambda trial: trial.whole.log_likelihood)
    made = abs(float(trials[0].whole.x[-1] - trials[1].whole.x[-1])) if forms and len(trials) > 1 else 0.0
    return replace(best, spread=made)


def _searched(data: Spectra, model: Model, start: FloatArray) -> FloatArray:
    """A start (p,) of the model: the best of a grid over the parameters of its last slot, the rest given."""
    missing = len(model.bounds[0]) - len(start)
    if not missing:
        return start
    low, high = model.bounds[:, -missing:]
    lattice = [np.linspace(a, b, n + 2)[1:-1] for a, b, n in zip(low, high, GRID[missing])]
    inside = np.clip(start, model.bounds[0, :-missing], model.bounds[1, :-missing])
    tried = [np.concatenate([inside, point]) for point in product(*lattice)]
    axes = model.slots[-1].axes
    return max(tried, key=lambda x: log_likelihood(data, model, x, axes))


def _judged(data: Spectra, base: _Trial, dulled: _Trial | None, name: str, dull: _Trial) -> Candidate:
    """An effect against the base; where the log is dulled, against a base with a low-pass too: the less counts, and
    that alone where the log is plainly dulled."""
    if name == "gyro_bandwidth":
        compared = [(dull, base)]
    elif dulled is None:
        compared = [(_try(data, base, name), base)]
    else:
        plainly = dulled.whole.log_likelihood - base.whole.log_likelihood > PLAINLY_NATS
        compared = [(_try(data, one, name), one) for one in ([dulled] if plainly else [base, dulled])]
    trial, against = min(compared, key=lambda pair: pair[0].score - pair[1].score)
    evidence = trial.score - against.score
    slot = next((slot for slot in trial.whole.model.slots if slot.name == name), Slot(name))
    finding = _finding(data, name, slot, against, trial, evidence)
    return Candidate(finding, FLOOR_NATS, _within(name, trial))


def _within(name: str, trial: _Trial) -> str:
    """Why a nuisance that is released all the same need not be told."""
    if name not in RELEASES:
        return ""
    part = RELEASES[name]
    off = np.abs(trial.whole.x[part] - trial.whole.model.believed[part])
    return "" if (off > TOLERANCE[part]).any() else "within the tolerance of the twin's values"


def _with_lag(candidate: Candidate, residual: FullRateResidual) -> Candidate:
    """A low-pass of the gyros delays them by 1 / (2 pi cutoff); with another lag it was interpolation that dulled."""
    if candidate.finding.name != "gyro_bandwidth":
        return candidate
    cutoff = candidate.finding.parameters["cutoff"]
    assert isinstance(cutoff, ParameterEstimate)
    assert isinstance(cutoff.value, float)
    expected = 1.0 / (2.0 * np.pi * cutoff.value)
    if abs(residual.lag - expected) < LAG_SIGMAS * residual.lag_std + LAG_SHARE * expected:
        return candidate
    told = (
        f"the gyros lag by {1e3 * residual.lag:.2f} ms and a low-pass of {cutoff.value:.0f} Hz by "
        f"{1e3 * expected:.2f} ms: the samples may have been interpolated"
    )
    return Candidate(candidate.finding, candidate.threshold_nats, told)


def _finding(data: Spectra, name: str, slot: Slot, base: _Trial, trial: _Trial, evidence: float) -> Finding:
    parameters = _released(name, trial.whole) if name in RELEASES else _slot_parameters(slot, trial)
    return Finding(name, parameters, float(evidence), places=_places(data, base.whole, trial.whole),
                   advice=effects.get(name).advice)  # fmt: skip


def _slot_parameters(slot: Slot, trial: _Trial) -> Parameters:
    """Values and standard deviations; of a low-pass with what the ways to make one differ by."""
    first, fitted = NUISANCES, trial.whole
    for other in fitted.model.slots:
        if other == slot:
            break
        first += len(other.parameters)
    x, std = fitted.x[first:], np.hypot(fitted.std()[first:], trial.spread if slot.name == "gyro_bandwidth" else 0.0)
    units = {item.name: item.unit for item in slot.effect.parameters()}
    out = {
        name: ParameterEstimate(float(np.exp(value)), float(np.exp(value) * spread), units[name])
        for name, value, spread in zip(slot.parameters, x, std)
    }
    if slot.axis:
        out["axis"] = ParameterEstimate(slot.axis, None, "")
    return out


def _released(name: str, fitted: Fit) -> Parameters:
    x, std = fitted.x, fitted.std()
    if name == "gyro_random_walk":
        arw = float(np.exp(x[NOISE])) / DEG_PER_SQRT_HOUR
        return {"arw": ParameterEstimate(arw, arw * float(std[NOISE]), "deg/sqrt(h)")}
    damping, stiffness, sigma = np.exp(x[:3]), np.exp(x[3:6]), np.exp(x[6:9]) / ARCMIN
    frequency = np.sqrt(np.maximum(stiffness - damping**2, 0.0))
    return {
        "damping": _vector(damping, damping * std[:3], "1/s"),
        "frequency": _vector(frequency, _frequency_std(fitted), "rad/s"),
        "std_arcmin": _vector(sigma, sigma * std[6:9], "arcmin"),
    }


def _frequency_std(fitted: Fit) -> FloatArray:
    """lambda^2 = b^2 - mu^2; near zero the square's own uncertainty is what can be told."""
    damping, stiffness = np.exp(fitted.x[:3]), np.exp(fitted.x[3:6])
    out = np.zeros(3)
    for axis in range(3):
        part = fitted.covariance[np.ix_([axis, 3 + axis], [axis, 3 + axis])]
        slope = np.array([-2.0 * damping[axis] ** 2, stiffness[axis]])
        spread = float(np.sqrt(max(slope @ part @ slope, 0.0)))
        squared = max(stiffness[axis] - damping[axis] ** 2, 0.0)
        out[axis] = spread / (2.0 * np.sqrt(squared)) if squared > spread else np.sqrt(squared + spread)
    return out


def _vector(value: FloatArray, std: FloatArray, unit: str) -> dict[str, ParameterEstimate]:
    return {axis: ParameterEstimate(float(v), float(s), unit) for axis, v, s in zip(AXES, value, std)}


def _places(data: Spectra, base: Fit, better: Fit) -> tuple[Place, ...]:
    """Axes and octaves in which the fit gains, the strongest first."""
    frequency, out = data.grid.frequency, []
    octave = np.floor(np.log2(frequency / OCTAVES_FROM_HZ)).astype(int)
    for axis, letter in enumerate(AXES):
        gain = log_likelihood_by_bin(data, better, axis) - log_likelihood_by_bin(data, base, axis)
        for one in np.unique(octave):
            low = OCTAVES_FROM_HZ * 2.0**one
            out.append(Place("sub.gyro", letter, (low, 2.0 * low), None, float(gain[octave == one].sum())))
    out = sorted((place for place in out if place.score > 1.0), key=lambda place: -place.score)
    return tuple(out[:6])


def _coupled(data: Spectra, base: _Trial) -> Candidate:
    return Candidate(_coupling_finding(coupling(data, base.halves, base.whole)))


def _coupling_finding(found: Coupling) -> Finding:
    parameters = {
        name: ParameterEstimate(float(rho), float(std), "") for name, rho, std in zip(NAMES, found.rho, found.std)
    }
    strength = np.abs(found.rho) / np.maximum(found.std, 1e-12)
    places = tuple(
        Place("sub.gyro", axis, (0.02, 50.0), None, float(0.5 * strength[pair] ** 2))
        for pair in np.argsort(-strength)[:1]
        for axis in NAMES[pair]
    )
    return Finding("axis_coupling", parameters, found.evidence_nats, places=places,
                   advice=effects.get("axis_coupling").advice)  # fmt: skip


def _vibration(line: Line) -> Candidate:
    parameters: dict[str, ParameterEstimate] = {
        "frequency": ParameterEstimate(line.frequency, line.frequency_std, "Hz"),
        "amplitude": ParameterEstimate(line.amplitude, line.amplitude_std, "deg/s"),
        "axis": ParameterEstimate(AXES[line.axis], None, ""),
    }
    band = (line.frequency / 2.0**0.5, line.frequency * 2.0**0.5)
    place = Place("sub.gyro", AXES[line.axis], band, None, line.evidence_nats)
    advice = effects.get("narrowband_vibration").advice
    return Candidate(Finding("narrowband_vibration", parameters, line.evidence_nats, places=(place,), advice=advice))


def _nothing(name: str) -> Finding:
    return Finding(name, {}, 0.0, advice=effects.get(name).advice)
