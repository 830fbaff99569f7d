"""The diagnosis of one log against its twin: direct checks, events, mean effects, spectra, what is left, the verdict.

Each class of checks works on what the ones before it have cleaned: stamps and values are repaired, wild samples taken
out, mean effects named one after the other and compensated, and the spectra are those of what is left. Evidence is in
held-out nats throughout, so that the classes compete; a name is given only where the model is enough for it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from physics.rotations import exp
from physics.units import ARCMIN
from schemas.diagnosis import Diagnosis, Errors, Finding, ParameterEstimate, Place, Tested, Transfer, Verdict
from schemas.errors import DataError
from schemas.products import Alignment
from schemas.trial import Trial
from stages.align import align
from stages.diagnose import direct, events, goodness, pictures, shrinkage, slow, spectra, spectral_residual, transfer
from stages.diagnose.candidate import FLOOR_NATS, Candidate
from stages.diagnose.ceiling import HARMONICS, SLOW_BENDING, Family, families
from stages.diagnose.findings import as_effect, of_pick, of_wander
from stages.diagnose.gap import comparisons, gap_of
from stages.diagnose.goodness import Excess
from stages.diagnose.judgement import LEFT_NATS, Abstention, halves_agree, judged, named_of
from stages.diagnose.regressors import view_of
from stages.diagnose.selection import Selection, against_free_flexure, select
from stages.diagnose.spectra import FullRateResidual, JointFit
from stages.diagnose.stated import news
from stages.diagnose.view import believed, without_dead_forces
from twin import effects, world
from twin.compensation import compensate
from twin.config import Twin
from twin.effects import Effect

SHORTEST_S = 60.0
SLACK_S = 1.0  # by which a record of that length may fall short: n samples span n - 1 intervals
STILL = 2e-5  # rad/s rms of one-second means of the main IMU's rates, below which a ship does not move
ALIKE_SHARE = 0.9  # of an effect's energy that a look-alike explains
ASTRAY = 1.0 * ARCMIN  # rad, of the sub-IMU's axes and scale, one sigma, once the named effects are taken out
MOST_SPECTRAL = 3  # spectral effects named in one log

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Evidence:
    """All that was found before anything is judged. nameless: found in stamps, values or as events, repaired or cut
    out, and none of the effects that may be named."""

    checks: direct.DirectChecks
    chosen: Selection
    candidates: tuple[Candidate, ...]
    found: events.Found
    before: FullRateResidual
    residual: FullRateResidual
    joint: JointFit
    ceiling: tuple[Family, ...]
    excess: Excess
    findings: tuple[Finding, ...]
    nameless: tuple[Finding, ...]

    @property
    def left(self) -> float:
        """Nats of what no effect explains."""
        families = max(0.0, float(self.ceiling[0].gain.sum()) if self.ceiling else 0.0)
        return families + max(0.0, self.excess.total) + sum(finding.evidence_nats for finding in self.nameless)


def diagnose(
    trial: Trial,
    twin: Twin,
    rng: np.random.Generator,
    shrink: bool,
    library: Collection[str] | None,
    progress: Progress | None,
) -> Diagnosis:
    """The diagnosis of a record that can be held whole, as :func:`stages.diagnose.sections.diagnose` says.

    Raises DataError where the log cannot be compared with the twin.
    """
    say = progress or (lambda step: None)
    names = tuple(effects.names()) if library is None else tuple(library)
    _comparable(trial, twin)
    log = trial.source or "log"
    trial, twin_bare = _without_known(without_dead_forces(trial), twin)
    evidence = _gathered(trial, twin_bare, names, rng, say)
    found, certain = (news(findings, twin) for findings in (evidence.findings, evidence.checks.findings))
    verdict = judged(
        sum(f.evidence_nats for f in found), evidence.left, halves_agree(evidence.chosen), bool(found)
    )  # fmt: skip
    said, named = named_of(verdict, found, certain)
    verdict = replace(verdict, verdict=said)
    built = [as_effect(finding) for finding in named]
    say("shrinkage")
    rmse = _errors(trial, twin_bare, built, rng) if shrink else None
    return _written(log, twin, evidence, verdict, named, built, rmse, rng)


def _comparable(trial: Trial, twin: Twin) -> None:
    if trial.duration < SHORTEST_S - SLACK_S:
        raise DataError(f"the log holds {trial.duration:.1f} s; a diagnosis needs {SHORTEST_S:.0f} s")
    rate = 1e9 / float(np.median(np.diff(trial.main.stamp)))
    if not 0.8 < rate / twin.run.rate < 1.25:
        raise DataError(f"the twin '{twin.name}' runs at {twin.run.rate:g} Hz, the main IMU of the log at {rate:g} Hz")
    moved = _motion(trial)
    if moved < STILL:
        raise DataError(
            f"the ship lies still (rates of the main IMU vary by {np.degrees(moved):.1e} deg/s rms): "
            "without motion no effect can show"
        )


def _motion(trial: Trial) -> float:
    """rad/s rms of one-second means of the main IMU's rates about their mean, the liveliest axis; 0 without any."""
    gyro = trial.main.gyro[np.isfinite(trial.main.gyro).all(axis=1)]
    count = len(gyro) // max(1, round(len(trial.main) / trial.duration))
    if count < 2:
        return 0.0
    means = [part.mean(axis=0) for part in np.array_split(gyro, count)]
    return float(np.std(means, axis=0).max())


