"""Which effects a set is made of, balanced over names and severities and shuffled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import cycle, product

import numpy as np

from pipeline.blind.reality.drawing import MULTIPLES
from pipeline.blind.reality.severity import FOREIGN, LISTED
from schemas.errors import DataError

CHANNELS = ("main.gyro", "sub.gyro", "main.accel", "sub.accel", "phins_main.attitude", "phins_sub.attitude",
            "sub.stamp", "sub.temperature")  # fmt: skip


@dataclass(frozen=True)
class Shares:
    """Shares of a set: nulls, pairs of effects, effects outside the list, effects removed from the library.

    The rest holds one effect each. As many logs as have their effect removed have another one removed instead, so that
    what is removed does not tell what is there.
    """

    null: float = 0.35
    pair: float = 0.12
    foreign: float = 0.1
    removed: float = 0.06

    def __post_init__(self) -> None:
        parts = (self.null, self.pair, self.foreign, self.removed)
        if min(parts) < 0.0 or sum(parts) > 1.0:
            raise DataError("the shares of a sealed set must not be negative, nor add up to more than 1")


@dataclass(frozen=True)
class Order:
    """What a log is to hold. kind: null, single, pair, foreign, removed."""

    kind: str
    effects: tuple[str, ...]
    severity: float
    duration: float
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Wish:
    """What may be drawn: names of effects, multiples of the detectable severity, durations s."""

    names: Sequence[str] = LISTED
    foreign: Sequence[str] = FOREIGN
    severities: Sequence[float] = MULTIPLES
    durations: Sequence[float] = (600.0, 900.0, 1200.0, 1800.0)
    shares: Shares = field(default_factory=Shares)


def plan(count: int, wish: Wish, rng: np.random.Generator) -> list[Order]:
    """``count`` orders in random order; names and severities as evenly used as the count allows."""
    shares = wish.shares
    parts = {
        "null": round(count * shares.null),
        "pair": round(count * shares.pair),
        "foreign": round(count * shares.foreign),
        "removed": round(count * shares.removed),
    }
    parts["single"] = max(count - sum(parts.values()), 0)
    orders = [order for kind, number in parts.items() for order in _orders(kind, number, wish, rng)][:count]
    orders = _with_decoys(orders, parts["removed"], wish, rng)
    return [orders[k] for k in rng.permutation(len(orders))]


def _orders(kind: str, number: int, wish: Wish, rng: np.random.Generator) -> list[Order]:
    def duration() -> float:
        return float(rng.choice(wish.durations))

    if kind == "null":
        return [Order(kind, (), 0.0, duration()) for _ in range(number)]
    if kind == "pair":
        severities = _turns(wish.severities, number, rng)
        return [Order(kind, _pair(wish.names, rng), float(s), duration()) for s in severities]
    cells = _turns(list(product(wish.foreign if kind == "foreign" else wish.names, wish.severities)), number, rng)
    return [
        Order(kind, (name,), float(severity), duration(), (name,) if kind == "removed" else ())
        for name, severity in cells
    ]


def _turns(cells: Sequence, number: int, rng: np.random.Generator) -> list:
    """``number`` cells, each as often as any other or once more, the odd ones by chance."""
    shuffled = [cells[k] for k in rng.permutation(len(cells))]
    return [cell for cell, _ in zip(cycle(shuffled), range(number))]


def _pair(names: Sequence[str], rng: np.random.Generator) -> tuple[str, ...]:
    """Two names that are not stated look-alikes of each other (those no method could tell from one)."""
    from twin.effects import look_alikes

    for _ in range(1000):
        first, second = (str(name) for name in rng.choice(names, 2, replace=False))
        if second not in {alike.name for alike in look_alikes(first, CHANNELS)}:
            return first, second
    raise DataError("there are no two of these effects that can be told apart")


def _with_decoys(orders: list[Order], number: int, wish: Wish, rng: np.random.Generator) -> list[Order]:
    """As many of the other orders with some effect removed that they do not hold."""
    others = [k for k, order in enumerate(orders) if order.kind != "removed"]
    chosen = set(rng.choice(others, min(number, len(others)), replace=False).tolist()) if number and others else set()
    out = list(orders)
    for k in chosen:
        order = orders[k]
        absent = [name for name in wish.names if name not in order.effects]
        if absent:
            name = str(rng.choice(absent))
            out[k] = Order(order.kind, order.effects, order.severity, order.duration, (name,))
    return out
