"""A deck that stiffens, judged by what its twin knows of it: damping, stiffness and gain found together.

    theta'' + 2 mu theta' + b^2 (theta + gain theta^3) = w    about each axis

Seen from the linear model (mu_m, b_m^2) that whitens a log, with b^2 = (1 + k) b_m^2 and mu = (1 + d) mu_m, what it
lacks are the moments d 2 mu_m theta' + k b_m^2 theta + (1 + k) gain b_m^2 theta^3: three columns an axis, and a product
of two parameters, so that a gain found beside any other stiffness than the deck's own would be wrong by their ratio.
The model follows the log, stiffened as it is, and knows nothing of the twin. A deck that does not stiffen would have to
be as stiff on the average as the log shows: under either hypothesis mu and b^2 have the prior that a twin deserves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from physics.flexure import driven
from physics.normal import solve_normal
from physics.units import ARCMIN
from schemas.rig import FloatArray
from stages.diagnose.evidence import Gram
from stages.diagnose.slow import SHARE
from twin.effects._prediction import LogView, Signals, on_axis

NAME = "amplitude_stiffening"
LINEAR = tuple(f"deck|{kind}|{axis}" for kind in ("damping", "stiffness") for axis in "xyz")
NAMES = (*LINEAR, *(f"deck|cubic|{axis}" for axis in "xyz"))
NUISANCES = tuple(f"{kind} {axis}" for kind in ("damping", "stiffness") for axis in "xyz")  # in whose place these stand
STARTS = (0.0, 0.3, 2.0)  # of the gain, over the square of the deck's size
TIED = 1e-10  # information on a gain that the log says nothing of: what keeps its variance finite


@dataclass(frozen=True)
class Deck:
    """Damping and stiffness of the axes, each (2, 3): of the model that whitens, as the twin has them, as found beside
    the gain. size: arcmin, of its bending."""

    model: FloatArray
    believed: FloatArray
    found: FloatArray
    size: float


@dataclass(frozen=True)
class Stiffness:
    """deck: with what was found. gain: 1/arcmin^2, variance: of it. cost: negative log of likelihood and prior, but for
    a constant."""

    deck: Deck
    gain: float
    variance: float
    cost: float


def deck_of(view: LogView) -> Deck:
    """The deck of a view, as the twin has it."""
    believed = np.stack([view.damping, view.stiffness])
    return Deck(view.answering, believed, believed, max(float(view.theta.std(axis=0).max()) / ARCMIN, 1e-3))


def columns(view: LogView) -> list[Signals]:
    """Answers to the moments of ``NAMES``, the cubic ones per 1/arcmin^2."""
    mu, b2 = view.answering
    angle, rate = view.foretold
    moments = (2.0 * mu * rate, b2 * angle, b2 * angle**3 / ARCMIN**2)
    return [
        Signals(bending=on_axis(axis, driven(mu[axis], b2[axis], view.interval, -moment[:, axis])))
        for moment in moments
        for axis in range(3)
    ]


def evidence(gram: Gram, base: Sequence[int], deck: Deck) -> float:
    """Nats in favour of a deck that stiffens beside the regressors ``base``, less the price of its gain; none for one
    that softens."""
    bent = fit(gram, base, deck)
    return fit(gram, base, deck, linear=True).cost - bent.cost - 1.0 if bent.gain > 0.0 else 0.0


def fit(gram: Gram, base: Sequence[int], deck: Deck, linear: bool = False) -> Stiffness:
    """The most probable deck beside the regressors ``base``; linear: without a gain."""
    A, b = _moments(gram, base)
    ratio, unit = deck.believed / deck.model, 1.0 / deck.size**2

    def values(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(9,) what the columns are worth with mu and b^2 exp(x) times the twin's, and the slopes (9, 7)."""
        mu, b2 = ratio * np.exp(x[:6]).reshape(2, 3)
        slopes = np.zeros((9, 7))
        slopes[range(6), range(6)] = np.concatenate([mu, b2])
        slopes[range(6, 9), range(3, 6)] = b2 * x[6] * unit
        slopes[6:, 6] = 0.0 if linear else b2 * unit
        return np.concatenate([mu - 1.0, b2 - 1.0, b2 * x[6] * unit]), slopes

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        v, slopes = values(x)
        value = 0.5 * float(v @ A @ v) - float(b @ v) + 0.5 * float(np.sum((x[:6] / SHARE) ** 2))
        return value, slopes.T @ (A @ v - b) + np.concatenate([x[:6] / SHARE**2, [0.0]])

    tried = [
        minimize(cost, np.array([0.0] * 6 + [g]), jac=True, method="BFGS") for g in STARTS[: 1 if linear else None]
    ]
    best = min(tried, key=lambda found: float(found.fun))
    slopes = values(best.x)[1]
    information = slopes.T @ A @ slopes + np.diag([1.0 / SHARE**2] * 6 + [max(float(linear), TIED)])
    found = deck.believed * np.exp(best.x[:6]).reshape(2, 3)
    variance = float(np.linalg.inv(information)[6, 6]) * unit**2
    return Stiffness(replace(deck, found=found), float(best.x[6]) * unit, variance, float(best.fun))


def _moments(gram: Gram, base: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """(9, 9) and (9,) of ``NAMES`` with everything else in ``base`` fitted to them and to the log."""
    others = [k for k in base if gram.names[k] not in (*NUISANCES, *NAMES)]
    own, G = gram.index(NAMES), gram.total
    A = G[np.ix_(others, others)] + np.diag(gram.precision[others])
    mixed = G[np.ix_(others, [*own, -1])]
    left = G[np.ix_(own, [*own, -1])] - mixed[:, :-1].T @ solve_normal(A, mixed)
    return left[:, :-1], left[:, -1]