def _unstated(twin: Twin) -> tuple[str, ...]:
    """What the twin leaves to the defaults, which are no ship's in particular."""
    missing = [name for name in ("mount", "flexure", "imu") if name not in twin.model_fields_set]
    if not missing:
        return ()
    tables = ", ".join(f"[{name}]" for name in missing)
    return (f"the twin says nothing of {tables}: the defaults were believed, and a gap may be theirs",)


def _without_known(trial: Trial, twin: Twin) -> tuple[Trial, Twin]:
    """The twin as the effects that it knows of change it, and the log without those that act on samples."""
    if not twin.effect:
        return trial, twin
    known, changed = world.built(twin)
    bare = changed.model_copy(update={"effect": ()})
    return compensate(trial, [effect for effect in known if type(effect).twin is Effect.twin], bare).trial, bare


def _gathered(trial: Trial, twin: Twin, names: tuple[str, ...], rng: np.random.Generator, say: Progress) -> Evidence:
    say("direct checks")
    checks = direct.check(trial, twin)
    nameless = [f for f in checks.findings if f.name not in names]
    checks = replace(checks, findings=tuple(f for f in checks.findings if f.name in names))
    work = checks.masked
    coarse = align(believed(work, twin).trial)
    before = spectra.residual(work, coarse, twin)
    say("events")
    wild, found = events.examine(before, twin)
    calm = events.remove(work, _surely_wild(wild, found))
    low_pass, humming = _before_mean_effects(events.without(before, found), twin, names)
    early = [as_effect(finding) for finding in (*low_pass, *humming)]
    sharp = compensate(calm, early, twin).trial if early else calm
    say("mean effects")
    seen = spectra.flexure(events.without(before, found), twin, bool(low_pass))
    chosen = select(sharp, twin, coarse, rng, names, bool(low_pass), seen)
    say("spectra")
    aligned = _aligned(chosen, coarse)
    clean = chosen.clean
    if early:  # spectra tell a cutoff and a line best as they were recorded
        clean = compensate(calm, [pick.effect for pick in chosen.picks], twin).trial
        clean = chosen.wandering.taken_from(clean) if chosen.wandering else clean
    whole = spectra.residual(clean, aligned, twin, ASTRAY)
    slams, found = events.examine(whole, twin)
    residual = _linear(events.without(whole, found), chosen)
    known = tuple(finding.name for finding in checks.findings if finding.name in spectra.NOISES)
    first = tuple(finding.name for finding in low_pass)
    spectral, joint = _spectral(residual, twin, _not_alike(chosen, names), known, first)
    # Wild samples were taken out before the mean effects; slams show best once those are gone too.
    timed = [c for c in wild if c.finding.name == "outliers"] + [c for c in slams if c.finding.name == "slamming"]
    nameless += [c.finding for c in timed if c.named and c.finding.name not in names]
    candidates = (*(c for c in timed if c.finding.name in names), *spectral)
    say("what is left")
    ceiling = families(
        chosen.base,
        view_of(chosen.base),
        chosen.regressors.gram,
        chosen.regressors.columns,
        chosen.steady,
        chosen.without_events,
    )
    ceiling = tuple(sorted((_doubted(family, chosen) for family in ceiling), key=lambda family: -family.gain.sum()))
    excess = _excess(residual, twin, joint, spectral, known, "axis_coupling" not in names)
    findings = _findings(checks, chosen, candidates, joint)
    return Evidence(
        checks, chosen, candidates, found, before, residual, joint, ceiling, excess, findings, tuple(nameless)
    )


