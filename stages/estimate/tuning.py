"""Noise and priors of the model: where they start, and how they follow from the data.

A rig may state them; what it leaves open comes from the log. The angle random walk is read off the spectrum of the
flexure increments; bias priors follow the biases found (empirical Bayes); the noise of the velocity match follows from
its own innovations, so that a lever arm the model describes badly loses its weight by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physics.units import ARCMIN, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, MICRO_G, PPM
from schemas.products import Alignment, FlexureModel
from schemas.rig import FloatArray, Rig
from stages.estimate.model import Noise

ANGLE_PRIOR = 60 * ARCMIN  # of the static angle and of the start of the drift, at least
ALIGNED_SIGMAS = 3.0  # and so many of the alignment's own sigmas, along the axes it leaves open
DELAY_PRIOR_S = (2e-3, 0.05)  # least and most
QUASI_STATIC = 1e-5 * ARCMIN  # rad/s^1.5: sun and load bend a deck by about an arcminute in an hour
CLOCK_PRIOR = 30e-6  # s/s, two crystal clocks
LEVER_PRIOR_M = 100.0  # where the rig states nothing
COUPLING_SHARE = 0.1  # of the lever arm: how far flexure between the two places differs from a rigid lever's
FINE_GYRO = 1.4e-3 * DEG_PER_SQRT_HOUR  # the grade at which the next figures hold; coarser units have larger ones
FINE_BIAS = 0.02 * DEG_PER_HOUR
FINE_SCALE = 10 * PPM
FINE_SKEW = 30 * PPM  # non-orthogonality: 6 arcsec between the two units
FINE_ACCEL_BIAS = 100 * MICRO_G
FINE_ACCEL_NOISE = 2e-4  # (m/s)/sqrt(s)
LEAST_ACCEL_SHARE = 0.5
GRADE_EXPONENT = 0.8  # from a fibre gyro (0.001 deg/sqrt(h), 5 ppm) to a MEMS (0.3 deg/sqrt(h), 0.3 %)
VELOCITY = 1e-4  # m/s per step: what interpolation and the means over a step leave
JITTER_START = 2e-3  # m, displacement of the lever arm beyond the model; the fit anneals from here
CLIP, CLIPPED_MEAN = 3.0, 0.987  # sigma; mean of min(chi-square, 9) with one degree of freedom
WORST_ACCEL_BIAS = 50_000 * MICRO_G  # a coarse unit with a scale error of 4 %: more is an angle gone wrong
PRIOR_WEIGHT = 1.0  # degrees of freedom of the grade's figure against the three biases found


def separable(flexure: FlexureModel) -> FlexureModel:
    """A model whose identifier could not tell the gyros' noise (zero) gets a fibre gyro's to begin with."""
    return replace(flexure, gyro_noise=np.where(flexure.gyro_noise > 0.0, flexure.gyro_noise, FINE_GYRO))


def grade(gyro_noise: FloatArray) -> float:
    """How much coarser than a fibre gyro the pair is, >= 1."""
    return float(max(np.median(gyro_noise) / FINE_GYRO, 1.0))


def initial(alignment: Alignment, flexure: FlexureModel, rig: Rig) -> Noise:
    """Where the tuning begins."""
    coarse = grade(flexure.gyro_noise)
    delay = float(np.clip(5.0 * float(alignment.time_delay.std), *DELAY_PRIOR_S))
    known = rig.lever_arm is not None
    noise = Noise(
        damping=flexure.damping, stiffness=flexure.stiffness, std=flexure.std, gyro=flexure.gyro_noise,
        gyro_walk=0.0, quasi_static=QUASI_STATIC, velocity=np.full(3, VELOCITY * np.sqrt(coarse)),
        jitter=np.full(3, JITTER_START),
        accel=accel_noise(rig, coarse), accel_walk=0.0, phi_prior=ANGLE_PRIOR, drift_prior=ANGLE_PRIOR,
        gyro_bias_prior=stated(rig, "gyro_bias_std") or FINE_BIAS * coarse, delay_prior=delay, clock_prior=CLOCK_PRIOR,
        accel_bias_prior=stated(rig, "accel_bias_std") or FINE_ACCEL_BIAS * coarse**GRADE_EXPONENT,
        lever_prior=rig.lever_arm_std if known else LEVER_PRIOR_M, coupling_prior=1.0, kappa_prior=COUPLING_SHARE,
        scale_prior=_scale_prior(coarse), angle_open=ALIGNED_SIGMAS**2 * alignment.covariance,
    )  # fmt: skip
    return with_flexure(noise, flexure)


def _scale_prior(coarse: float) -> FloatArray:
    """(3, 3): scale factors on the diagonal, non-orthogonality beside it."""
    return np.asarray(coarse**GRADE_EXPONENT * (FINE_SKEW + (FINE_SCALE - FINE_SKEW) * np.eye(3)))


def stated(rig: Rig, name: str) -> float | None:
    """Root sum of squares of a figure that the rig states for both units, else None."""
    main, sub = getattr(rig.main, name), getattr(rig.sub, name)
    return None if main is None or sub is None else float(np.hypot(main, sub))


def accel_noise(rig: Rig, coarse: float) -> float:
    """(m/s)/sqrt(s) of the difference of both accelerometers."""
    return stated(rig, "accel_vrw") or FINE_ACCEL_NOISE * np.sqrt(coarse)


def least_accel_noise(rig: Rig, noise: Noise) -> float:
    """(m/s)/sqrt(s), the least a record is believed to show: what a rig states, else a share of what is usual for the
    grade. Products of a coarse unit's biases and scale errors with bending are no noise, nor are they modelled."""
    return stated(rig, "accel_vrw") or LEAST_ACCEL_SHARE * accel_noise(rig, grade(noise.gyro))


