"""From the total rotation of the deck to a flexure model: increments, periodogram, Whittle fit per axis."""

from __future__ import annotations

import numpy as np

from physics import matching, whittle
from physics.units import ARCMIN, DEG_PER_SQRT_HOUR
from schemas.errors import DataError
from schemas.products import BoolArray, FlexureModel, Status
from schemas.rig import FloatArray, Rig

SHORTEST_RUN_S = 10.0  # s: pieces between gaps shorter than this are left out
GYRO_NOISE = 1.4e-3 * DEG_PER_SQRT_HOUR  # of the difference of two fibre gyros; centre of a prior three decades wide
GYRO_NOISE_SPREAD = 2.5  # natural-log sigma of that prior where the rig states nothing
GYRO_NOISE_STATED_SPREAD = 0.1  # and where it does
HOLE_S = 0.15  # s, longest bridged stretch that is taken as measured
BAND_HZ = 6.0  # fitted up to here, or to an eighth of the rate, where interpolation dulls what is faster
BAD_MISFIT = 0.5  # share of the power of some octave
SHORT_RECORD = 20.0  # correlation times
WEAK_SIGMA = 0.35  # standard error of ln sigma


def gyro_noise_prior(rig: Rig) -> tuple[float, float]:
    """Centre (rad/sqrt(s)) and natural-log spread of the prior on the noise of the two gyros' difference."""
    if rig.main.gyro_arw is not None and rig.sub.gyro_arw is not None:
        return float(np.hypot(rig.main.gyro_arw, rig.sub.gyro_arw)), GYRO_NOISE_STATED_SPREAD
    return GYRO_NOISE, GYRO_NOISE_SPREAD


def fit_flexure(
    t: FloatArray, total: FloatArray, good: BoolArray, rig: Rig, start: FlexureModel | None = None,
    dulled: bool = False,
) -> FlexureModel:  # fmt: skip
    """Whittle fit of increments Log(T_k T_{k-1}^T) in m-axes.

    t: (n,) s; total: (n, 4) R_m_s; good: (n,) measured samples. dulled: fit the lower band alone, because the samples
    were interpolated.

    Raises DataError when no gapless piece is long enough.
    """
    T = float(np.median(np.diff(t)))
    increments = matching.increments(total)
    whole = _without_holes(good[1:] & good[:-1], int(HOLE_S / T))
    pieces = _pieces(whole, max(int(SHORTEST_RUN_S / T), 64))
    if not pieces:
        raise DataError(f"no piece of {SHORTEST_RUN_S:.0f} s without a gap: the flexure cannot be identified")
    centre, spread = gyro_noise_prior(rig)
    fits = []
    for axis in range(3):
        data = whittle.periodogram([increments[piece, axis] for piece in pieces])
        fits.append(_fit_axis(data, T, centre, spread, _start(start, axis), dulled))
    length = sum(piece.stop - piece.start for piece in pieces) * T
    return _model(fits, length)


def _start(model: FlexureModel | None, axis: int) -> tuple[float, float, float, float] | None:
    if model is None:
        return None
    return model.damping[axis], model.stiffness[axis], model.std[axis], model.gyro_noise[axis]


def _fit_axis(
    data: whittle.Periodogram,
    T: float,
    centre: float,
    spread: float,
    start: tuple[float, float, float, float] | None,
    dulled: bool,
) -> whittle.WhittleFit:
    """From the last model if there is one; anew if that leaves an octave badly explained."""
    highest = max(2.0 * np.pi * BAND_HZ * T, 0.25 * np.pi) if dulled else np.pi
    band = (data.omega <= highest).astype(float)
    fit = whittle.fit(data, T, noise_prior=centre, noise_spread=spread, weight=band, start=start)
    if start is None or abs(fit.misfit) < BAD_MISFIT:
        return fit
    anew = whittle.fit(data, T, noise_prior=centre, noise_spread=spread, weight=band)
    return max(fit, anew, key=lambda found: found.log_likelihood)


def _without_holes(good: BoolArray, longest: int) -> BoolArray:
    """Bridged stretches of a few samples count as measured: splitting there would lose the low frequencies."""
    edges = np.flatnonzero(np.diff(np.concatenate([[1], good.astype(int), [1]])))
    whole = good.copy()
    for a, b in zip(edges[::2], edges[1::2]):
        if b - a <= longest and a > 0 and b < len(good):
            whole[a:b] = True
    return whole


def _pieces(good: BoolArray, shortest: int) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(int), [0]])))
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2]) if b - a >= shortest]


def _model(fits: list[whittle.WhittleFit], length: float) -> FlexureModel:
    judged = [_judge(fit, length) for fit in fits]
    return FlexureModel(
        method="whittle",
        damping=np.array([fit.damping for fit in fits]),
        stiffness=np.array([fit.stiffness for fit in fits]),
        std=np.array([fit.std for fit in fits]),
        log_covariance=np.stack([fit.covariance[:3, :3] for fit in fits]),
        gyro_noise=np.array([fit.gyro_noise for fit in fits]),
        status=(judged[0][0], judged[1][0], judged[2][0]),
        reason=(judged[0][1], judged[1][1], judged[2][1]),
    )


def _judge(fit: whittle.WhittleFit, length: float) -> tuple[Status, str]:
    # The slow root of an overdamped axis sets the correlation time.
    slow = fit.damping - np.sqrt(max(fit.damping**2 - fit.stiffness, 0.0))
    if length * slow < SHORT_RECORD:
        return (
            Status.WEAK,
            f"the record of {length:.0f} s is shorter than {SHORT_RECORD:.0f} correlation times; a weak prior helps",
        )
    if fit.covariance[2, 2] > WEAK_SIGMA**2:
        return Status.WEAK, f"sigma is known to {100 * np.sqrt(fit.covariance[2, 2]):.0f} % only"
    if fit.std < 0.01 * ARCMIN:
        return Status.WEAK, "flexure is not seen above the noise of the gyros"
    return Status.ESTIMATED, ""