def _doubted(family: Family, chosen: Selection) -> Family:
    """Slow bending that flexure of other parameters explains as well is none."""
    told = float(family.gain.sum())
    if family.name != SLOW_BENDING or told < LEFT_NATS:
        return family
    waves = slow.waves(view_of(chosen.base).t, HARMONICS)
    nats = against_free_flexure(chosen.base, chosen.picks, waves, 3 * waves.shape[1])
    return replace(family, gain=family.gain * min(1.0, max(nats, 0.0) / told))


def _linear(residual: FullRateResidual, chosen: Selection) -> FullRateResidual:
    """The residual of the deck that stiffens as if it did not: what stays in the log would bend the spectra.

    About the angle that the regression sees: the residual's own has what is left of the ship's turns in it.
    """
    bent = next((pick for pick in chosen.picks if pick.group.deck is not None), None)
    if bent is None or bent.group.deck is None:
        return residual
    view = view_of(chosen.base)
    theta = np.stack([np.interp(residual.t, view.t, column) for column in view.theta.T], axis=1)
    return spectral_residual.linear(
        replace(residual, theta=theta), float(bent.value[0]) / ARCMIN**2, bent.group.deck.found
    )


def _before_mean_effects(
    residual: FullRateResidual, twin: Twin, names: tuple[str, ...]
) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:
    """What is taken out before mean effects are looked for: a low-pass of the gyros, whose lag would pass for a delay,
    and a vibration, which would make their noise larger."""
    early = [name for name in ("gyro_bandwidth", "narrowband_vibration") if name in names]
    named = [c.finding for c in spectra.examine(residual, twin, names=early) if c.named] if early else []
    humming = tuple(finding for finding in named if finding.name != "gyro_bandwidth")
    if len(humming) == len(named):
        return (), humming
    # Its cutoff is right only beside what else bends the spectra.
    _, joint = _spectral(residual, twin, names, (), ("gyro_bandwidth",))
    return tuple(finding for finding in joint.findings if finding.name == "gyro_bandwidth"), humming


def _surely_wild(candidates: tuple[Candidate, ...], found: events.Found) -> events.Found:
    """Wild samples to be taken out: not a single instant, which may be a step of the mounting, for the regression."""
    sure = any(c.finding.name == "outliers" and not c.reason for c in candidates)
    return replace(found, slams=(), wild=found.wild if sure else ())


def _aligned(chosen: Selection, coarse: Alignment) -> Alignment:
    """The alignment of the log without the picks: the twin's own."""
    static = chosen.base.source.static
    delay = replace(coarse.time_delay, value=np.array(chosen.base.source.twin.mount.time_delay))
    return replace(coarse, rotation=exp(static), static=replace(coarse.static, value=static), time_delay=delay)


def _not_alike(chosen: Selection, names: tuple[str, ...]) -> tuple[str, ...]:
    """The library without what no log can tell from the effects that are named already."""
    alike = {
        other.name
        for pick in chosen.picks
        for other in effects.look_alikes(pick.group.effect, ())
        if other.share is None or other.share >= ALIKE_SHARE
    }
    return tuple(name for name in names if name not in alike)