def with_flexure(noise: Noise, flexure: FlexureModel) -> Noise:
    """Take over an identified flexure model and the grade that its gyro noise shows."""
    coarse = grade(flexure.gyro_noise)
    gyro = np.full(3, float(np.median(flexure.gyro_noise)))
    return replace(
        noise, damping=flexure.damping, stiffness=flexure.stiffness, std=flexure.std, gyro=gyro,
        # In-run instability: over an hour about a tenth of the bias prior.
        gyro_walk=0.1 * noise.gyro_bias_prior / 60.0, accel_walk=0.02 * noise.accel_bias_prior / 60.0,
        scale_prior=_scale_prior(coarse),
    )  # fmt: skip


def with_biases(
    noise: Noise, rig: Rig, gyro: tuple[FloatArray, FloatArray], accel: tuple[FloatArray, FloatArray]
) -> Noise:
    """Bias priors by empirical Bayes from (value, std) of the three biases found; a stated rig keeps its own."""
    coarse = grade(noise.gyro)
    gyro_prior = stated(rig, "gyro_bias_std") or _spread(FINE_BIAS * coarse, *gyro)
    accel_prior = stated(rig, "accel_bias_std") or _spread(FINE_ACCEL_BIAS * coarse**GRADE_EXPONENT, *accel)
    return replace(noise, gyro_bias_prior=gyro_prior, accel_bias_prior=min(accel_prior, WORST_ACCEL_BIAS))


def with_gyro_bias(noise: Noise, rig: Rig, seen: FloatArray) -> Noise:
    """A wider prior where a bias (3,) was seen before any filter ran; a stated rig keeps its own."""
    if stated(rig, "gyro_bias_std") or not seen.any():
        return noise
    return replace(noise, gyro_bias_prior=_spread(noise.gyro_bias_prior, seen, np.zeros(3)))


def _spread(centre: float, value: FloatArray, std: FloatArray) -> float:
    return float(np.sqrt((np.sum(value**2 + std**2) + PRIOR_WEIGHT * centre**2) / (3.0 + PRIOR_WEIGHT)))


def rescaled(noise: Noise, innovation: FloatArray, variance: FloatArray) -> Noise:
    """Scale the levels of u so that its normalised innovations (N, 3) get unit variance."""
    seen = np.isfinite(innovation).all(axis=1)
    if seen.sum() < 20:
        return noise
    # Clipped at three sigma, so that slamming and other rare events do not decide.
    ratio = np.mean(np.minimum(innovation[seen] ** 2 / variance[seen], CLIP**2), axis=0) / CLIPPED_MEAN
    factor = np.clip(np.sqrt(ratio), 0.1, 10.0)
    return replace(
        noise, accel=float(np.sqrt(np.mean(factor**2))) * noise.accel, velocity=factor * noise.velocity,
        jitter=factor * noise.jitter,
    )  # fmt: skip
