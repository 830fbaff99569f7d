"""Whittle maximum likelihood of second-order Gauss-Markov flexure from sampled angles.

Model per axis: ``theta'' + 2 mu theta' + b^2 theta = w`` with PSD of w ``q = 4 mu b^2 sigma^2``, seen through
increments ``theta[k] - theta[k-1]`` over the sampling interval T, plus white increments of variance ``N^2 T`` (angle
random walk of the gyros). The spectrum of the sampled process is exact, aliasing included: with
``R(n) = sum c_i p_i^|n|``, ``p_i = exp(s_i T)``, it is ``sum c_i (1 - p_i^2) / (1 - 2 p_i cos w + p_i^2)``, at any
damping.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.fft import prev_fast_len, rfft
from scipy.optimize import minimize

FloatArray = NDArray[np.float64]

TAPER = 0.1  # share of the record under the cosine taper: stops leakage of the steep spectrum
LINEAR_BINS = 400  # frequencies kept one by one; above, they are pooled in bins of equal width in log frequency
BINS_PER_OCTAVE = 12
PRIOR_CORRELATION_S = 8.0  # centre and spread of the weak prior on 1/b and mu/b, for short records
PRIOR_SPREAD = 1.5  # natural-log standard deviation


@dataclass(frozen=True)
class Periodogram:
    """Pooled: omega (k,) rad/sample, power (k,) rad^2 (white noise of variance v has power v), count (k,)."""

    omega: FloatArray
    power: FloatArray
    count: FloatArray


@dataclass(frozen=True)
class WhittleFit:
    """One axis. log_parameters: ln mu, ln b^2, ln sigma, ln N (rad/sqrt(s)); covariance (4, 4) of them.

    misfit: mean of power over model minus one, in the octave where it is worst. log_likelihood: with the prior.
    """

    damping: float
    stiffness: float
    std: float
    gyro_noise: float
    covariance: FloatArray
    misfit: float
    log_likelihood: float


def sampled_spectrum(omega: FloatArray, mu: float, stiffness: float, sigma: float, T: float) -> FloatArray:
    """Spectrum (k,) of theta sampled every T seconds at omega (k,) rad/sample; its mean over frequency is sigma^2."""
    n0, n1, d0, d1, d2 = _rational(float(mu), float(stiffness), float(sigma), float(T))
    x = 2.0 * np.sin(0.5 * omega) ** 2
    return np.asarray((n0 + n1 * x) / (d0 + x * (d1 + d2 * x)))


@njit(cache=True, nogil=True)
def _expm1(z: complex) -> complex:
    """exp(z) - 1 without loss for small z."""
    return cmath.exp(z) - 1.0 if z.real < -1.0 else 2.0 * cmath.exp(0.5 * z) * cmath.sinh(0.5 * z)


@njit(cache=True, nogil=True)
def _rational(mu: float, stiffness: float, sigma: float, T: float) -> tuple[float, float, float, float, float]:
    """The spectrum as (n0 + n1 x) / (d0 + d1 x + d2 x^2) with x = 1 - cos w.

    Its two denominators are (1 - p)^2 + 2 p x; on one denominator the sum is real.
    """
    split = cmath.sqrt(complex(mu * mu - stiffness, 0.0))
    if abs(split) < 1e-5 * mu:  # critical damping: a split this small changes the spectrum by less than 1e-9
        split = complex(1e-5 * mu, 0.0)
    s1, s2 = -mu + split, -mu - split
    a1, a2 = _expm1(s1 * T) ** 2, _expm1(s2 * T) ** 2
    b1, b2 = 2.0 * cmath.exp(s1 * T), 2.0 * cmath.exp(s2 * T)
    scale = sigma**2 / (s1 - s2)
    c1, c2 = scale * s2 * _expm1(2.0 * s1 * T), -scale * s1 * _expm1(2.0 * s2 * T)
    return (c1 * a2 + c2 * a1).real, (c1 * b2 + c2 * b1).real, (a1 * a2).real, (a1 * b2 + a2 * b1).real, (b1 * b2).real


def increment_spectrum(
    omega: FloatArray, mu: float, stiffness: float, sigma: float, gyro_noise: float, T: float
) -> FloatArray:
    """Spectrum (k,) of the increments of theta over T, white gyro noise ``gyro_noise^2 T`` included."""
    difference = 4.0 * np.sin(0.5 * omega) ** 2
    return difference * sampled_spectrum(omega, mu, stiffness, sigma, T) + gyro_noise**2 * T


def periodogram(segments: list[FloatArray]) -> Periodogram:
    """Tapered, pooled periodogram of increments; segments are contiguous pieces (n_i,), each transformed by itself.

    The last few of a piece are left out where its transform would take several times as long with them.
    """
    omegas, powers = [], []
    for x in (segment[: prev_fast_len(len(segment))] for segment in segments):
        window = cosine_taper(len(x), TAPER)
        spectrum = np.abs(rfft(x * window)) ** 2 / np.sum(window**2)
        omegas.append(2 * np.pi * np.arange(1, len(spectrum) - 1) / len(x))
        powers.append(spectrum[1 : len(spectrum) - 1])
    return _pool(np.concatenate(omegas), np.concatenate(powers))


def cosine_taper(n: int, share: float) -> FloatArray:
    """(n,) ones that fall to zero as half a cosine over half the share at either end (Tukey's window)."""
    edge = np.minimum(np.arange(n), np.arange(n)[::-1]) / (0.5 * share * (n - 1))
    return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.minimum(edge, 1.0))))


