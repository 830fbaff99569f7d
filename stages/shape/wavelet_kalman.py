"""`wavelet-kalman`: the published recipe for a sliding SINS.

B. Ren, T. Li, X. Li, "Research on Dynamic Inertial Estimation Technology for Deck Deformation of Large Ships",
Sensors 2019, 19, 4167, equations (1)-(34): a six-point moving db3 window whose last point feeds a Kalman filter of a
12-state model for the INS (11) and one for the SINS (24); curvature is the difference of the filtered rates divided
by speed (31)-(33). Of the 12 states only rates and angles meet the rates: positions and velocities are measured
apart and separate exactly (tested against the full filter), so the reduced models run, all axes of all runs side by
side. Corrected where the paper as printed cannot work; ``as_printed`` keeps its forms (docs/methods/wavelet-kalman.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pywt
from scipy.linalg import expm

from physics.units import ARCMIN
from schemas.errors import DataError
from schemas.products import BoolArray, DeckPass, DeckShape, Deformation
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial
from stages.shape.outcome import NO_LIMIT, Design, deck_pass, deformed_line, design_curve, exceeds
from stages.shape.rates import aligned, reference
from stages.shape.samples import Sled, load, reported
from stages.shape.track import Track

WINDOW = 6  # points of the moving window, the length of db3
EARTH_RATE = 7.291158e-5  # rad/s, as printed
GRID = 201
INS_TIME = 0.5  # s: over which the ship's rate may change by its own spread
RATE_PRIOR = 1e-2  # rad/s, std of the first rate


@dataclass(frozen=True)
class WaveletKalmanShape:
    """The published recipe; options are the paper's parameters.

    beta: (3,) 1/s inverse correlation times of the flexure. sigma_arcmin: (3,) its std (the paper's initial angles).
    latitude: rad, for the Earth's rate in the printed INS model where the log has no GNSS. as_printed: with the forms
    of (10), (20), (31), (33) as printed. limit, design: as for the default method.
    """

    name: ClassVar[str] = "wavelet-kalman"
    source: ClassVar[str] = "Ren, Li, Li, Sensors 2019, 19, 4167, eqs. (1)-(34), corrected"
    options: ClassVar[Mapping[str, str]] = {
        "limit": "tolerated departure from the design about x, y, z, rad/m",
        "design": "design curvature: function of arc length, triple, or rows of s and three curvatures",
        "beta": "inverse correlation time of the flexure per axis, 1/s",
        "sigma_arcmin": "std of the flexure per axis, arcminutes",
        "latitude": "rad, for as_printed where the log has no GNSS",
        "as_printed": "keep the printed forms of equations (10), (20), (31) and (33), which fail",
    }
    limit: Sequence[float] = NO_LIMIT
    design: Design = None
    beta: Sequence[float] = (0.15, 0.12, 0.10)
    sigma_arcmin: Sequence[float] = (5.0, 5.0, 20.0)
    latitude: float = np.radians(30.0)
    as_printed: bool = False

    def shape(self, trial: Trial, deformation: Deformation | None = None) -> DeckShape:
        """Deck shape by the published recipe; the deformation is not used. DataError as for the default method."""
        path, sled = load(trial)
        main = reference(trial.main, trial.seconds(trial.main.stamp))
        sled = sled.where(main.covered(sled.unit.begin, sled.unit.end))
        if len(sled.stamp) < 200:
            raise DataError("no deck shape: the main IMU does not cover the sled's runs", file=trial.source or None)
        ship = main.mean(sled.unit.begin, sled.unit.end)
        # (31)-(33) need both rates in one frame; the paper takes the sled's axes for the hull's.
        turned = sled.unit.rate if self.as_printed else sled.unit.rate @ aligned(main, sled.unit)[0].T
        rate, std = self._rates(sled, ship, turned, trial)
        limit = np.asarray(self.limit, dtype=float)
        passes = tuple(
            self._pass(path, sled, rate, std, run.index, limit)
            for run in path.passes
            if reported(sled, path, run.index).any()
        )
        if not passes:
            raise DataError("no deck shape: no run has usable samples at cruising speed", file=trial.source or None)
        return _averaged(path, passes, self.design, limit, self.as_printed)

    def _rates(self, sled: Sled, ship: FloatArray, turned: FloatArray, trial: Trial) -> tuple[FloatArray, FloatArray]:
        """Filtered rate of the sled (turned, (n, 3)) against the ship (n, 3) rad/s and the filter's std of it (3,)."""
        runs = sled.run
        step = float(np.median(sled.unit.end - sled.unit.begin))
        measured_ship, measured_sled = by_run(moving_db3, ship, runs), by_run(moving_db3, turned, runs)
        latitude = self.latitude if trial.gnss is None else float(np.median(trial.gnss.latitude))
        ins = ins_model(measured_ship, step, latitude if self.as_printed else None)
        ship_filtered, _ = filtered(ins, measured_ship, runs)
        flexure = sins_model(measured_sled - measured_ship, step, self.beta, self.sigma_arcmin, not self.as_printed)
        if self.as_printed:
            whole, variance = filtered(flexure, measured_sled, runs)
            return (whole - ship_filtered)[:, [1, 0, 2]], np.sqrt(variance)
        apart, variance = filtered(flexure, measured_sled - measured_ship, runs)
        return apart, np.sqrt(variance)

    def _pass(
        self, path: Track, sled: Sled, rate: FloatArray, std: FloatArray, index: int, limit: FloatArray
    ) -> DeckPass:
        use = reported(sled, path, index)
        speed = sled.speed[use][:, None]
        moving = np.asarray(self.beta) * np.asarray(self.sigma_arcmin) * ARCMIN  # flexure in time looks like curvature
        spread = np.hypot(std, moving) / np.abs(speed)
        return deck_pass(
            path.passes[index], path, sled.stamp[use], sled.s[use], rate[use] / speed, spread, self.design, limit
        )


def moving_db3(x: FloatArray) -> FloatArray:
    """Last point of each six-point window after db3 with its details set to zero, (n, k), eq. (34) corrected.

    The maximum useful level for six points is 0: the result is a fixed filter of six taps set by PyWavelets' symmetric
    boundary. The first five samples pass unchanged, as in the paper.
    """
    if len(x) < WINDOW:
        return x.copy()
    windows = np.lib.stride_tricks.sliding_window_view(x, WINDOW, axis=0)
    out = x.copy()
    out[WINDOW - 1 :] = windows @ db3_taps()
    return out


def db3_taps() -> FloatArray:
    """The six taps (6,) of :func:`moving_db3`, oldest sample first, from PyWavelets' transform of unit pulses."""
    approximation, detail = pywt.dwt(np.eye(WINDOW), "db3", mode="symmetric", axis=1)
    rebuilt = pywt.idwt(approximation, np.zeros_like(detail), "db3", mode="symmetric", axis=1)
    return np.asarray(rebuilt[:, WINDOW - 1])


def by_run(function: Callable[[FloatArray], FloatArray], x: FloatArray, run: IntArray) -> FloatArray:
    """A function of a series applied to each run's samples (n, k) apart."""
    cuts = np.flatnonzero(np.diff(run)) + 1
    return np.vstack([function(part) for part in np.split(x, cuts)])


@dataclass(frozen=True)
class Model:
    """Angle and rate per axis: transition, noise (3, 2, 2), variance of a measured rate (3,), input (3, 2)."""

    transition: FloatArray
    noise: FloatArray
    variance: FloatArray
    drive: FloatArray


def white_variance(rate: FloatArray) -> FloatArray:
    """(3,) variance of the white noise in rates (n, 3), from their second differences."""
    return np.asarray((1.4826 * np.median(np.abs(np.diff(rate, n=2, axis=0)), axis=0)) ** 2 / 6.0 + 1e-20)


def ins_model(rate: FloatArray, step: float, printed_latitude: float | None) -> Model:
    """INS, (9), (10): angle' = rate, rate' = w; printed: rate' = the Earth's rate, which has the unit of a rate."""
    transition = np.tile(np.array([[1.0, step], [0.0, 1.0]]), (3, 1, 1))
    noise, drive = np.zeros((3, 2, 2)), np.zeros((3, 2))
    if printed_latitude is None:
        noise[:, 1, 1] = np.var(rate, axis=0) * step / INS_TIME
    else:
        drive[1:, 1] = step * EARTH_RATE * np.array([np.cos(printed_latitude), np.sin(printed_latitude)])
    return Model(transition, noise, white_variance(rate), drive)


def sins_model(
    rate: FloatArray, step: float, beta: Sequence[float], sigma_arcmin: Sequence[float], driven: bool
) -> Model:
    """SINS, (20): angle' = rate, rate' = -beta^2 angle - 2 beta rate + w, PSD of w 4 beta^3 sigma^2; printed: no w."""
    b, sigma = np.asarray(beta, dtype=float), np.asarray(sigma_arcmin, dtype=float) * ARCMIN
    pairs = [_van_loan(bi, 4.0 * bi**3 * si**2 if driven else 0.0, step) for bi, si in zip(b, sigma)]
    return Model(
        np.stack([p[0] for p in pairs]), np.stack([p[1] for p in pairs]), white_variance(rate), np.zeros((3, 2))
    )


def _van_loan(beta: float, psd: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Transition and process noise over one step (van Loan, IEEE Trans. Autom. Control 23, 1978)."""
    F = np.array([[0.0, 1.0], [-(beta**2), -2.0 * beta]])
    whole = np.zeros((4, 4))
    whole[:2, :2], whole[:2, 2:], whole[2:, 2:] = -F, np.diag([0.0, psd]), F.T
    both = expm(whole * step)
    transition = both[2:, 2:].T
    return transition, transition @ both[:2, 2:]


def gains(model: Model, count: int) -> tuple[FloatArray, FloatArray]:
    """Kalman gains (count, 3, 2), independent of the data, and the last variance (3,) of the rate."""
    P = np.tile(np.diag([(20.0 * ARCMIN) ** 2, RATE_PRIOR**2]), (3, 1, 1))
    out = np.empty((count, 3, 2))
    for k in range(count):
        if k:
            P = model.transition @ P @ model.transition.transpose(0, 2, 1) + model.noise
        out[k] = P[:, :, 1] / (P[:, 1, 1] + model.variance)[:, None]
        P = P - out[k][:, :, None] * P[:, 1, None, :]
    return out, P[:, 1, 1]


def filtered(model: Model, rate: FloatArray, run: IntArray) -> tuple[FloatArray, FloatArray]:
    """Filtered rates (n, 3) of each run, from measured rates (n, 3), and their variance at the end (3,)."""
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(run)) + 1, [len(run)]])
    length = np.diff(cuts)
    inside = np.arange(length.max()) < length[:, None]
    padded = np.zeros((*inside.shape, 3))
    padded[inside] = rate
    K, variance = gains(model, int(length.max()))
    out, x = np.empty_like(padded), np.zeros((len(length), 3, 2))
    for k in range(padded.shape[1]):
        if k:
            x = np.einsum("aij,raj->rai", model.transition, x) + model.drive
        x = x + K[k] * (padded[:, k] - x[:, :, 1])[:, :, None]
        out[:, k] = x[:, :, 1]
    return out[inside], variance


def _averaged(
    path: Track, passes: tuple[DeckPass, ...], design: Design, limit: FloatArray, as_printed: bool
) -> DeckShape:
    """All runs: mean over runs of each run's mean within a grid cell; std from their scatter, or of one run."""
    low, high = min(p.arc_length.min() for p in passes), max(p.arc_length.max() for p in passes)
    s = np.linspace(low, high, GRID)
    cells = np.stack([_cells(s, p.arc_length, p.curvature) for p in passes])
    single = np.stack([_cells(s, p.arc_length, p.std) for p in passes])
    count = np.maximum(1, np.isfinite(cells).sum(axis=0))
    seen = np.asarray(np.isfinite(cells).any(axis=0))
    mean = _filled(s, np.nansum(cells, axis=0) / count, seen)
    scatter = np.nansum((cells - mean) ** 2, axis=0) / np.maximum(count - 1, 1)
    model = np.nansum(single**2, axis=0) / count
    std = np.sqrt(np.where(count > 2, scatter, np.maximum(model, scatter)) / count)
    std = _filled(s, std, seen)
    wanted = design_curve(design, s)
    notes = ("printed forms of equations (10), (20), (31) and (33)",) if as_printed else ()
    over = exceeds(mean, std, wanted, limit)
    return DeckShape("wavelet-kalman", passes, s, mean, std, deformed_line(path, s, mean), over, limit, wanted, notes)


def _cells(s: FloatArray, at: FloatArray, value: FloatArray) -> FloatArray:
    """Means (k, 3) of values (n, 3) within half a step of each grid point, NaN where there is none."""
    which = np.clip(np.rint((at - s[0]) / (s[1] - s[0])).astype(int), 0, len(s) - 1)
    count = np.bincount(which, minlength=len(s)).astype(float)
    sums = np.stack([np.bincount(which, value[:, i], minlength=len(s)) for i in range(3)], axis=-1)
    return np.where(count[:, None] > 0, sums / np.maximum(count, 1.0)[:, None], np.nan)


def _filled(s: FloatArray, value: FloatArray, known: BoolArray) -> FloatArray:
    """Values (k, 3) with the unknown ones interpolated."""
    return np.stack([np.interp(s, s[known[:, i]], value[known[:, i], i]) for i in range(3)], axis=-1)
