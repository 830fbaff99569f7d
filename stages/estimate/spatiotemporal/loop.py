"""The two-step loop: delay and coarse alignment found in turn, then the filter over the whole record.

Loop 1 takes the coarse alignment with the delay ignored and runs the filter until the delay is known to half a
sample, at k_node. Loop 2 shifts the sub-IMU by that delay, aligns again and starts anew. The residual delay is applied
again, whole and fractional samples, until it no longer moves: its column is of first order only (erratum of 9).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from physics.kalman import Filtered
from physics.units import ARCMIN
from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.drift import calibrated
from stages.estimate.quaternion_matching import linear
from stages.estimate.quaternion_matching.deforming import markov
from stages.estimate.quaternion_matching.gaps import integrated, rejoined
from stages.estimate.spatiotemporal.coarse import STD_CEILING, Coarse, Vectors, coarse_alignment
from stages.estimate.spatiotemporal.measurement import measured
from stages.paired import Linearisation, Observations, Paired, observe

LOOP_S = 300.0  # s of record on which delay and coarse alignment are found
NODE_EARLIEST_S = 60.0  # s before which the coarse alignment of loop 1 is not trusted
ROUNDS = 4
SETTLED = 0.02  # samples by which the shift may still move
DELAY_PRIOR_S = 0.5
STATIC_WALK = 0.01 * ARCMIN  # rad/sqrt(s), of the quasi-static angle


@dataclass(frozen=True)
class Plan:
    """time, space: whether delay and misalignment are compensated. vectors, as_printed: the estimator's options."""

    time: bool = True
    space: bool = True
    vectors: Vectors = Vectors.RATES
    as_printed: bool = False


@dataclass(frozen=True)
class Loop:
    """One pass: what the sub-IMU was shifted by (s), the coarse alignment, observations and filter.

    bias: (3,) rad/s in m-axes, taken out of the sub-IMU before.
    """

    shift: float
    coarse: Coarse
    obs: Observations
    noise: linear.Noise
    filtered: Filtered
    bias: FloatArray


@dataclass(frozen=True)
class Found:
    """last: the pass over the whole record. node_s: time at which loop 1 ended, NaN: there was none. first_delay,
    first_std: s, there. shifts: delays applied in turn, s. sample: s between samples of the main IMU.
    """

    last: Loop
    node_s: float
    first_delay: float
    first_std: float
    sample: float
    shifts: tuple[float, ...]


@dataclass(frozen=True)
class Job:
    """What stays the same from loop to loop."""

    trial: Trial
    alignment: Alignment
    flexure: FlexureModel
    plan: Plan
    paired: Paired

    @property
    def sample(self) -> float:
        """s between samples of the main IMU."""
        return float(np.median(np.diff(self.paired.main.t)))

    def coarse(self, shift: float) -> Coarse:
        """Alignment from the first LOOP_S with the sub-IMU read ``shift`` later; none where space is left alone."""
        if not self.plan.space:
            return Coarse(np.eye(3), np.full(3, STD_CEILING))
        return coarse_alignment(self.paired, shift, self.plan.vectors, self.paired.main.t[0] + LOOP_S)

    def loop(self, paired: Paired, shift: float) -> Loop:
        """Align, observe, filter with the sub-IMU shifted."""
        coarse = self.coarse(shift)
        at = replace(Linearisation.at(self.alignment), R_0=coarse.rotation, R_ref=coarse.rotation, delay=shift)
        flexure = self.flexure
        # At the start d = -(static + flexure), both as seen from the coarse alignment.
        d_prior = np.hypot(coarse.std, flexure.std)
        obs, bias = calibrated(lambda about: rejoined(observe(paired, about), coarse.rotation, d_prior), at)
        deforming = markov(flexure.damping, flexure.stiffness, flexure.std, obs.dt, coarse.std, STATIC_WALK)
        noise = linear.noise_of(self.trial.rig, flexure, d_prior, DELAY_PRIOR_S if self.plan.time else 0.0)
        z = measured(obs, self.plan.as_printed)
        return Loop(shift, coarse, obs, noise, linear.run(obs, z, deforming, noise), bias)


def align_and_filter(trial: Trial, alignment: Alignment, flexure: FlexureModel, plan: Plan) -> Found:
    """The method on a trial. Raises DataError when the units hardly overlap."""
    job = Job(trial, alignment, flexure, plan, integrated(trial))
    if not plan.time:
        return Found(job.loop(job.paired, 0.0), float("nan"), 0.0, 0.0, job.sample, (0.0,))
    start = job.paired.main.t[0]
    piece = job.paired.between(start, start + LOOP_S)
    first = job.loop(piece, 0.0)
    node = k_node(first, job.sample)
    shifts = [0.0, _whole(float(first.filtered.x[node, linear.DELAY]), job.sample)]
    for _ in range(ROUNDS):
        residual = float(job.loop(piece, shifts[-1]).filtered.x[-1, linear.DELAY])
        shifts.append(shifts[-1] + residual)
        if abs(residual) < SETTLED * job.sample:
            break
    ended = float(first.obs.t[first.obs.index[node]])
    delay, std = (
        float(first.filtered.x[node, linear.DELAY]),
        float(np.sqrt(first.filtered.P_out[node, 3, linear.DELAY])),
    )
    return Found(job.loop(job.paired, shifts[-1]), ended, delay, std, job.sample, tuple(shifts))


def _whole(delay: float, sample: float) -> float:
    """The delay as a whole number of samples, s."""
    return round(delay / sample) * sample


def k_node(loop: Loop, sample: float) -> int:
    """First step, NODE_EARLIEST_S into the record at least, at which the delay is known to half a sample; or last."""
    t = loop.obs.t[loop.obs.index]
    std = np.sqrt(loop.filtered.P_out[:, 3, linear.DELAY])
    known = (std < 0.5 * sample) & (t >= t[0] + NODE_EARLIEST_S)
    return int(np.argmax(known)) if known.any() else len(t) - 1