def _pool(omega: FloatArray, power: FloatArray) -> Periodogram:
    order = np.argsort(omega, kind="stable")
    omega, power = omega[order], power[order]
    if len(omega) <= LINEAR_BINS:
        return Periodogram(omega, power, np.ones(len(omega)))
    tail = omega[LINEAR_BINS:]
    label = np.floor(np.log2(tail / tail[0]) * BINS_PER_OCTAVE).astype(int)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(label)) + 1])
    count = np.diff(np.concatenate([starts, [len(tail)]])).astype(float)
    mean = lambda v: np.add.reduceat(v, starts) / count  # noqa: E731
    return Periodogram(
        np.concatenate([omega[:LINEAR_BINS], mean(tail)]),
        np.concatenate([power[:LINEAR_BINS], mean(power[LINEAR_BINS:])]),
        np.concatenate([np.ones(LINEAR_BINS), count]),
    )


def fit(
    data: Periodogram,
    T: float,
    *,
    noise_prior: float,
    noise_spread: float,
    weight: FloatArray | None = None,
    start: tuple[float, float, float, float] | None = None,
) -> WhittleFit:
    """Maximise ``-sum count (ln S + I/S)`` plus weak log-normal priors.

    T: s. noise_prior: rad/sqrt(s), centre of the prior on the gyro noise, noise_spread its natural-log sigma. weight:
    (k,) 0..1 per bin (0 leaves a bin out). start: (mu, b^2, sigma, noise) to begin from; otherwise several starts
    are tried.
    """
    count = data.count * (1.0 if weight is None else weight)
    total = float(np.sum(data.power * data.count) / np.sum(data.count))
    x, power = 2.0 * np.sin(0.5 * data.omega) ** 2, np.asarray(data.power, float)

    def cost(p: FloatArray) -> float:
        return _cost(p, x, power, count, T, 1e-12 * total, noise_prior, noise_spread)

    starts = _starts(data, total, T, noise_prior) if start is None else [np.log(np.array(start))]
    best = min((_minimise(cost, p0, start is None) for p0 in starts), key=lambda solution: solution.fun)
    covariance = _inverse_hessian(cost, best.x)
    mu, stiffness, sigma, noise = np.exp(best.x)
    S = increment_spectrum(data.omega, mu, stiffness, sigma, noise, T)
    return WhittleFit(mu, stiffness, sigma, noise, covariance, _misfit(data, S, count), -float(best.fun))


