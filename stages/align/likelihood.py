"""Fine alignment: frequency-domain maximum likelihood of rotation and delay, robust to flexure.

    minimise  sum over f of |F[w_m(t) - R w_s(t + delay) - G(t) c]|^2 / S(f)

S is the spectrum of the residual itself (flexure rate, omega x theta, sensor noise), re-estimated in turn with the
fit, so that each frequency weighs what it is worth. Gauss-Newton on the rotation (``R_true = Exp(e) R``) and the
delay; G holds nuisance regressors with coefficients c.

Noise is no information: only frequencies in which the motion stands above the residual count, what the regressors'
own noise adds to the Hessian is taken off again, and a direction whose information is mostly noise is neither stepped
along nor promised. The covariance is the sandwich H^-1 B H^-1 with B from the scores' long-run variance: omega x theta
is in step with the motion, so a stationary noise model alone would promise too much.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg
from scipy.ndimage import uniform_filter1d

from physics import rotations
from schemas.rig import FloatArray
from stages.align.tracks import Cells, Track, cells, long_run_variance, shared_spans

ITERATIONS = 10
FLAT_ITERATIONS = 2  # first ones, weighted alike: the coarse error would spoil the spectrum
SMOOTH_HZ = 0.012  # half-width of the spectrum's smoothing, and
SMOOTH_BINS = 4  # at least so many bins
SNR_USED = 6.0  # power of motion over power of residual from which a frequency counts
CLIP_SIGMA = 5.0  # whitened residuals are clipped here (Huber)
SPREAD_LEAST = 1.3  # scores' variance over the Hessian's, at least: taper (1.12), parameters fitted, spectrum fitted
INFORMED_SHARE = 0.5  # of a direction's information that must not be noise
PRIOR_ANGLE = 1.8  # rad, one sigma of an angle nothing is known of (uniform over a turn)
PRIOR_DELAY = 0.7  # s, one sigma of such a delay (uniform over the search range)
SETTLED = 0.01  # standard deviations; smaller steps end the iteration
SPECTRUM_FLOOR = 1e-12  # of the residual's strongest frequency: rounding of the running mean
DELAY_SLACK = 0.1  # s by which the delay may move away from its coarse value

Nuisance = Callable[[Cells, FloatArray], FloatArray]
Aid = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Fit:
    """rotation: (3, 3). delay: s. covariance: (4, 4) of the rotation error (rad) and the delay (s).

    rates_alone: (3,) standard deviations (rad) along the principal axes of the rotation as the rates know it,
    ascending, without the aid.
    """

    rotation: FloatArray
    delay: float
    covariance: FloatArray
    rates_alone: FloatArray


@dataclass(frozen=True)
class _Normal:
    """Normal equations in the order (rotation, delay, nuisances); real: Hessian less what noise put into it."""

    hessian: FloatArray
    real: FloatArray
    score: FloatArray
    spread: FloatArray


def fit(
    first: Sequence[Track],
    second: Sequence[Track],
    step: float,
    start: tuple[FloatArray, float],
    shortest: float,
    *,
    hold_delay: bool = False,
    nuisance: Nuisance | None = None,
    aid: Aid | None = None,
    flat: int = FLAT_ITERATIONS,
) -> Fit:
    """Maximum-likelihood rotation and delay (s) from a coarse start, cells of ``step`` s.

    nuisance: extra regressors (n, 3, k) for cells and rotation. aid: (information (3, 3), its innovation (3,)) of
    another sensor on the rotation error. hold_delay: the delay stays at its start. flat: iterations before the spectrum
    is used (a start that is itself a fit needs none).
    """
    rotation, delay = start
    spans = shared_spans(first, second, shortest, (delay - DELAY_SLACK, delay + DELAY_SLACK))
    lowest, highest = (delay, delay) if hold_delay else (delay - DELAY_SLACK, delay + DELAY_SLACK)
    for iteration in range(ITERATIONS):
        normal = _normal(cells(spans, step, delay), rotation, nuisance, hold_delay, iteration < flat)
        aided = _with_aid(normal, aid(rotation)) if aid else normal
        change, covariance = _solve(aided)
        rotation = rotations.exp(change[:3]) @ rotation
        moved = float(np.clip(delay + change[3], lowest, highest)) - delay
        delay += moved
        if iteration > flat and np.all(np.abs(change) <= SETTLED * np.sqrt(np.diag(covariance))):
            break
    alone = np.sqrt(np.linalg.eigvalsh(_solve(normal)[1][:3, :3]).clip(0.0))
    return Fit(rotation, delay, covariance[:4, :4], alone)


def _normal(pair: Cells, rotation: FloatArray, nuisance: Nuisance | None, hold_delay: bool, flat: bool) -> _Normal:
    turned = pair.centred(pair.second) @ rotation.T
    misfit = pair.window[:, None] * (pair.centred(pair.first) - turned)
    design = [-rotations.skew(turned), (pair.slope @ rotation.T)[:, :, None] * (0.0 if hold_delay else 1.0)]
    if nuisance is not None:
        design.append(nuisance(pair, rotation))
    regressors = pair.window[:, None, None] * pair.centred(np.concatenate(design, axis=2))
    residual, size = _transform(misfit), len(misfit)
    spectrum = _smoothed(np.abs(residual) ** 2, size * pair.step)
    power = _smoothed(np.abs(_transform(pair.window[:, None] * turned)) ** 2, size * pair.step)
    used = (power.sum(axis=1) > SNR_USED * spectrum.sum(axis=1)) & (np.arange(len(power)) > 0)
    if flat:
        spectrum = np.broadcast_to(np.average(spectrum, axis=0, weights=used + 1e-9), spectrum.shape)
    weight = used[:, None] / np.sqrt(np.maximum(spectrum, np.finfo(float).tiny))
    white = _back(_transform(regressors) * weight[:, :, None], size)
    score_series = np.einsum("nap,na->np", white, _clipped(_back(residual * weight, size)))
    columns = white.reshape(-1, white.shape[2])
    hessian = columns.T @ columns
    noise = _noise_information(spectrum, used, pair.step, size, len(hessian), hold_delay)
    spread = _not_below(long_run_variance(score_series, pair.step), hessian)
    return _Normal(hessian, hessian - noise, score_series.sum(axis=0), spread)


def _solve(normal: _Normal) -> tuple[FloatArray, FloatArray]:
    """Step and covariance; along directions whose information is mostly noise: no step, the prior's spread."""
    size = len(normal.hessian)
    prior = np.diag([PRIOR_ANGLE**-2.0] * 3 + [PRIOR_DELAY**-2.0] + [np.finfo(float).tiny] * (size - 4))
    prior += np.diag(1e-12 * np.diag(normal.hessian))
    share, basis = linalg.eigh(normal.real, normal.hessian + prior)
    known = share > INFORMED_SHARE
    step = basis[:, known] @ (basis[:, known].T @ normal.score / share[known])
    scaled = basis[:, known] / share[known]
    rest = basis[:, ~known]
    covariance = scaled @ (basis[:, known].T @ normal.spread @ basis[:, known]) @ scaled.T
    covariance += (rest / np.einsum("pk,pq,qk->k", rest, prior, rest)) @ rest.T
    return step, covariance


