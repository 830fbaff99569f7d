"""`spline`: all runs at once, curvature as a smooth function of arc length beside flexure in time.

    R_m_c w_c = w_m + k(s) v + d/dt[a(s) theta] + w_m x [a(s) theta + chi(s)] + bias + e,   chi(s) = integral of k

in hull axes, c being the sled, theta the flexure at the fixed sub-IMU and a(s) the share of it that the sled feels per
axis, which changes along the path (the deck moves nothing where the main IMU stands). k, a, a remaining rotation with
scale factors, a remaining time delay and the bias are estimated together by least squares; see regression.py and
docs/methods/deck-shape.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from physics.rotations import exp
from physics.units import ARCMIN
from schemas.errors import DataError
from schemas.products import BoolArray, DeckPass, DeckShape, Deformation
from schemas.rig import FloatArray
from schemas.trial import IntArray, Trial
from stages.shape import regression as gls
from stages.shape.basis import CurveBasis, ShareBasis
from stages.shape.design import Calibration, Layout, rows
from stages.shape.flexure import Flexure, flexure
from stages.shape.outcome import NO_LIMIT, Design, deck_pass, deformed_line, design_curve, exceeds
from stages.shape.rates import Reference, aligned, reference
from stages.shape.samples import Sled, load, reported
from stages.shape.track import Track

SEARCH_ROUNDS = (1, 0, 1)  # of the noise parameters, at each renewal of rotation, delay and products of small angles
SEARCH_RUNS = 4  # runs that the noise parameters are found from
REJECT = 5.0  # std of a whitened residual
GRID = 201  # arc lengths of the combined curve
BIAS_STD = 5e-5  # rad/s (10 deg/h), unless the rig states it
UNEXPLAINED = 0.1  # of the sub-IMU's flexure rate: first guess of what theta does not explain
FLEXURE_RATE = 0.15 * ARCMIN  # rad/s: what a sled may feel where there is no sub-IMU (1' at 0.15 1/s)


@dataclass(frozen=True)
class AxisFit:
    """One axis: noise and prior parameters (logs), prior precision, normal equations a run, posterior of all."""

    noise: FloatArray
    prior: FloatArray
    P: FloatArray
    runs: tuple[gls.Normal, ...]
    posterior: gls.Posterior
    rejected: int


@dataclass(frozen=True)
class SplineShape:
    """Joint smoothing-spline estimate over all runs.

    limit: (3,) rad/m beyond the design that is tolerated, about x, y, z. design: curvature the deck was built with
    (see :func:`stages.shape.outcome.design_curve`).
    """

    name: ClassVar[str] = "spline"
    source: ClassVar[str] = "own: joint Gaussian-process regression over all runs, flexure in time removed"
    options: ClassVar[Mapping[str, str]] = {
        "limit": "tolerated departure from the design about x, y, z, rad/m",
        "design": "design curvature: function of arc length, triple, or rows of s and three curvatures",
    }
    limit: Sequence[float] = NO_LIMIT
    design: Design = None

    def shape(self, trial: Trial, deformation: Deformation | None = None) -> DeckShape:
        """Deck shape of a trial (module docstring); DataError when there is no sliding channel or no run."""
        path, sled = load(trial)
        main = reference(trial.main, trial.seconds(trial.main.stamp))
        sled, bent, notes = _usable(sled, main, flexure(trial, main, deformation), trial)
        layout = _layout(sled, bent, trial)
        fits, good, order = _fit(sled, main, bent, layout)
        limit = np.asarray(self.limit, dtype=float)
        passes = tuple(_passes(fits, layout, bent, path, sled.where(good), order, self.design, limit))
        if not passes:
            raise DataError("no deck shape: no run has usable samples at cruising speed", file=trial.source or None)
        notes += _notes(fits, layout, bent, good)
        return _combined(fits, layout, bent, path, passes, self.design, limit, notes)


def _usable(
    sled: Sled, main: Reference, bent: Flexure | None, trial: Trial
) -> tuple[Sled, Flexure | None, tuple[str, ...]]:
    """Samples that the main IMU covers, and the flexure if it covers most of them."""
    kept = sled.where(main.covered(sled.unit.begin, sled.unit.end))
    if len(kept.stamp) < 200:
        raise DataError("no deck shape: the main IMU does not cover the sled's runs", file=trial.source or None)
    if bent is None:
        return kept, None, ("no sub-IMU beside the runs: flexure in time is not removed and widens the std",)
    if bent.covered(kept.unit.begin, kept.unit.end).mean() < 0.5:
        return kept, None, ("flexure is known for less than half of the runs: it is not removed and widens the std",)
    return kept, bent, ()


def _layout(sled: Sled, bent: Flexure | None, trial: Trial) -> Layout:
    low, high = float(min(sled.s0.min(), sled.s1.min())), float(max(sled.s0.max(), sled.s1.max()))
    stated = trial.rig.sliding.gyro_bias_std
    share = None if bent is None else ShareBasis(low, high)
    return Layout(CurveBasis(low, high), share, stated or BIAS_STD)


def _fit(
    sled: Sled, main: Reference, bent: Flexure | None, layout: Layout
) -> tuple[list[AxisFit], BoolArray, IntArray]:
    """Fits of the three axes, the samples (n,) that served, and the run that each piece of the fits belongs to."""
    R_m_c, delay, _ = aligned(main, sled.unit)
    knots = layout.shares.stop - layout.shares.start
    state = Calibration(R_m_c, delay, np.zeros((layout.curve.size, 3)), np.zeros((knots, 3)))
    found: list[tuple[FloatArray, FloatArray]] | None = None
    for step in range(len(SEARCH_ROUNDS)):
        table = rows(sled, main, bent, layout, state)
        guesses = [_guesses(table.axis(i), layout, i) for i in range(3)]
        start = found or [(noise.mean, prior.mean) for noise, prior in guesses]
        fits = [_fit_axis(table.axis(i), layout, i, guesses[i], start[i], step) for i in range(3)]
        found = [(f.noise, f.prior) for f in fits]
        state = _renewed(state, fits, layout)
    return fits, table.good, table.order


def _guesses(runs: list[gls.Run], layout: Layout, axis: int) -> tuple[gls.Guess, gls.Guess]:
    """Weak beliefs about the logs of noise (r, g, b, sigma_b) and prior (q0, q1, q2, l, wiggle of the share)."""
    jumps = np.concatenate([np.diff(run.y, n=2) * np.sqrt(run.count[1:-1] / 6.0) for run in runs if len(run.y) > 3])
    r = max(float(np.median(np.abs(jumps))) * 1.4826, 1e-9) ** 2
    g, g_std = FLEXURE_RATE, 0.4  # a run cannot tell it from curvature, so the belief must hold
    if layout.share is not None:
        felt = np.concatenate([run.X[:, layout.shares].sum(axis=1) for run in runs])
        g, g_std = UNEXPLAINED * max(float(np.std(felt)), 1e-8), 1.5
    noise = gls.Guess(np.log([r, g, 0.15, 2.5e-7]), np.array([1.0, g_std, 0.7, 1.5]))
    length = layout.curve.high - layout.curve.low
    bend = (1e-4 / length**2) ** 2 * length
    prior = gls.Guess(np.log([bend, bend, bend, 0.1 * length, 0.05]), np.array([4.0, 5.0, 5.0, 0.6, 1.5]))
    return noise, prior


def _fit_axis(
    runs: list[gls.Run],
    layout: Layout,
    axis: int,
    guesses: tuple[gls.Guess, gls.Guess],
    start: tuple[FloatArray, FloatArray],
    step: int,
) -> AxisFit:
    def precision(prior: FloatArray) -> FloatArray:
        return layout.precision(axis, prior)

    some = runs[:: max(1, -(-len(runs) // SEARCH_RUNS))]
    noise, prior = gls.maximise(some, precision, *guesses, start, rounds=SEARCH_ROUNDS[step])
    P = precision(prior)
    first = gls.posterior(gls.total(runs, noise), P)
    kept = [_without_outliers(run, noise, first.mean) for run in runs]
    normals = tuple(gls.normal(run, noise) for run in kept)
    rejected = sum(len(a.y) - len(b.y) for a, b in zip(runs, kept))
    return AxisFit(noise, prior, P, normals, gls.posterior(gls.added(normals), P), rejected)


def _without_outliers(run: gls.Run, noise: FloatArray, beta: FloatArray) -> gls.Run:
    """Rows of a run whose whitened residual stays within ``REJECT`` of the residuals' own spread."""
    both, _ = gls.whitened(run, noise)
    residual = np.abs(both[:, -1] - both[:, :-1] @ beta)
    keep = residual < REJECT * max(1.0, 1.4826 * float(np.median(residual)))
    return run if keep.all() else gls.Run(run.y[keep], run.X[keep], run.t[keep], run.count[keep])