def _spectral(
    residual: FullRateResidual, twin: Twin, names: tuple[str, ...], known: tuple[str, ...], first: tuple[str, ...]
) -> tuple[tuple[Candidate, ...], JointFit]:
    """Candidates as each would be alone, and the joint fit of those that stand beside each other.

    known: effects found by the direct checks, whose noise stands in the spectra. first: those that are named already.
    """
    now = alone = spectra.examine(residual, twin, known, names)
    named = list(first)
    if named:
        now = spectra.examine(residual, twin, (*known, *named), names)
    while len(named) < MOST_SPECTRAL:
        best = max((c for c in now if c.named), key=lambda c: c.finding.evidence_nats, default=None)
        if best is None:
            break
        named.append(best.finding.name)
        now = spectra.examine(residual, twin, (*known, *named), names)
    joint = spectra.fit(residual, twin, (*known, *named))
    while named and (weak := [f.name for f in joint.findings if f.evidence_nats < 0.8 * FLOOR_NATS]):
        named.remove(weak[-1])
        joint = spectra.fit(residual, twin, (*known, *named))
    return alone, joint


def _excess(
    residual: FullRateResidual, twin: Twin, joint: JointFit, spectral: tuple[Candidate, ...], known: tuple[str, ...],
    cross: bool,
) -> Excess:  # fmt: skip
    """What the spectra leave; a log that was dulled by whatever wrote it or interpolated it, and not by the gyros, is
    no gap."""
    named = tuple(finding.name for finding in joint.findings)
    dulled = residual.interpolated or any(
        c.finding.name == "gyro_bandwidth" and c.reason and c.finding.evidence_nats > 0.0 for c in spectral
    )
    if dulled and "gyro_bandwidth" not in named:
        joint = spectra.fit(residual, twin, (*known, *named, "gyro_bandwidth"))
    return goodness.excess(goodness.data_of(residual, joint), joint, cross)


def _findings(
    checks: direct.DirectChecks, chosen: Selection, candidates: tuple[Candidate, ...], joint: JointFit
) -> tuple[Finding, ...]:
    out = [*checks.findings, *(of_pick(chosen, pick) for pick in chosen.picks)]
    if chosen.wandering is not None:
        out.append(of_wander(chosen.wandering))
    out += [c.finding for c in candidates if c.named and c.finding.name not in spectra.EFFECTS]
    out += [finding for finding in joint.findings if not _of_the_mode(finding, joint)]
    return tuple(sorted(out, key=lambda finding: -finding.evidence_nats))


def _of_the_mode(finding: Finding, joint: JointFit) -> bool:
    """A line within the width of a second mode that was found about the same axis is that mode's own peak."""
    mode = next((other for other in joint.findings if other.name == "second_mode"), None)
    if finding.name != "narrowband_vibration" or mode is None:
        return False
    if _number(mode, "axis") != _number(finding, "axis"):
        return False
    frequency, damping = float(_number(mode, "frequency")), float(_number(mode, "damping"))
    return abs(2.0 * np.pi * float(_number(finding, "frequency")) - frequency) < 3.0 * damping


def _number(finding: Finding, name: str) -> float | str:
    value = finding.parameters[name]
    assert isinstance(value, ParameterEstimate)
    return value.value


def _errors(trial: Trial, twin: Twin, built: list[Effect], rng: np.random.Generator) -> Errors | None:
    try:
        return shrinkage.errors(trial, twin, built, rng=rng)
    except DataError:
        return None


def _written(
    log: str, twin: Twin, evidence: Evidence, verdict: Abstention, named: tuple[Finding, ...], built: list[Effect],
    rmse: Errors | None, rng: np.random.Generator,
) -> Diagnosis:  # fmt: skip
    chosen = evidence.chosen
    left = _places_left(evidence) if verdict.verdict in (Verdict.UNKNOWN_EFFECT, Verdict.PARTLY_EXPLAINED) else ()
    where = sorted((*(place for f in named for place in f.places[:1]), *left), key=lambda place: -place.score)
    untestable = {**chosen.regressors.untestable, **evidence.checks.untestable}
    return Diagnosis(
        log=log,
        twin=twin.name,
        verdict=verdict.verdict,
        where=tuple(where),
        effects=named,
        gap=gap_of(chosen, named, evidence.left, rng),
        augmented_twin=shrinkage.augmented_twin(twin, built),
        advice=_advice(evidence, verdict, named),
        rmse=rmse,
        tested=_tested(evidence, named, verdict),
        untestable=untestable,
        comparisons=comparisons(chosen, named, evidence.left, rng),
        spectra=spectra.pictures(evidence.before, evidence.residual, evidence.joint),
        localisation=pictures.localisation(chosen),
        traces=pictures.traces(chosen),
        notes=(*_unstated(twin), *evidence.checks.notes),
        duration_s=float(chosen.base.t[-1] - chosen.base.t[0]),
        transfer=_transfer(chosen, verdict.verdict, left or where),
    )


