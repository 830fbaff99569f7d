"""Shares and medians with their intervals of 95 %."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

Z95 = 1.959963984540054
RESAMPLES = 2000


@dataclass(frozen=True)
class Share:
    """k of n with Wilson's score interval."""

    k: int
    n: int

    @property
    def value(self) -> float | None:
        """k / n, None of nothing."""
        return self.k / self.n if self.n else None

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson (1927), J. Am. Stat. Assoc. 22, 209; (0, 1) of nothing."""
        if not self.n:
            return 0.0, 1.0
        p, z2 = self.k / self.n, Z95 * Z95
        middle = (p + z2 / (2 * self.n)) / (1.0 + z2 / self.n)
        half = Z95 / (1.0 + z2 / self.n) * sqrt(p * (1.0 - p) / self.n + z2 / (4.0 * self.n**2))
        return max(0.0, middle - half), min(1.0, middle + half)

    def document(self) -> dict[str, Any]:
        """As in the score file."""
        return {"k": self.k, "n": self.n, "share": self.value, "ci95": list(self.interval)}


@dataclass(frozen=True)
class Middle:
    """Median or mean of n values with a bootstrap interval."""

    value: float | None
    low: float | None
    high: float | None
    n: int

    def document(self) -> dict[str, Any]:
        """As in the score file."""
        return {"value": self.value, "ci95": [self.low, self.high], "n": self.n}


def share(flags: Iterable[bool]) -> Share:
    """How many are true."""
    listed = [bool(flag) for flag in flags]
    return Share(sum(listed), len(listed))


def median(values: Sequence[float]) -> Middle:
    """Median; its interval by resampling with a fixed seed, so that a score can be repeated."""
    return _middle(values, np.median)


def mean(values: Sequence[float]) -> Middle:
    """Mean, likewise."""
    return _middle(values, np.mean)


def _middle(values: Sequence[float], statistic: Callable[..., Any]) -> Middle:
    if not len(values):
        return Middle(None, None, None, 0)
    array = np.asarray(values, dtype=float)
    drawn = np.random.default_rng(0).choice(array, (RESAMPLES, len(array)))
    low, high = np.quantile(statistic(drawn, axis=1), [0.025, 0.975])
    return Middle(float(statistic(array)), float(low), float(high), len(array))