@njit(cache=True, nogil=True, error_model="numpy")
def _cost(
    p: FloatArray, x: FloatArray, power: FloatArray, count: FloatArray, T: float, least: float, centre: float,
    spread: float,
) -> float:  # fmt: skip
    """Negative log-posterior of ln mu, ln b^2, ln sigma and ln noise, its prior (centre, spread)."""
    prior = ((p[3] - np.log(centre)) / spread) ** 2
    prior += ((0.5 * p[1] + np.log(PRIOR_CORRELATION_S)) / PRIOR_SPREAD) ** 2
    prior += ((p[0] - 0.5 * p[1]) / PRIOR_SPREAD) ** 2
    mu, stiffness, sigma, noise = (
        np.exp(min(max(p[0], -40.0), 20.0)), np.exp(min(max(p[1], -40.0), 20.0)),
        np.exp(min(max(p[2], -40.0), 20.0)), np.exp(min(max(p[3], -40.0), 20.0)),
    )  # fmt: skip
    return _misfit_nats(mu, stiffness, sigma, noise, x, power, count, T, least) + 0.5 * prior


@njit(cache=True, nogil=True, error_model="numpy")
def _misfit_nats(
    mu: float, stiffness: float, sigma: float, noise: float, x: FloatArray, power: FloatArray, count: FloatArray,
    T: float, least: float,
) -> float:  # fmt: skip
    """sum count (ln S + I/S) for mu, b^2, sigma and noise at x = 1 - cos w; S is at least ``least``."""
    n0, n1, d0, d1, d2 = _rational(mu, stiffness, sigma, T)
    total = 0.0
    for k in range(len(x)):
        S = 2.0 * x[k] * (n0 + n1 * x[k]) / (d0 + x[k] * (d1 + d2 * x[k])) + noise**2 * T
        S = max(S, least)
        total += count[k] * (np.log(S) + power[k] / S)
    return total


def _starts(data: Periodogram, total: float, T: float, noise_prior: float) -> list[FloatArray]:
    # The variance of increments over short T is about 2 (R(0) - R(T)) = q T^2 / (4 mu) = b^2 sigma^2 T^2; what the top
    # two octaves hold may be all gyro noise instead, and then the flexure is what stands above it.
    top = data.omega > data.omega[-1] / 4
    floor = float(np.average(data.power[top], weights=data.count[top]))
    noisy = float(np.sqrt(floor / T))
    above = max(total - floor, 1e-4 * total)
    levels = [(noise_prior, total), (max(noisy, noise_prior), above)]
    return [
        np.log(np.array([0.6 * b, b * b, np.sqrt(variance) / (b * T), noise]))
        for noise, variance in levels
        for b in (0.1, 0.5)
    ]


def _minimise(cost, p0, search):  # type: ignore[no-untyped-def]
    if search:
        p0 = minimize(cost, p0, method="Nelder-Mead", options={"maxiter": 250, "xatol": 1e-2, "fatol": 1e-2}).x
    return minimize(cost, p0, method="L-BFGS-B", options={"maxiter": 60})


def _inverse_hessian(cost, p: FloatArray) -> FloatArray:  # type: ignore[no-untyped-def]
    n, h = len(p), 1e-3
    H = np.empty((n, n))
    for i in range(n):
        for j in range(i, n):
            di, dj = h * np.eye(n)[i], h * np.eye(n)[j]
            H[i, j] = H[j, i] = (cost(p + di + dj) - cost(p + di - dj) - cost(p - di + dj) + cost(p - di - dj)) / (
                4 * h * h
            )
    values, vectors = np.linalg.eigh(H)
    return (vectors / np.maximum(values, 1e-3)) @ vectors.T


def _misfit(data: Periodogram, S: FloatArray, count: FloatArray) -> float:
    """Largest significant relative deviation of power from the model over octaves."""
    used = count > 0
    ratio, n = (data.power / S)[used], count[used]
    label = np.floor(np.log2(data.omega[used])).astype(int)
    worst = 0.0
    for octave in np.unique(label):
        inside = label == octave
        weight = n[inside].sum()
        deviation = float(np.sum(ratio[inside] * n[inside]) / weight - 1.0)
        if abs(deviation) > 4.0 / np.sqrt(weight) and abs(deviation) > abs(worst):
            worst = deviation
    return worst