def _renewed(state: Calibration, fits: list[AxisFit], layout: Layout) -> Calibration:
    """Calibration with the small rotation, the delay and the curves that the fits found."""
    mean = np.stack([fit.posterior.mean for fit in fits], axis=-1)
    a = layout.shares.stop
    E = mean[a : a + 3].T
    turn = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    weight = np.array([1.0 / fit.posterior.covariance[a + 3, a + 3] for fit in fits])
    delay = state.delay + float(np.sum(weight * mean[a + 3]) / np.sum(weight))
    return Calibration(exp(-turn) @ state.R_m_c, delay, mean[: layout.curve.size], mean[layout.shares])


def _curve(
    posteriors: list[gls.Posterior], layout: Layout, bent: Flexure | None, s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Curvature and std (n, 3) rad/m at arc lengths s (n,).

    A constant error of theta, bent along the path by the slope of the share, is curvature that no run can tell apart:
    it is not estimated but stands in the std.
    """
    B, n = layout.curve.matrix(s), layout.curve.size
    mean = np.stack([B @ p.mean[:n] for p in posteriors], axis=-1)
    variance = np.stack([(B @ p.covariance[:n, :n] * B.toarray()).sum(axis=1) for p in posteriors], axis=-1)
    if bent is not None and layout.share is not None:
        slope = np.stack([layout.share.slope(p.mean[layout.shares], s) for p in posteriors], axis=-1)
        variance += (slope * bent.offset_std) ** 2
    return mean, np.sqrt(variance)


def _alone(fit: AxisFit, piece: int, layout: Layout) -> gls.Posterior:
    """Posterior from one run's rows; what is common to all runs but the curve is known from all of them."""
    n, joint, P = layout.curve.size, fit.posterior, np.zeros_like(fit.P)
    P[:n, :n] = fit.P[:n, :n]
    P[n:, n:] = np.linalg.inv(joint.covariance[n:, n:])
    return gls.posterior(fit.runs[piece], P, np.concatenate([np.zeros(n), joint.mean[n:]]))


def _passes(
    fits: list[AxisFit],
    layout: Layout,
    bent: Flexure | None,
    path: Track,
    sled: Sled,
    order: IntArray,
    design: Design,
    limit: FloatArray,
) -> Iterator[DeckPass]:
    for piece, index in enumerate(order):
        use = reported(sled, path, int(index))
        if not use.any():
            continue
        s = sled.s[use]
        grid = np.linspace(s.min(), s.max(), GRID)
        mean, std = _curve([_alone(fit, piece, layout) for fit in fits], layout, bent, grid)
        k, k_std = (np.stack([np.interp(s, grid, c[:, i]) for i in range(3)], axis=-1) for c in (mean, std))
        yield deck_pass(path.passes[int(index)], path, sled.stamp[use], s, k, k_std, design, limit)


def _combined(
    fits: list[AxisFit],
    layout: Layout,
    bent: Flexure | None,
    path: Track,
    passes: tuple[DeckPass, ...],
    design: Design,
    limit: FloatArray,
    notes: tuple[str, ...],
) -> DeckShape:
    s = np.linspace(min(p.arc_length.min() for p in passes), max(p.arc_length.max() for p in passes), GRID)
    mean, std = _curve([fit.posterior for fit in fits], layout, bent, s)
    wanted = design_curve(design, s)
    line, over = deformed_line(path, s, mean), exceeds(mean, std, wanted, limit)
    return DeckShape("spline", passes, s, mean, std, line, over, limit, wanted, notes)


def _notes(fits: list[AxisFit], layout: Layout, bent: Flexure | None, good: BoolArray) -> tuple[str, ...]:
    lost = int((~good).sum())
    out = [f"{lost} of {len(good)} sled samples left out as outliers or not covered"] if lost else []
    blocks = sum(fit.rejected for fit in fits)
    if blocks:
        out.append(f"{blocks} further block means left out as outliers")
    if bent is not None:
        out += [f"flexure in time removed with {bent.source}", *_share_notes(fits, layout)]
    return tuple(out)


def _share_notes(fits: list[AxisFit], layout: Layout) -> Iterator[str]:
    """Share of the sub-IMU's flexure that the sled felt at both ends of the path, per axis."""
    a, b = layout.shares.start, layout.shares.stop - 1
    for name, fit in zip("xyz", fits):
        p = fit.posterior
        values = [f"{p.mean[i]:.3f} ± {np.sqrt(p.covariance[i, i]):.3f}" for i in (a, b)]
        yield f"share of the sub-IMU's flexure about {name}: {values[0]} at the path's start, {values[1]} at its end"