def _not_below(spread: FloatArray, hessian: FloatArray) -> FloatArray:
    """The scores' variance, raised to SPREAD_LEAST of the Hessian wherever chance made it smaller (few bins)."""
    scale = np.sqrt(np.diag(hessian))
    scale = np.where(scale > 0.0, scale, 1.0)
    metric = hessian / np.outer(scale, scale) + 1e-9 * np.eye(len(hessian))
    ratio, basis = linalg.eigh(spread / np.outer(scale, scale), metric)
    back = scale[:, None] * (metric @ basis)
    return (back * np.maximum(ratio, SPREAD_LEAST)) @ back.T


def _with_aid(normal: _Normal, aid: tuple[FloatArray, FloatArray]) -> _Normal:
    grown = np.zeros_like(normal.hessian)
    grown[:3, :3] = aid[0]
    pull = np.concatenate((aid[1], np.zeros(len(grown) - 3)))
    return _Normal(normal.hessian + grown, normal.real + grown, normal.score + pull, normal.spread + grown)


def _noise_information(
    spectrum: FloatArray, used: FloatArray, step: float, size: int, parameters: int, hold_delay: bool
) -> FloatArray:
    """Hessian (p, p) that regressors made of residual-like noise alone would show."""
    noise = np.maximum(spectrum[used], np.finfo(float).tiny)
    ratio = 2.0 * np.einsum("fa,fb->ab", noise, 1.0 / noise)  # both signs of frequency
    out = np.zeros((parameters, parameters))
    for axis, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        out[axis, axis] = ratio[j, k] + ratio[k, j]
    omega = 2.0 * np.pi * fft.rfftfreq(_padded(size), step)[used]
    out[3, 3] = 0.0 if hold_delay else 6.0 * np.sum(omega**2)
    return out


def _padded(size: int) -> int:
    return int(fft.next_fast_len(size, real=True))


def _transform(values: FloatArray) -> FloatArray:
    return fft.rfft(values, _padded(len(values)), axis=0, norm="ortho")


def _back(values: FloatArray, size: int) -> FloatArray:
    return fft.irfft(values, _padded(size), axis=0, norm="ortho")


def _smoothed(power: FloatArray, duration: float) -> FloatArray:
    width = 2 * max(SMOOTH_BINS, round(SMOOTH_HZ * duration)) + 1
    smooth = uniform_filter1d(power, min(width, 2 * (len(power) // 2) - 1), axis=0, mode="mirror")
    return np.maximum(smooth, SPECTRUM_FLOOR * power.max(axis=0))


def _clipped(white: FloatArray) -> FloatArray:
    limit = CLIP_SIGMA * 1.4826 * np.median(np.abs(white), axis=0)
    return np.clip(white, -limit, limit)