def _transfer(chosen: Selection, verdict: Verdict, places: Sequence[Place]) -> Transfer | None:
    """How what has no name follows the ship, where it sits: all of the gap, or what the named effects leave of it. The
    main PHINS is held against the main IMU alone, which is what it would follow."""
    places = [place for place in places if not place.channel.startswith("phins_main")]
    if not places or verdict not in (Verdict.UNKNOWN_EFFECT, Verdict.PARTLY_EXPLAINED):
        return None
    place = max(places, key=lambda place: place.score)
    return transfer.transfer(chosen, place.channel, place.axis, verdict is Verdict.UNKNOWN_EFFECT)


def _places_left(evidence: Evidence) -> tuple[Place, ...]:
    """Where what has no name sits."""
    out = [place for finding in evidence.nameless for place in finding.places[:1]]
    for family in evidence.ceiling[:2]:
        if family.gain.sum() > FLOOR_NATS:
            out.append(Place(family.channel, family.axis, pictures.MOTION_HZ, None, float(family.gain.sum())))
    axis, band = np.unravel_index(int(np.argmax(evidence.excess.nats)), evidence.excess.nats.shape)
    nats, edges = float(evidence.excess.nats[axis].clip(0.0).sum()), evidence.excess.edges_hz
    if nats > FLOOR_NATS:
        out.append(Place("sub.gyro", "xyz"[axis], (float(edges[band]), float(edges[band + 1])), None, nats))
    return tuple(out)


def _advice(evidence: Evidence, verdict: Abstention, named: tuple[Finding, ...]) -> tuple[str, ...]:
    out = [finding.advice for finding in named if finding.advice]
    if verdict.reason:
        nearest = ", ".join(finding.name for finding in evidence.findings[:2])
        out.append(f"Nothing is named: {verdict.reason}. What comes nearest: {nearest}.")
    if verdict.verdict in (Verdict.UNKNOWN_EFFECT, Verdict.PARTLY_EXPLAINED):
        best = evidence.ceiling[0] if evidence.ceiling else None
        if best is not None and best.gain.sum() > FLOOR_NATS:
            out.append(f"What is left looks like {best.name} ({best.channel} {best.axis}, {best.gain.sum():.0f} nats).")
        if evidence.excess.total > FLOOR_NATS:
            out.append("The spectrum of the flexure is not the one of the model: look at the spectra of the residual.")
    if named:
        out.append("A match shows that the log is consistent with the effect, not that the effect is the cause.")
    return tuple(out)


def _tested(evidence: Evidence, named: tuple[Finding, ...], verdict: Abstention) -> tuple[Tested, ...]:
    """A row for every effect that was looked at, strongest first."""
    rows = {
        name: (nats, evidence.chosen.thresholds.get(name, FLOOR_NATS), "")
        for name, nats in evidence.chosen.alone.items()
    }
    for candidate in evidence.candidates:
        rows[candidate.finding.name] = (candidate.finding.evidence_nats, candidate.threshold_nats, candidate.reason)
    for name in direct.EFFECTS:
        rows.setdefault(name, (0.0, FLOOR_NATS, ""))
    for finding in evidence.findings:
        rows[finding.name] = (finding.evidence_nats, rows.get(finding.name, (0.0, FLOOR_NATS, ""))[1], "")
    chosen = {finding.name for finding in named}
    out = [
        Tested(
            name, float(nats), float(threshold), name in chosen, reason or _why(name, nats, threshold, chosen, verdict)
        )
        for name, (nats, threshold, reason) in rows.items()
    ]
    return tuple(sorted(out, key=lambda row: -(row.evidence_nats or 0.0)))


def _why(name: str, nats: float, threshold: float, named: set[str], verdict: Abstention) -> str:
    """Why an effect with evidence was not named."""
    if name in named or nats < threshold:
        return ""
    return verdict.reason or "nothing is left for it beside the named effects"
