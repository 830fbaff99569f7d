"""The model-free method and the traditional one it was set against (Y. He, X. Zhang, X. Peng, IEEE Access 2018).

Both match attitude quaternions, ``Z = C phi + theta_1 - theta_2 - phi_0`` (9, its sign put right). What differs is
what they suppose of phi: nothing but that it moves at random, or a second-order Markov process whose parameters are not
those of the ship. As printed a network with input Z stands for phi; it can explain Z by itself, whatever the drift, so
that nothing is left to tell phi from the drift.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import ClassVar

import numpy as np

from physics.kalman import Filtered
from physics.units import ARCMIN
from schemas.products import Alignment, Deformation, Estimate, FlexureModel
from schemas.rig import FloatArray
from schemas.trial import Trial
from stages.drift import calibrated
from stages.estimate.quaternion_matching import deforming, linear, unscented
from stages.estimate.quaternion_matching.answer import Matched, deformation, from_linear, from_network
from stages.estimate.quaternion_matching.density import LAG_S, densities
from stages.estimate.quaternion_matching.gaps import integrated, rejoined
from stages.paired import Linearisation, Observations, observe

ANGLE_PRIOR = 60.0 * ARCMIN  # rad, of the deformation and of d, at least
INPUT_SCALE = 10.0 * ARCMIN  # rad, by which Z is divided before it enters the network
USED = "gyros of both units; specific force is not used by this method"
NOT_IDENTIFIABLE = (
    "the network with the measurement as its input can explain any drift: the deformation is not identifiable,"
    " and the covariance means nothing"
)


class Variant(StrEnum):
    """What stands in for a model of the deformation."""

    INTEGRATED = "integrated"
    WALK = "walk"
    NETWORK = "network"


@dataclass(frozen=True)
class Setting:
    """Observations about an alignment, and the noise of the filter. bias: (3,) rad/s, taken out before."""

    obs: Observations
    noise: linear.Noise
    R_ref: FloatArray
    bias: FloatArray

    @classmethod
    def of(cls, trial: Trial, alignment: Alignment, flexure: FlexureModel, rotation: FloatArray) -> Setting:
        """The match about ``rotation`` (3, 3), the sub-IMU read later by the delay of the alignment."""
        at = replace(Linearisation.at(alignment), R_0=rotation, R_ref=rotation)
        prior = np.maximum(ANGLE_PRIOR, 3.0 * alignment.static.std)
        paired = integrated(trial)
        obs, bias = calibrated(lambda about: rejoined(observe(paired, about), rotation, prior), at)
        return cls(obs, linear.noise_of(trial.rig, flexure, prior, 0.0), rotation, bias)

    def walked(self, variant: Variant) -> Filtered:
        """Random walk of phi, or of phi', with the density found in the match; found again once the drift is known."""
        filtered = None
        for _ in range(2):
            d = None if filtered is None else filtered.x[:, linear.D : linear.D + 3]
            filtered = linear.run(self.obs, self.obs.z, self.walk(variant, d), self.noise)
        assert filtered is not None
        return filtered

    def walk(self, variant: Variant, d: FloatArray | None) -> deforming.Deforming:
        """The random walk that z without drift d (N, 3) shows."""
        angle, rate = densities(self.obs, self.obs.z, d)
        prior = float(self.noise.d_prior.max())
        if variant is Variant.WALK:
            return deforming.walk(angle, self.obs.dt, prior)
        return deforming.integrated_walk(rate, self.obs.dt, prior, np.sqrt(angle / LAG_S))

    def trained(self, inputs: FloatArray) -> unscented.Trained:
        """The online network on ``inputs`` (N, 3)."""
        d = self.walked(Variant.WALK).x[:, linear.D : linear.D + 3]
        density = float(np.mean(densities(self.obs, self.obs.z, d)[0]))
        return unscented.train(self.obs, self.obs.z, inputs, density, self.noise)


