"""Joint whitening of gyros, accelerometers and PHINS by the Kalman filter of the flexure model.

The model is the estimator's (:mod:`stages.estimate.model`) without its constants, which the diagnosis fits as
regressors, and with the PHINS pair: ``q = mean over a step of Log(R_m_s^PHINS Y^T) = C e - A_m^T d + noise``. Since Y,
the attitude match of the gyros, is free of noise, q holds no flexure at all: what the gyros do wrong and what the PHINS
do wrong is all there is in it. e is the difference of the errors of both PHINS, first-order Gauss-Markov in ENU, turned
by ``C = R_n_m^T``.

The filter is linear, so that a regressor passed through the same gains is what an effect adds to the innovations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from physics import quaternions
from physics.interpolation import slerp_quaternions
from physics.kalman import FAST, Filtered, SparseModel, run_filter
from physics.units import ARCMIN
from schemas.products import BoolArray
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial
from stages.estimate import model as m
from stages.paired import Observations
from twin.config import Phins

CHANNELS = ("sub.gyro", "sub.accel", "phins_sub.attitude")
ROWS = 9  # z, u, q
KEPT = np.concatenate([np.arange(first, first + 3) for first in (m.ZETA, m.THETA_DOT, m.D, m.V, m.JITTER, m.JITTER_BEFORE, m.STEP_D, m.NABLA)])  # fmt: skip # noqa: E501
D, VELOCITY, COLOUR, JITTER, JITTER_BEFORE = (
    int(np.flatnonzero(state == KEPT)[0]) for state in (m.D, m.V, m.NABLA, m.JITTER, m.JITTER_BEFORE)
)
EDGE_S = 5.0  # s left out at both ends, where interpolation and the filter's start would be tested
LANES = 48  # regressors whitened side by side
OUTLIER_SIGMA = 8.0  # an innovation beyond it belongs to an event, not to a regression


@dataclass(frozen=True)
class PhinsNoise:
    """Of the difference of both units: white (rad, a step), drift (3,) rad in ENU, tau s."""

    white: float
    drift: FloatArray
    tau: float


@dataclass(frozen=True)
class AccelColour:
    """First-order Gauss-Markov part of the accelerometers' noise: std (3,) m/s^2 per m-axis, tau s."""

    std: FloatArray
    tau: float


@dataclass(frozen=True)
class PhinsMatch:
    """q: (N, 3) rad, NaN where a PHINS has no attitude. C, A_T: (N, 3, 3) R_n_m^T and A_m^T, means over the steps.
    count: (N,) samples."""

    q: FloatArray
    C: FloatArray
    A_T: FloatArray
    count: FloatArray


@dataclass(frozen=True)
class Levels:
    """All noise of the model."""

    noise: m.Noise
    colour: AccelColour
    phins: PhinsNoise


@dataclass(frozen=True)
class Whitened:
    """values: (N, 9) standardised innovations of z, u and q, NaN where nothing was measured or it is masked.

    model, filtered: what made them; scale: (9,), by which the innovations were larger than the model says.
    """

    model: SparseModel
    filtered: Filtered
    values: FloatArray
    scale: FloatArray


def phins_match(trial: Trial, obs: Observations) -> PhinsMatch | None:
    """The pair of PHINS against the gyros' attitude match; None without two of them."""
    main, sub = _attitude(trial.phins_main, trial), _attitude(trial.phins_sub, trial)
    if main is None or sub is None:
        return None
    stamp = np.rint(obs.t * 1e9).astype(np.int64)
    (n_m, main_ok), (n_s, sub_ok) = slerp_quaternions(*main, stamp), slerp_quaternions(*sub, stamp)
    both = main_ok & sub_ok & obs.good
    if both.sum() < 0.5 * obs.good.sum():
        return None
    measured = quaternions.multiply(quaternions.conjugate(n_m[both[main_ok]]), n_s[both[sub_ok]])
    Y = quaternions.multiply(quaternions.conjugate(obs.main.attitude[both]), obs.sub.attitude[both])
    difference = np.full((len(obs.t), 3), np.nan)
    difference[both] = quaternions.log(quaternions.multiply(measured, quaternions.conjugate(Y)))
    q, count = step_means(difference, obs.index)
    known = np.clip(np.cumsum(main_ok) - 1, 0, None)  # place of the last attitude there is
    return PhinsMatch(q, _mean_matrices(n_m[known], obs.index), _mean_matrices(obs.main.attitude, obs.index), count)


def _mean_matrices(attitude: FloatArray, index: IntArray) -> FloatArray:
    """(N, 3, 3) means of R^T over the samples of each step, which are those that :func:`step_means` takes."""
    entries = Rotation.from_quat(attitude).as_matrix().reshape(-1, 9)
    return np.swapaxes(step_means(entries, index)[0].reshape(-1, 3, 3), 1, 2)


