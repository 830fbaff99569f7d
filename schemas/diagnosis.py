"""What the diagnosis of the sim-to-real gap hands on: findings, places, the gap and how far it shrinks.

Parameters are in the units of the effect's declaration, as in an ``[[effect]]`` table of a twin; everything else is in
SI and radians unless a name says otherwise. Names of channels are ``<unit>.<quantity>``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from schemas.products import BoolArray
from schemas.rig import FloatArray


class Verdict(StrEnum):
    """The answer in a word."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY_EXPLAINED = "partly_explained"
    UNKNOWN_EFFECT = "unknown_effect"


@dataclass(frozen=True)
class ParameterEstimate:
    """A parameter with its standard deviation, in ``unit``. A word (an axis) has no standard deviation."""

    value: float | str
    std: float | None
    unit: str


Parameters = Mapping[str, ParameterEstimate | Mapping[str, ParameterEstimate]]


@dataclass(frozen=True)
class Place:
    """Where the log departs from the twin.

    channel: ``sub.gyro`` and so on. axis: ``x``, ``y``, ``z`` or empty where it has none. band_hz: (low, high).
    window_s: (start, end) s since the epoch of the trial, None for the whole record. score: nats of deficit.
    """

    channel: str
    axis: str
    band_hz: tuple[float, float]
    window_s: tuple[float, float] | None
    score: float


@dataclass(frozen=True)
class Finding:
    """An effect that the log speaks for.

    parameters: as in the log contract; a vector parameter is a mapping of its own. evidence_nats: held-out gain in
    log-likelihood over doing without it. ambiguous_with: names that the log cannot tell from it, and separated_by, a
    phrase for each, what would. places: where it shows, the strongest first.
    """

    name: str
    parameters: Parameters
    evidence_nats: float
    ambiguous_with: tuple[str, ...] = ()
    separated_by: tuple[str, ...] = ()
    places: tuple[Place, ...] = ()
    advice: str = ""


@dataclass(frozen=True)
class Tested:
    """One row of the ranked table. evidence_nats: as if it were the only effect; None where it could not be tested.

    threshold_nats: what it had to reach. reason: why it could not be tested, or why it was not named.
    """

    name: str
    evidence_nats: float | None
    threshold_nats: float
    named: bool
    reason: str = ""


@dataclass(frozen=True)
class Gap:
    """Held-out log-likelihood deficit against the ceiling, nats per sample, before and after the named effects.

    closed: 1 - after/before, in 0..1, with its interval of 95 %. samples: whitened samples per channel step.
    """

    before: float
    after: float
    closed: float
    closed_ci95: tuple[float, float]
    unit: str = "nats per sample, held out"


@dataclass(frozen=True)
class Errors:
    """RMSE per axis, each (3,) arcmin, of the estimator on the log, on the twin, on the twin with the effects, and on
    the log with the effects compensated; ``reference`` says against what they are taken. NaN where there is nothing to
    compare with. twin_truth, twin_with_effects_truth: against the truth, which a log has not. moved: (3,), root mean
    square by which the compensation moves the estimate on the log, which needs no reference."""

    log: FloatArray
    twin: FloatArray
    twin_with_effects: FloatArray
    log_compensated: FloatArray
    reference: str = ""
    twin_truth: FloatArray | None = None
    twin_with_effects_truth: FloatArray | None = None
    moved: FloatArray | None = None


@dataclass(frozen=True)
class Comparison:
    """The same shrinkage for something that is not the answer: the runner-up, or a placebo."""

    role: str
    name: str
    gap: Gap


@dataclass(frozen=True)
class Spectrum:
    """Power spectral density of a residual channel. frequency: (k,) Hz. before, after: (k,), with the twin alone and
    with the named effects. expected: (k,), what the fitted model predicts. unit: as printed on the axis."""

    channel: str
    axis: str
    frequency: FloatArray
    before: FloatArray
    after: FloatArray
    expected: FloatArray
    unit: str


@dataclass(frozen=True)
class Transfer:
    """How what is left follows the ship's motion: gain and phase from a sensor of the main IMU to a channel, m-axes.

    frequency: (k,) Hz. gain: (k,), in ``unit``. phase: (k,) rad, of the channel against the motion. Both with standard
    errors. evidence_nats: what following that motion gains held out.
    """

    channel: str
    axis: str
    source: str
    source_axis: str
    unit: str
    frequency: FloatArray
    gain: FloatArray
    gain_std: FloatArray
    phase: FloatArray
    phase_std: FloatArray
    evidence_nats: float

    @property
    def best(self) -> int:
        """Index of the frequency at which the gain is known best."""
        return int(np.argmax(self.gain / np.maximum(self.gain_std, 1e-300)))


@dataclass(frozen=True)
class Localisation:
    """Nats of deficit, (channels, bands, blocks): channels named ``channel axis``, bands_hz (bands, 2), edges of the
    blocks (blocks + 1,) s since the epoch of the trial."""

    channels: tuple[str, ...]
    bands_hz: FloatArray
    edges_s: FloatArray
    score: FloatArray


@dataclass(frozen=True)
class Trace:
    """A whitened residual channel in time. t: (k,) s since the epoch. before, after: (k,), unit variance under the
    model. regressor: (k,), what the strongest named effect predicts there, zeros where there is none."""

    channel: str
    axis: str
    t: FloatArray
    before: FloatArray
    after: FloatArray
    regressor: FloatArray
    good: BoolArray


@dataclass(frozen=True)
class Section:
    """What one section of a long record says. begin_s, end_s: s since the epoch of the trial. verdict: None where it
    could not be compared with the twin, and problem says why. effects: names with their evidence, nats."""

    begin_s: float
    end_s: float
    verdict: Verdict | None
    effects: tuple[tuple[str, float], ...] = ()
    problem: str = ""


@dataclass(frozen=True)
class Diagnosis:
    """Where the gap lies, what causes it, how far it shrinks; what could not be told.

    tested: every effect of the library, strongest first. untestable: effect to reason. augmented_twin: TOML text of
    the twin with the effects. comparisons: runner-up and placebo. notes: what a reader should distrust. transfer: of
    what has no name, where anything has none. sections: of a record too long to be diagnosed whole.
    """

    log: str
    twin: str
    verdict: Verdict
    where: tuple[Place, ...]
    effects: tuple[Finding, ...]
    gap: Gap
    augmented_twin: str
    advice: tuple[str, ...]
    rmse: Errors | None = None
    tested: tuple[Tested, ...] = ()
    untestable: Mapping[str, str] = field(default_factory=dict)
    comparisons: tuple[Comparison, ...] = ()
    spectra: tuple[Spectrum, ...] = ()
    localisation: Localisation | None = None
    traces: tuple[Trace, ...] = ()
    notes: tuple[str, ...] = ()
    duration_s: float = 0.0
    transfer: Transfer | None = None
    sections: tuple[Section, ...] = ()
