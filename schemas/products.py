"""What the stages hand on: Alignment, FlexureModel, Deformation, DeckShape, Score, Result.

Angles in radians, rates in rad/s, lengths in metres, times in seconds unless a name says otherwise. All arrays are
float64 and are never changed in place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from schemas.rig import FloatArray
from schemas.trial import IntArray

BoolArray = NDArray[np.bool_]


class Status(StrEnum):
    """How far a value can be trusted."""

    ESTIMATED = "estimated"
    WEAK = "weak"
    NOT_OBSERVABLE = "not observable"


@dataclass(frozen=True)
class Estimate:
    """A value with its standard deviation (same shape), status and, unless plainly estimated, the reason."""

    value: FloatArray
    std: FloatArray
    status: Status = Status.ESTIMATED
    reason: str = ""


@dataclass(frozen=True)
class Alignment:
    """Static misalignment and time delay between the two units.

    rotation: (3, 3) mean ``R_m_s``. static: (3,) rad, its rotation vector in m-axes. covariance: (3, 3) rad^2 of the
    error Log(R_est R_true^T). time_delay: () s; > 0: a sub sample stamped t was measured at t - delay.
    installation_main, installation_sub: rotation vectors (3,) of ``R_imu_phins``; None where there is no PHINS.
    static_phases: (k, 2) s since the epoch, intervals in which the ship lay still.
    """

    rotation: FloatArray
    static: Estimate
    covariance: FloatArray
    time_delay: Estimate
    installation_main: Estimate | None = None
    installation_sub: Estimate | None = None
    static_phases: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class FlexureModel:
    """Second-order Gauss-Markov flexure per axis: theta'' + 2 mu theta' + b^2 theta = w, PSD of w 4 mu b^2 sigma^2.

    damping: (3,) mu, 1/s. stiffness: (3,) b^2, 1/s^2 (lambda^2 = b^2 - mu^2 may be negative: overdamped).
    std: (3,) sigma, rad. log_covariance: (3, 3, 3) per axis, covariance of (ln mu, ln b^2, ln sigma).
    gyro_noise: (3,) rad/sqrt(s), angle random walk of the difference of the two gyros seen per m-axis, 0 where it was
    not separable. status, reason: per axis.
    """

    method: str
    damping: FloatArray
    stiffness: FloatArray
    std: FloatArray
    log_covariance: FloatArray
    gyro_noise: FloatArray
    status: tuple[Status, Status, Status] = (Status.ESTIMATED,) * 3
    reason: tuple[str, str, str] = ("", "", "")

    @property
    def frequency(self) -> FloatArray:
        """(3,) lambda, rad/s; 0 for a critically damped or overdamped axis."""
        return np.sqrt(np.maximum(self.stiffness - self.damping**2, 0.0))

    @property
    def forcing(self) -> FloatArray:
        """(3,) q = 4 mu b^2 sigma^2, two-sided PSD of the angular acceleration w, rad^2/s^3."""
        return 4.0 * self.damping * self.stiffness * self.std**2


@dataclass(frozen=True)
class Innovations:
    """Standardised innovations of a filter, for consistency checks.

    t: (k,) s since the epoch. values: (k, m), unit variance and white when the model is right. names: m channel names.
    NaN where a channel had no measurement.
    """

    t: FloatArray
    values: FloatArray
    names: tuple[str, ...]


@dataclass(frozen=True)
class Deformation:
    """The answer: the angle between the two places at every sample of the main IMU that was used.

    stamp: (n,) ns. total: (n, 3) Log(R_m_s), static_part and dynamic_part: (n, 3) Phi and theta, all rad in m-axes.
    covariance: (n, 3, 3) rad^2 of the error Log(R_est R_true^T) of the total. gaps in stamp are gaps in the data.
    parameters: further estimates by name (``lever_arm`` m, ``gyro_bias`` rad/s, ``time_delay`` s, ...), each with
    standard deviation, status, reason. used: measurement channels and how they were weighted, for people to read.
    """

    estimator: str
    stamp: IntArray
    total: FloatArray
    static_part: FloatArray
    dynamic_part: FloatArray
    covariance: FloatArray
    alignment: Alignment
    flexure: FlexureModel
    innovations: Innovations | None = None
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    used: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class DeckPass:
    """One run of the sled. All (n,) or (n, 3) arrays are per sliding-SINS sample used.

    stamp: ns. arc_length: m from the path's start (the same end for runs in either direction). position: (n, 3) m,
    deck frame. curvature: (n, 3) rad/m: about x (vertical), about y (torsion), about z (horizontal). std: likewise.
    exceeds: (n, 3) bool, beyond limit and significant.
    """

    index: int
    forward: bool
    stamp: IntArray
    arc_length: FloatArray
    position: FloatArray
    curvature: FloatArray
    std: FloatArray
    exceeds: BoolArray


@dataclass(frozen=True)
class DeckShape:
    """Curvature and torsion along the deck path: each run, and all runs together on a common arc-length grid.

    arc_length: (k,) m. curvature, std: (k, 3) rad/m in the order x (vertical), y (torsion), z (horizontal).
    line: (k, 3) m, the path bent by the measured curvature, deck frame. design: (k, 3) rad/m or None. limit: (3,)
    rad/m (inf: none). exceeds: (k, 3) bool.
    """

    method: str
    passes: tuple[DeckPass, ...]
    arc_length: FloatArray
    curvature: FloatArray
    std: FloatArray
    line: FloatArray
    exceeds: BoolArray
    limit: FloatArray
    design: FloatArray | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Score:
    """RMSE (3,) rad per m-axis of Log(R_est R_ref^T) against one reference, over duration s and samples.

    error: (n, 3) rad at stamp (n,) ns, for drawing. predicted: (3,) rad, RMS of the estimator's own sigma.
    reference_noise: (3,) rad, the part of the RMSE that the reference's own noise explains (0 for truth).
    coverage: (3,) share of errors within 1, 2 and 3 predicted sigma (reference noise included), over all axes.
    """

    estimator: str
    reference: str
    rmse: FloatArray
    duration: float
    samples: int
    stamp: IntArray
    error: FloatArray
    predicted: FloatArray
    reference_noise: FloatArray
    coverage: FloatArray


@dataclass(frozen=True)
class Result:
    """Everything one run of the pipeline found, ready to publish."""

    deformation: Deformation
    deck_shape: DeckShape | None
    scores: tuple[Score, ...]
    warnings: tuple[str, ...]
    provenance: Mapping[str, str]