def _attitude(series: ImuSeries | None, trial: Trial) -> tuple[IntArray, FloatArray] | None:
    if series is None or series.attitude is None:
        return None
    good = np.isfinite(series.attitude).all(axis=1)
    return (series.stamp[good] - trial.epoch, series.attitude[good]) if good.sum() > 2 else None


def step_means(values: FloatArray, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """Means (N, c) over the samples of each step that are not NaN, NaN where there are none, and their number (N,)."""
    mean, count = np.zeros((len(index), values.shape[1])), np.zeros(len(index))
    _step_means(np.require(values, float, ["C", "W"]), index, mean, count)
    return mean, count


@njit(cache=True, nogil=True)
def _step_means(values, index, mean, count):  # type: ignore[no-untyped-def]
    begin = 0
    for step in range(len(index)):
        for k in range(begin, index[step] + 1):
            whole = True
            for c in range(values.shape[1]):
                whole = whole and np.isfinite(values[k, c])
            if whole:
                count[step] += 1.0
                for c in range(values.shape[1]):
                    mean[step, c] += values[k, c]
        for c in range(values.shape[1]):
            mean[step, c] = mean[step, c] / count[step] if count[step] > 0.0 else np.nan
        begin = index[step] + 1


@dataclass(frozen=True)
class Core:
    """The estimator's model reduced to its dynamic states, with the noise it was built for."""

    model: SparseModel
    noise: m.Noise


def core(obs: Observations, noise: m.Noise, coupling: FloatArray) -> Core:
    """The costly part of :func:`build`, which serves all levels that differ in velocity, jitter and accel alone."""
    return Core(reduced(m.build(obs, _without_constants(noise), coupling, np.zeros(m.SIZE)), KEPT), noise)


def build(
    obs: Observations, levels: Levels, coupling: FloatArray, match: PhinsMatch | None, made: Core | None = None
) -> SparseModel:
    """The lean model: dynamic states alone, PHINS appended. made: the core at levels of the same flexure and gyros."""
    noise = levels.noise
    model = core(obs, noise, coupling).model if made is None else _relevelled(made, obs, noise)
    lean = _with_colour(_with_means(model, obs, noise), obs, levels.colour)
    return lean if match is None else _with_phins(lean, obs, match, levels.phins)


def _relevelled(made: Core, obs: Observations, noise: m.Noise) -> SparseModel:
    """A core at other levels of velocity, jitter and accel."""
    model, Q, P0, variance = made.model, made.model.noise.copy(), made.model.P0.copy(), made.model.variance.copy()
    variance[:, 3:6] += noise.velocity**2 - made.noise.velocity**2
    on_diagonal = model.noise_row == model.noise_col
    for axis in range(3):
        now, before = JITTER + axis, JITTER_BEFORE + axis
        Q[:, on_diagonal & (model.noise_row == now)] = noise.jitter[axis] ** 2
        P0[now, now] = P0[before, before] = noise.jitter[axis] ** 2
        Q[:, on_diagonal & (model.noise_row == VELOCITY + axis)] += (
            (noise.accel**2 - made.noise.accel**2) * obs.dt[:, None]
        )  # fmt: skip
    return replace(model, noise=Q, P0=P0, variance=variance)


def _without_constants(noise: m.Noise) -> m.Noise:
    return replace(
        noise, phi_prior=0.0, gyro_bias_prior=0.0, delay_prior=0.0, clock_prior=0.0, accel_bias_prior=0.0,
        lever_prior=0.0, coupling_prior=0.0, kappa_prior=0.0, scale_prior=np.zeros((3, 3)), gyro_walk=0.0,
        accel_walk=0.0,
    )  # fmt: skip


def reduced(model: SparseModel, kept: IntArray) -> SparseModel:
    """The model of some states alone, the others being zero for ever."""
    place = np.full(len(model.x0), -1)
    place[kept] = np.arange(len(kept))
    in_E = (place[model.transition_row] >= 0) & (place[model.transition_col] >= 0)
    in_Q = (place[model.noise_row] >= 0) & (place[model.noise_col] >= 0)
    rows = model.measurement_col.shape[0]
    inside = [
        np.flatnonzero((place[model.measurement_col[i]] >= 0) & np.any(model.measurement[:, i] != 0.0, axis=0))
        for i in range(rows)
    ]
    width = max(map(len, inside))
    column = np.zeros((rows, width), dtype=np.int64)
    value = np.zeros((len(model.z), rows, width))
    for i, chosen in enumerate(inside):
        column[i, : len(chosen)] = place[model.measurement_col[i, chosen]]
        value[:, i, : len(chosen)] = model.measurement[:, i, chosen]
    return SparseModel(
        place[model.transition_row[in_E]], place[model.transition_col[in_E]],
        np.ascontiguousarray(model.transition[:, in_E]), place[model.noise_row[in_Q]], place[model.noise_col[in_Q]],
        np.ascontiguousarray(model.noise[:, in_Q]), column, value, model.z, model.variance, model.x0[kept],
        np.ascontiguousarray(model.P0[np.ix_(kept, kept)]),
    )  # fmt: skip


def _with_colour(lean: SparseModel, obs: Observations, colour: AccelColour) -> SparseModel:
    """The accelerometers' bias states fade and are driven."""
    own = COLOUR + np.arange(3)
    fade = np.exp(-obs.dt / colour.tau)
    P0 = lean.P0.copy()
    P0[own, own] = colour.std**2
    return replace(
        lean,
        transition_row=np.concatenate([lean.transition_row, own]),
        transition_col=np.concatenate([lean.transition_col, own]),
        transition=np.ascontiguousarray(np.hstack([lean.transition, np.repeat(fade[:, None] - 1.0, 3, axis=1)])),
        noise_row=np.concatenate([lean.noise_row, own]), noise_col=np.concatenate([lean.noise_col, own]),
        noise=np.ascontiguousarray(np.hstack([lean.noise, (1.0 - fade[:, None] ** 2) * colour.std**2])), P0=P0,
    )  # fmt: skip


def _with_means(lean: SparseModel, obs: Observations, noise: m.Noise) -> SparseModel:
    """u is the mean of the velocity over a step, which lags the velocity at its end by noise of its own.

    With V' = w of density q over a step h: the deficit mean - end has variance q h/3, and covariance -q h/2 with V's
    step.
    """
    n, N = len(lean.x0), len(obs.dt)
    own, q = np.arange(n, n + 3), noise.accel**2 * obs.dt[:, None]
    A_T = np.swapaxes(obs.A_mid, 1, 2)
    old = lean.measurement_col.shape[1]
    column = np.hstack([lean.measurement_col, np.zeros((len(lean.measurement_col), 3), dtype=np.int64)])
    value = np.concatenate([lean.measurement, np.zeros((N, lean.measurement.shape[1], 3))], axis=2)
    column[3:6, old:], value[:, 3:6, old:] = own, A_T
    P0 = np.zeros((n + 3, n + 3))
    P0[:n, :n] = lean.P0
    return replace(
        lean,
        transition_row=np.concatenate([lean.transition_row, own]),
        transition_col=np.concatenate([lean.transition_col, own]),
        transition=np.ascontiguousarray(np.hstack([lean.transition, np.full((N, 3), -1.0)])),
        noise_row=np.concatenate([lean.noise_row, own, VELOCITY + np.arange(3)]),
        noise_col=np.concatenate([lean.noise_col, own, own]),
        noise=np.hstack([lean.noise, np.repeat(q / 3.0, 3, axis=1), np.repeat(-q / 2.0, 3, axis=1)]),
        measurement_col=column, measurement=value, x0=np.concatenate([lean.x0, np.zeros(3)]), P0=P0,
    )  # fmt: skip


def _with_phins(lean: SparseModel, obs: Observations, match: PhinsMatch, noise: PhinsNoise) -> SparseModel:
    N, n = len(obs.dt), len(lean.x0)
    own = np.arange(n, n + 3)
    decay = np.exp(-obs.dt / noise.tau)
    width = max(lean.measurement_col.shape[1], 6)
    column = np.zeros((ROWS, width), dtype=np.int64)
    value = np.zeros((N, ROWS, width))
    column[:6, : lean.measurement_col.shape[1]] = lean.measurement_col
    value[:, :6, : lean.measurement_col.shape[1]] = lean.measurement
    for i in range(3):
        column[6 + i, :6] = [*own, D, D + 1, D + 2]
        value[:, 6 + i, :3] = match.C[:, i]
        value[:, 6 + i, 3:6] = -match.A_T[:, i]
    P0 = np.zeros((n + 3, n + 3))
    P0[:n, :n] = lean.P0
    P0[n:, n:] = np.diag(noise.drift**2)
    white = noise.white**2 / np.maximum(match.count, 1.0)
    spread = (noise.drift[None, :] ** 2) * (-np.expm1(-2.0 * obs.dt / noise.tau))[:, None]
    return SparseModel(
        np.concatenate([lean.transition_row, own]), np.concatenate([lean.transition_col, own]),
        np.ascontiguousarray(np.hstack([lean.transition, np.repeat(decay[:, None] - 1.0, 3, axis=1)])),
        np.concatenate([lean.noise_row, own]), np.concatenate([lean.noise_col, own]),
        np.ascontiguousarray(np.hstack([lean.noise, spread])), column, value,
        np.hstack([lean.z, match.q]), np.hstack([lean.variance, np.repeat(white[:, None], 3, axis=1)]),
        np.concatenate([lean.x0, np.zeros(3)]), P0,
    )  # fmt: skip


def phins_noise(belief: Phins) -> PhinsNoise:
    """What the twin says of the difference of two units: sqrt(2) of one; white is per sample."""
    root = np.sqrt(2.0)
    drift = root * np.array(belief.attitude_drift_arcmin) * ARCMIN
    return PhinsNoise(
        root * max(belief.attitude_noise_arcmin, 1e-3) * ARCMIN, np.maximum(drift, 1e-9), belief.attitude_drift_tau
    )


def masked(obs: Observations, rows: int) -> BoolArray:
    """(N, rows) innovations not to be tested: the ends, and the surroundings of gaps."""
    t = obs.t[obs.index]
    out: BoolArray = np.asarray((t < t[0] + EDGE_S) | (t > t[-1] - EDGE_S))
    for k in np.flatnonzero(obs.jump_s > 0.0):
        out |= (t > t[k] - 1.0) & (t < t[k] + EDGE_S)
    return np.repeat(out[:, None], rows, axis=1)


def whiten(model: SparseModel, obs: Observations) -> Whitened:
    """Innovations over their standard deviation, NaN where nothing is to be tested."""
    filtered = run_filter(model, np.zeros(0, dtype=np.int64))
    values = filtered.innovation / np.sqrt(filtered.innovation_variance)
    values[masked(obs, values.shape[1])] = np.nan
    return Whitened(model, filtered, values, np.ones(values.shape[1]))


def rescaled(whitened: Whitened, left: FloatArray) -> Whitened:
    """Each channel scaled so that what is left (N, m) of it has unit variance; events far outside it masked."""
    scale = np.array([spread(column) for column in left.T])
    values = np.where(np.abs(left / scale) > OUTLIER_SIGMA, np.nan, whitened.values / scale)
    return replace(whitened, values=values, scale=whitened.scale * scale)


def spread(column: FloatArray) -> float:
    """RMS of a channel with its tails clipped at three sigma, 1 where there is nothing."""
    x = column[np.isfinite(column)]
    if len(x) < 20:
        return 1.0
    spread = float(np.median(np.abs(x))) / 0.6745
    for _ in range(5):
        spread *= float(np.sqrt(np.mean(np.minimum((x / spread) ** 2, 9.0)) / 0.987))
    return max(spread, 1e-12)


@njit(cache=True, nogil=True, fastmath=FAST)
def _columns(e_row, e_col, E, h_col, H, gain, root_S, c, first):  # type: ignore[no-untyped-def]
    """Up to LANES columns of c (N, m, K), from ``first`` on, are overwritten with what they add to the innovations.
    Loops over a constant number of lanes are those that the compiler turns into vector code."""
    steps, rows = root_S.shape
    count = min(LANES, c.shape[2] - first)
    x = np.zeros((gain.shape[2], LANES))
    dx = np.zeros_like(x)
    nu = np.zeros(LANES)
    for k in range(steps):
        dx[:] = 0.0
        for a in range(len(e_row)):
            value, to, by = E[k, a], dx[e_row[a]], x[e_col[a]]
            for q in range(LANES):
                to[q] += value * by[q]
        x += dx
        for i in range(rows):
            row = c[k, i, first : first + count]
            if np.isnan(root_S[k, i]):
                row[:] = 0.0
                continue
            for q in range(count):
                nu[q] = row[q]
            for a in range(h_col.shape[1]):
                h, by = H[k, i, a], x[h_col[i, a]]
                for q in range(LANES):
                    nu[q] -= h * by[q]
            for j in range(x.shape[0]):
                g, to = gain[k, i, j], x[j]
                for q in range(LANES):
                    to[q] += g * nu[q]
            scale = 1.0 / root_S[k, i]
            for q in range(count):
                row[q] = scale * nu[q]


def whiten_columns(whitened: Whitened, columns: FloatArray) -> FloatArray:
    """Regressors (N, 9, K) as what they add to the standardised innovations, zero where those are masked."""
    return whitened_in_place(whitened, np.array(columns[:, : whitened.values.shape[1]], order="C"))


def whitened_in_place(whitened: Whitened, columns: FloatArray, first: int = 0) -> FloatArray:
    """The same in the place of the columns themselves, those from ``first`` on; further rows of them stay."""
    model, filtered = whitened.model, whitened.filtered
    root = np.sqrt(filtered.innovation_variance) * whitened.scale
    for lane in range(first, columns.shape[2], LANES):
        _columns(
            model.transition_row, model.transition_col, model.transition, model.measurement_col, model.measurement,
            filtered.gain, root, columns, lane,
        )  # fmt: skip
    columns[:, : root.shape[1], first:][~np.isfinite(whitened.values)] = 0.0
    return columns