class ModelFree:
    """Attitude quaternion matching without a flexure model; its online network is an option."""

    name: ClassVar[str] = "model-free"
    source: ClassVar[str] = "He, Zhang and Peng, IEEE Access 2018, eq. 9-19, corrected"
    options: ClassVar[Mapping[str, str]] = {
        "variant": "'integrated' (random walk of the rate, default), 'walk' (of the angle), 'network' (constant input)",
        "as_printed": "the network with input Z and no alignment, as printed: not identifiable, kept to show it",
    }

    def __init__(self, variant: str = Variant.INTEGRATED, as_printed: bool = False) -> None:
        self.variant = Variant(variant)
        self.as_printed = as_printed

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Causal deformation of a trial; DataError when the units hardly overlap."""
        rotation = np.eye(3) if self.as_printed else alignment.rotation
        setting = Setting.of(trial, alignment, flexure, rotation)
        matched, bias = self._matched(setting)
        notes = (NOT_IDENTIFIABLE,) if self.as_printed else ()
        used = (USED, f"deformation as {self._said()}")
        return deformation(self.name, trial, matched, alignment, flexure, {"gyro_bias": bias}, used, notes)

    def _matched(self, setting: Setting) -> tuple[Matched, Estimate]:
        obs = setting.obs
        if self.as_printed:
            return from_network(obs, setting.trained(measured_in_i(obs) / INPUT_SCALE), setting.R_ref, setting.bias)
        if self.variant is Variant.NETWORK:
            return from_network(obs, setting.trained(np.ones_like(obs.z)), setting.R_ref, setting.bias)
        return from_linear(obs, setting.walked(self.variant), setting.R_ref, setting.bias)

    def _said(self) -> str:
        if self.as_printed:
            return "a network of the measurement"
        kinds = {Variant.INTEGRATED: "an integrated random walk", Variant.WALK: "a random walk"}
        return kinds.get(self.variant, "a network of constant input")


class Traditional:
    """Attitude quaternion matching with a second-order Markov flexure whose parameters are not those of the ship."""

    name: ClassVar[str] = "traditional"
    source: ClassVar[str] = "He, Zhang and Peng, IEEE Access 2018, sec. V"
    options: ClassVar[Mapping[str, str]] = {
        "damping_factor": "on the identified mu, default 2",
        "frequency_factor": "on the identified b, default 2",
        "std_factor": "on the identified sigma, default 0.5",
    }

    def __init__(self, damping_factor: float = 2.0, frequency_factor: float = 2.0, std_factor: float = 0.5) -> None:
        if min(damping_factor, frequency_factor, std_factor) <= 0.0:
            raise ValueError("the factors on the flexure's parameters must be positive")
        self.factors = damping_factor, frequency_factor, std_factor

    def estimate(self, trial: Trial, alignment: Alignment, flexure: FlexureModel) -> Deformation:
        """Causal deformation of a trial; DataError when the units hardly overlap."""
        setting = Setting.of(trial, alignment, flexure, alignment.rotation)
        wrong = self.wrong(flexure)
        static = setting.noise.d_prior
        model = deforming.markov(wrong.damping, wrong.stiffness, wrong.std, setting.obs.dt, static, 0.0)
        filtered = linear.run(setting.obs, setting.obs.z, model, setting.noise)
        matched, bias = from_linear(setting.obs, filtered, setting.R_ref, setting.bias)
        factors = "damping, frequency and std times {:g}, {:g}, {:g}".format(*self.factors)
        used = (USED, f"second-order Markov flexure with {factors}; constant static angle")
        return deformation(self.name, trial, matched, alignment, wrong, {"gyro_bias": bias}, used)

    def wrong(self, flexure: FlexureModel) -> FlexureModel:
        """The identified parameters times the factors."""
        damping, frequency, std = self.factors
        return replace(
            flexure, method=f"{flexure.method}, then made wrong", damping=flexure.damping * damping,
            stiffness=flexure.stiffness * frequency**2, std=flexure.std * std,
        )  # fmt: skip


def measured_in_i(obs: Observations) -> FloatArray:
    """(N, 3) rad, the paper's Z = A_m z."""
    return np.einsum("kij,kj->ki", obs.A_end, obs.z)
