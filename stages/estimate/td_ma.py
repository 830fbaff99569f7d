"""Spatio-temporal alignment with a Kalman filter, and its three ablations (Xu, Yu, Zhang and Peng, JSEE 2023).

    Z = C_b1^i1 phi_10 + theta_1 - C_b2^b0 theta_2 - phi_0 + Z_dt delay      (26)

Delay and misalignment are found in two loops (:mod:`stages.estimate.spatiotemporal.loop`); the filter's static angle
walks, its flexure is the identified second-order Markov process. The output at each instant uses the past alone, but
for delay shift and coarse alignment, which come from the first minutes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from schemas.products import Alignment, Deformation, Estimate, FlexureModel, Status
from schemas.trial import Trial
from stages.estimate.quaternion_matching import linear, unscented
from stages.estimate.quaternion_matching.answer import Matched, deformation, from_linear, from_network
from stages.estimate.quaternion_matching.density import densities
from stages.estimate.spatiotemporal.coarse import Vectors
from stages.estimate.spatiotemporal.loop import Found, Plan, align_and_filter

INPUT_SCALE = linear.ARCMIN * 10.0  # rad, by which Z is divided before it enters the network
DELAY_WEAK_SAMPLES = 0.5  # standard deviation of the delay beyond which the record hardly shows it


class Network(StrEnum):
    """What stands for the residual angle phi_10 in the last loop."""

    NONE = "none"
    CONSTANT = "constant"
    PRINTED = "printed"


class TdMa:
    """Spatio-temporal alignment: quaternion optimisation, two-step loop of delay and misalignment, Kalman filter."""

    name: ClassVar[str] = "td-ma"
    source: ClassVar[str] = "Xu, Yu, Zhang and Peng, J. Syst. Eng. Electron. 2023, eq. 1-42, corrected"
    options: ClassVar[Mapping[str, str]] = {
        "coarse": "what the quaternion optimisation matches: 'rates' (default) or 'integrals' (eq. 5 as printed)",
        "network": "for the residual angle, in the last loop: 'none' (default), 'constant' (input), 'printed' (Z)",
        "as_printed": "coarse alignment on integrals and the printed elements (20)-(22) of Z: kept to show the failure",
    }
    time: ClassVar[bool] = True
    space: ClassVar[bool] = True

    def __init__(self, coarse: str = Vectors.RATES, network: str = Network.NONE, as_printed: bool = False) -> None:
        vectors = Vectors.INTEGRALS if as_printed else Vectors(coarse)
        self.plan = Plan(self.time, self.space, vectors, as_printed)
        self.network = Network(network)

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Causal deformation of a trial; DataError when the units hardly overlap. Of ``alignment`` nothing is used."""
        found = align_and_filter(trial, alignment, flexure, self.plan)
        matched, bias = self._matched(found, trial, flexure)
        delay = self._delay(found, matched)
        parameters = {"time_delay": delay, "gyro_bias": bias, **_coarse(found)}
        own = _alignment(alignment, found, delay)
        return deformation(self.name, trial, matched, own, flexure, parameters, self._used(found))

    def _matched(self, found: Found, trial: Trial, flexure: FlexureModel) -> tuple[Matched, Estimate]:
        loop = found.last
        if self.network is Network.NONE:
            return from_linear(loop.obs, loop.filtered, loop.coarse.rotation, loop.bias)
        obs = loop.obs
        density = float(np.mean(densities(obs, obs.z, loop.filtered.x[:, linear.D : linear.D + 3])[0]))
        inputs = np.ones_like(obs.z)
        if self.network is Network.PRINTED:
            inputs = np.einsum("kij,kj->ki", obs.A_end, obs.z) / INPUT_SCALE
        trained = unscented.train(obs, obs.z, inputs, density, loop.noise)
        return from_network(obs, trained, loop.coarse.rotation, loop.bias)

    def _delay(self, found: Found, matched: Matched) -> Estimate:
        if not self.time:
            return Estimate(np.array(0.0), np.array(0.0), Status.NOT_OBSERVABLE, "this method takes both clocks as one")
        value = found.last.shift + matched.delay[-1]
        std = np.sqrt(max(matched.P[-1, 3, 3], 0.0))
        if std > DELAY_WEAK_SAMPLES * found.sample:
            return Estimate(np.array(value), np.array(std), Status.WEAK, "the motion hardly shows the delay")
        return Estimate(np.array(value), np.array(std))

    def _used(self, found: Found) -> tuple[str, ...]:
        space = f"coarse alignment on {self.plan.vectors}" if self.space else "no coarse alignment"
        shifts = ", ".join(f"{1e3 * shift:.2f}" for shift in found.shifts)
        time = f"sub-IMU shifted by {shifts} ms in turn" if self.time else "delay not compensated"
        return ("gyros of both units; specific force is not used by this method", space, time)


class TdNoMa(TdMa):
    """TD-MA without coarse alignment: the misalignment is taken for a small angle, the delay is compensated."""

    name: ClassVar[str] = "td-noma"
    space: ClassVar[bool] = False


class NoTdMa(TdMa):
    """TD-MA without delay compensation: coarse alignment alone, the clocks taken as one."""

    name: ClassVar[str] = "notd-ma"
    time: ClassVar[bool] = False


class NoTdNoMa(TdMa):
    """TD-MA with neither delay compensation nor coarse alignment."""

    name: ClassVar[str] = "notd-noma"
    time: ClassVar[bool] = False
    space: ClassVar[bool] = False


def _coarse(found: Found) -> dict[str, Estimate]:
    """The coarse alignment, rad, and where the first loop ended."""
    rotation = Rotation.from_matrix(found.last.coarse.rotation).as_rotvec()
    results = {"coarse_alignment": Estimate(rotation, found.last.coarse.std)}
    if np.isfinite(found.node_s):
        results["k_node_time"] = Estimate(np.array(found.node_s), np.array(0.0))
        results["first_loop_delay"] = Estimate(np.array(found.first_delay), np.array(found.first_std))
    return results


def _alignment(alignment: Alignment, found: Found, delay: Estimate) -> Alignment:
    """The method's own alignment: static angle at the end of the record on top of the coarse one, and the delay."""
    filtered, S = found.last.filtered, slice(linear.STATIC, linear.STATIC + 3)
    rotation = Rotation.from_rotvec(filtered.x[-1, S]) * Rotation.from_matrix(found.last.coarse.rotation)
    P = filtered.P_last[S, S]
    static = Estimate(rotation.as_rotvec(), np.sqrt(np.maximum(np.diag(P), 0.0)))
    return replace(alignment, rotation=rotation.as_matrix(), static=static, covariance=P, time_delay=delay, notes=())
